# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that take their places all together or not at all."""

from __future__ import annotations

import os
import shutil
import uuid
from pathlib import Path
from types import TracebackType

from .errors import InputError


class NewFiles:
    """Names to write to beside the places wanted; `commit` renames.

    Leaving the `with` block without it leaves no file and no folder behind.
    """

    def __init__(self) -> None:
        self._pending: list[tuple[Path, Path]] = []
        self._folders: list[Path] = []

    def __enter__(self) -> NewFiles:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.discard()

    def add(self, place: Path, size: int) -> Path:
        """Where to write the file that is to be at `place`, `size` bytes long; makes the folder."""
        for folder in [*reversed(place.parent.parents), place.parent]:
            if not folder.exists():
                folder.mkdir()
                self._folders.append(folder)
        if place.is_dir():
            raise InputError(f"'{place}' is a folder.")
        free = shutil.disk_usage(place.parent).free
        wanted = size + sum(beside.stat().st_size for beside, _ in self._pending if beside.exists())
        if wanted > free:
            raise InputError(f"'{place.name}' needs {wanted / 1e6:.0f} MB; '{place.parent}' has {free / 1e6:.0f} MB.")
        beside = place.with_name(f".{place.name}.{uuid.uuid4().hex[:8]}.part")
        self._pending.append((beside, place))
        return beside

    def commit(self) -> None:
        """Move all files to their places; where one cannot go there, none does."""
        moved: list[tuple[Path, Path, Path | None]] = []
        try:
            for beside, place in self._pending:
                old = None
                # The last move needs no way back.
                if place.exists() and place != self._pending[-1][1]:
                    old = place.with_name(beside.name + ".old")
                    os.replace(place, old)
                moved.append((beside, place, old))
                os.replace(beside, place)
        except OSError:
            for beside, place, old in reversed(moved):
                if not beside.exists():
                    os.replace(place, beside)
                if old is not None:
                    os.replace(old, place)
            raise
        for _, _, old in moved:
            if old is not None:
                old.unlink()
        self._pending.clear()
        self._folders.clear()

    def discard(self) -> None:
        """Remove what was written and not moved."""
        for beside, _ in self._pending:
            beside.unlink(missing_ok=True)
        for folder in reversed(self._folders):
            if not any(folder.iterdir()):
                folder.rmdir()
        self._pending.clear()
        self._folders.clear()
