# SPDX-License-Identifier: GPL-3.0-or-later
"""A job of a recipe in a process of its own on a worker, which has Blender as a Python module but not this add-on."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PATIENCE_SECONDS = 0.5
# Lines that are told of a process that came to no report.
LAST_LINES = 5


@dataclass(frozen=True)
class RemoteResult:
    """A job's entry in the report, and all that its process printed."""

    entry: dict[str, Any]
    output: str


def packed(folder: Path) -> bytes:
    """The add-on's folder as a zip, without its wheels."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            part = path.relative_to(folder)
            if path.is_file() and not {"wheels", "__pycache__"} & set(part.parts):
                archive.write(path, Path("dermis") / part)
    return content.getvalue()


def run_remote(
    addon: bytes, recipe: str, name: str, flags: tuple[str, ...], stopped: Callable[[], bool]
) -> RemoteResult:  # fmt: skip
    """Unpack the add-on and run one job of the recipe, whose files the worker must see; ended when `stopped`.

    OSError where there is no report afterwards.
    """
    with tempfile.TemporaryDirectory(prefix="dermis-", ignore_cleanup_errors=True) as scratch:
        folder, log, report = (Path(scratch, part) for part in ("dermis", "log.txt", "report.json"))
        with zipfile.ZipFile(io.BytesIO(addon)) as archive:
            archive.extractall(scratch)
        command = [sys.executable, str(folder), "run", recipe, "--job", name, "--report", str(report), *flags]
        with log.open("wb") as stream, subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT) as process:
            try:
                while process.poll() is None and not stopped():
                    try:
                        process.wait(PATIENCE_SECONDS)
                    except subprocess.TimeoutExpired:
                        continue
            finally:
                process.kill()
        output = log.read_text(encoding="utf-8", errors="replace")
        if not report.is_file():
            told = " ".join(output.strip().splitlines()[-LAST_LINES:]) or f"exit code {process.returncode}"
            raise OSError(told)
        return RemoteResult(json.loads(report.read_text(encoding="utf-8"))["jobs"][0], output)
