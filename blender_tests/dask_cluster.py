# SPDX-License-Identifier: GPL-3.0-or-later
"""A Dask cluster of processes on this machine."""

import json
import subprocess
import sys
import time
from contextlib import contextmanager

SCHEDULER = "import sys; from distributed.cli.dask_scheduler import main; sys.argv[1:] = {}; main()"
WORKER = "import sys; from distributed.cli.dask_worker import main; sys.argv[1:] = {}; main()"
COUNT = 3


@contextmanager
def running(*programs):
    """Processes of the cluster; the native module is the environment's own, as on a worker without Blender."""
    processes = [
        subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for program in programs
    ]
    try:
        yield processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


@contextmanager
def scheduler(folder):
    """The address of a scheduler without workers."""
    place = folder / "scheduler.json"
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(place)]
    with running(SCHEDULER.format(options)):
        for _ in range(600):
            if place.exists() and place.stat().st_size:
                break
            time.sleep(0.1)
        yield json.loads(place.read_text())["address"]


@contextmanager
def workers(address, folder):
    """Processes that work."""
    import distributed

    options = ["--nthreads", "1", "--no-dashboard", "--no-nanny", "--local-directory", str(folder)]
    with running(*[WORKER.format([address, *options])] * COUNT) as processes:
        with distributed.Client(address, timeout=60) as client:
            client.wait_for_workers(COUNT, timeout=120)
        yield processes
