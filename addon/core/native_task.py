# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that is calls of the native module, each with a progress of its own."""

from __future__ import annotations

from typing import TypeVar

from dermis_native import Progress

from .background import BackgroundTask

Result = TypeVar("Result")


class NativeTask(BackgroundTask[Result]):
    """A task of so many calls, alike in length. Subclasses count in `_current` those that are over."""

    def __init__(self, name: str, calls: int = 1) -> None:
        super().__init__(name)
        self._progress = [Progress() for _ in range(calls)]
        self._current = 0

    def cancel(self) -> None:
        """Ask the thread to stop soon; `result` then raises `dermis_native.Cancelled`."""
        for progress in self._progress:
            progress.cancel()

    @property
    def fraction(self) -> float:
        """Share of the work done, 0 to 1."""
        return sum(progress.fraction for progress in self._progress) / max(len(self._progress), 1)

    @property
    def stage(self) -> str:
        """What is being done now."""
        return self._progress[min(self._current, len(self._progress) - 1)].stage
