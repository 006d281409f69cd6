# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs jobs one after the other: open, append, steps, discard, save. A job that fails leaves no file."""

import logging
import time
from typing import Any

from ..core.errors import InputError, sentence
from ..core.recipe import Job
from .files import append_objects, discard_objects, open_file, save_file
from .step import DONE, FAILED, PROBLEMS, run_step

log = logging.getLogger(__name__)


def say(text: str) -> None:
    """Print a line of progress."""
    print(f"Dermis: {text}", flush=True)


def run_jobs(jobs: list[Job], autoexec: bool) -> list[dict[str, Any]]:
    """Run all jobs; one that fails does not keep the others from running. What was done, job by job."""
    entries = []
    for number, job in enumerate(jobs, 1):
        say(f"{job.name} ({number} of {len(jobs)})")
        entries.append(_run_job(job, autoexec))
    return entries


def _run_job(job: Job, autoexec: bool) -> dict[str, Any]:
    start = time.monotonic()
    steps: list[dict[str, Any]] = []
    entry: dict[str, Any] = {"name": job.name, "open": job.open, "output": "", "status": DONE, "steps": steps}
    try:
        open_file(job.open, autoexec)
        for order in job.append:
            append_objects(order)
        for number, step in enumerate(job.steps, 1):
            say(f"step {number} of {len(job.steps)}, {step.command.name}")
            steps.append(run_step(step))
            say(f"{step.command.name} {steps[-1]['status']} in {steps[-1]['seconds']:.2f} s")
            for report in steps[-1]["reports"]:
                say(f"{report['level'].lower()}: {report['text']}")
            if steps[-1]["status"] == FAILED:
                entry["status"] = FAILED
                break
            if steps[-1]["status"] == PROBLEMS:
                entry["status"] = PROBLEMS
        if entry["status"] != FAILED:
            if job.discard:
                discard_objects(job.discard)
            if job.output:
                save_file(job.output)
                entry["output"] = job.output
    except InputError as error:
        entry["status"], entry["error"] = FAILED, str(error)
        say(f"error: {error}")
    except Exception as error:
        log.exception("%s failed", job.name)
        entry["status"], entry["error"] = FAILED, f"Unexpected {type(error).__name__}: {sentence(str(error))}"
        say(f"error: {entry['error']}")
    entry["seconds"] = round(time.monotonic() - start, 3)
    return entry
