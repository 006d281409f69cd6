"""What the repository's tests read: the files of the checkout, as git would ship them."""

from __future__ import annotations

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def shipped_files(*suffixes: str) -> list[Path]:
    """Files that git tracks or would track, only those with one of the suffixes when any are given."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    answer = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if answer.returncode == 0:
        paths = [ROOT / name for name in answer.stdout.split("\0") if name]
    else:  # a source archive without git
        unshipped = {".venv", ".setup", "target", "dist", "__pycache__"}
        paths = [path for path in ROOT.rglob("*") if not unshipped & set(path.relative_to(ROOT).parts)]
    return sorted(path for path in paths if path.is_file() and (not suffixes or path.suffix in suffixes))


def relative(path: Path) -> str:
    """A path as messages show it."""
    return path.relative_to(ROOT).as_posix()
