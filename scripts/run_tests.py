# SPDX-License-Identifier: MIT OR Apache-2.0
"""Run every suite with its output live, then say in one line how many tests passed and failed.

Suites: Rust tests, pytest without Blender, pytest inside Blender, linters (each linter counts as one test).
The exit status is 0 only if nothing failed and every suite ran to its end.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from project import ROOT, VENV_PYTHON, say

PYTHON = str(VENV_PYTHON)
ALLOWLIST = ROOT / "scripts" / "stubtest_allowlist.txt"
SUITE_SECONDS = 1800  # a suite that runs longer hangs


@dataclass
class Counts:
    """Tests of one suite; `failed` has the names of what failed."""

    passed: int = 0
    skipped: int = 0
    failed: list[str] = field(default_factory=list)

    def __iadd__(self, other: Counts) -> Counts:
        self.passed += other.passed
        self.skipped += other.skipped
        self.failed += other.failed
        return self


def run_live(command: list[str], environment: dict[str, str] | None = None) -> tuple[int, str]:
    """Exit status and output of a command whose output is shown while it runs."""
    print(f"    $ {shlex.join(command)}", flush=True)
    with subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, **(environment or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as process:

        def end() -> None:
            print(f"    no end after {SUITE_SECONDS} s: stopped", flush=True)
            os.killpg(process.pid, signal.SIGKILL)

        timer = threading.Timer(SUITE_SECONDS, end)
        timer.start()
        lines = []
        try:
            for line in process.stdout or ():
                print(line, end="", flush=True)
                lines.append(line)
            return process.wait(), "".join(lines)
        finally:
            timer.cancel()
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def cargo_counts(output: str) -> Counts:
    """Counts from the output of `cargo test`."""
    counts = Counts()
    for passed, ignored in re.findall(r"^test result: .*?(\d+) passed; \d+ failed; (\d+) ignored", output, re.M):
        counts.passed += int(passed)
        counts.skipped += int(ignored)
    counts.failed = sorted(set(re.findall(r"^test (.+?) (?:- .*)?\.\.\. FAILED", output, re.M)))
    return counts


def junit_counts(report: Path) -> Counts:
    """Counts from pytest's XML report."""
    counts = Counts()
    for case in ElementTree.parse(report).iter("testcase"):
        kinds = {child.tag for child in case}
        if kinds & {"failure", "error"}:
            counts.failed.append(f"{case.get('classname', '')}::{case.get('name', '')}")
        elif "skipped" in kinds:
            counts.skipped += 1
        else:
            counts.passed += 1
    return counts


def rust() -> Counts:
    status, output = run_live(["cargo", "test", "--locked"])
    counts = cargo_counts(output)
    if status != 0 and not counts.failed:
        counts.failed.append("cargo test did not run to its end")
    return counts


def pytest(folder: str) -> Counts:
    with tempfile.TemporaryDirectory() as scratch:
        report = Path(scratch) / "report.xml"
        status, _ = run_live([PYTHON, "-m", "pytest", folder, "--color=no", f"--junit-xml={report}"])
        counts = junit_counts(report) if report.is_file() else Counts()
    if status != 0 and not counts.failed:
        counts.failed.append(f"pytest {folder} ended with status {status}")
    return counts


def lint() -> Counts:
    checks = {
        "cargo fmt": ["cargo", "fmt", "--all", "--check"],
        "clippy": ["cargo", "clippy", "--locked", "--workspace", "--all-targets", "--", "--deny=warnings"],
        "rustdoc": ["cargo", "doc", "--locked", "--workspace", "--no-deps"],
        "ruff check": [PYTHON, "-m", "ruff", "check"],
        "ruff format": [PYTHON, "-m", "ruff", "format", "--check"],
        "mypy": [PYTHON, "-m", "mypy"],
        "stubtest": [PYTHON, "-m", "mypy.stubtest", "dermis_native", f"--allowlist={ALLOWLIST}"],
    }
    counts = Counts()
    for name, command in checks.items():
        status, _ = run_live(command, {"RUSTDOCFLAGS": "--deny=warnings", "MYPYPATH": "native/python"})
        if status == 0:
            counts.passed += 1
        else:
            counts.failed.append(name)
    return counts


SUITES: dict[str, Callable[[], Counts]] = {
    "lint": lint,
    "rust": rust,
    "python": lambda: pytest("tests"),
    "blender": lambda: pytest("blender_tests"),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("suites", nargs="*", choices=[[], *SUITES], help="suites to run; all when none are named")
    chosen = parser.parse_args().suites or list(SUITES)
    total = Counts()
    table = []
    for suite in chosen:
        say(f"Suite: {suite}")
        start = time.monotonic()
        counts = SUITES[suite]()
        seconds = time.monotonic() - start
        table.append(
            f"{suite:<8} {counts.passed:5} passed {len(counts.failed):5} failed "
            f"{counts.skipped:5} skipped {seconds:7.1f} s"
        )
        counts.failed = [f"{suite}: {name}" for name in counts.failed]
        total += counts
    print()
    print("\n".join(table))
    for name in total.failed:
        print(f"FAILED  {name}")
    print(f"{total.passed} passed, {len(total.failed)} failed", flush=True)
    return 1 if total.failed else 0


if __name__ == "__main__":
    sys.exit(main())
