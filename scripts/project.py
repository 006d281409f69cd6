# SPDX-License-Identifier: MIT OR Apache-2.0
"""Where things are in the checkout, and how the set-up steps run commands and remember their work.

Standard library only: these scripts run before anything is installed.
"""

from __future__ import annotations

import hashlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / ".venv"
VENV_PYTHON = VENV / "bin" / "python"
DIST = ROOT / "dist"
STAMPS = ROOT / ".setup"


def say(text: str) -> None:
    """One line of progress."""
    print(f"==> {text}", flush=True)


def fail(text: str) -> NoReturn:
    """End the program with a message and exit status 1."""
    print(f"\nerror: {text}", file=sys.stderr, flush=True)
    raise SystemExit(1)


def run(command: list[str], environment: dict[str, str] | None = None) -> None:
    """Run a command in the checkout with its output visible; its failure ends the program."""
    print(f"    $ {shlex.join(command)}", flush=True)
    status = subprocess.run(command, cwd=ROOT, env={**os.environ, **(environment or {})}).returncode
    if status != 0:
        fail(f"exit status {status} from: {shlex.join(command)}")


def version() -> str:
    """The version in Cargo.toml, the only place where it is decided."""
    found = re.search(
        r'^\[workspace\.package\][^\[]*?^version\s*=\s*"([^"]+)"',
        (ROOT / "Cargo.toml").read_text(encoding="utf-8"),
        re.MULTILINE | re.DOTALL,
    )
    if found is None:
        fail("Cargo.toml has no version in [workspace.package]")
    return found.group(1)


def fingerprint(files: list[Path], *extra: str) -> str:
    """A hash of the files' names and contents and of any other text that matters."""
    digest = hashlib.sha256()
    for text in extra:
        digest.update(text.encode() + b"\0")
    for path in sorted(files):
        digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def sources(folder: Path, *suffixes: str) -> list[Path]:
    """Files below a folder, without caches; only those with one of the suffixes when any are given."""
    return [
        path
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and (not suffixes or path.suffix in suffixes)
    ]


def is_done(step: str, current: str) -> bool:
    """True when the step last finished with this fingerprint."""
    stamp = STAMPS / step
    return stamp.is_file() and stamp.read_text(encoding="utf-8") == current


def forget(step: str) -> None:
    """Called before a step starts: until it ends well, it counts as not done."""
    (STAMPS / step).unlink(missing_ok=True)


def mark_done(step: str, current: str) -> None:
    """Remember that the step finished with this fingerprint."""
    STAMPS.mkdir(exist_ok=True)
    (STAMPS / step).write_text(current, encoding="utf-8")
