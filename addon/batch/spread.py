# SPDX-License-Identifier: GPL-3.0-or-later
"""Jobs of a recipe on the workers of a Dask cluster, one at a time on each."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from ..core.cluster import Cluster
from ..core.errors import InputError
from ..core.recipe import Job
from ..core.remote_job import packed, run_remote
from .job import say
from .step import FAILED

FOLDER = Path(__file__).resolve().parents[1]


def spread_jobs(address: str, recipe: Path, jobs: Sequence[Job], flags: tuple[str, ...]) -> list[dict[str, Any]]:
    """Run the jobs; what was done, job by job in their order, as `run_jobs` gives it.

    InputError where there is no cluster. A job without a result is one that failed.
    """
    addon = packed(FOLDER)
    entries: dict[int, dict[str, Any]] = {}
    with Cluster(address) as cluster:
        done = cluster.done(run_remote, [(addon, str(recipe), job.name, flags) for job in jobs])
        with closing(done):
            for index, result in done:
                job = jobs[index]
                say(f"{job.name} ({len(entries) + 1} of {len(jobs)})")
                if isinstance(result, InputError):
                    say(f"error: {result}")
                    entries[index] = {
                        "name": job.name, "open": job.open, "output": "", "status": FAILED, "steps": [],
                        "error": str(result), "seconds": 0.0,
                    }  # fmt: skip
                else:
                    print(result.output, end="", flush=True)
                    entries[index] = result.entry
    return [entries[index] for index in range(len(jobs))]
