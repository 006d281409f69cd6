# SPDX-License-Identifier: MIT OR Apache-2.0
"""The same computation in new processes, each with a number of threads of its own."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import numpy as np
import numpy.typing as npt

PRINTED = "import threads; print(threads.digest(*found))"


def digest(*arrays: npt.NDArray[np.generic]) -> str:
    """What tells the bits of arrays from any others."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(each).tobytes() for each in arrays)).hexdigest()


def digests(program: str, *threads: int) -> set[str]:
    """Digests of the tuple of arrays `found` that a program leaves, with so many threads each."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    seen = set()
    for count in threads:
        run = subprocess.run(
            [sys.executable, "-c", f"{program}\n{PRINTED}"],
            env=environment | {"RAYON_NUM_THREADS": str(count)},
            stdout=subprocess.PIPE,
            text=True,
            timeout=600,
            check=True,
        )
        seen.add(run.stdout.strip())
    return seen
