# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in two steps: poses are read in Blender's own thread, frame by frame, then used in another."""

from collections.abc import Callable
from typing import Any

from dermis_native import Cancelled

from ..core.background import POLL_SECONDS, BackgroundTask, Watched
from .frame_walk import FrameWalk

# Share of the progress that reading takes.
READING = 0.3


class SampledTask(Watched[Any]):
    """`wait` is what reads, so call it in Blender's thread."""

    def __init__(self, walk: FrameWalk, follow: Callable[[], BackgroundTask[Any]]) -> None:
        self._walk = walk
        self._follow = follow
        self._task: BackgroundTask[Any] | None = None
        self._failure: BaseException | None = None

    def start(self) -> None:
        """Begin; `wait` does the rest."""

    @property
    def fraction(self) -> float:
        """Share of the work done, 0 to 1."""
        if self._task is None:
            return READING * self._walk.fraction
        return READING + (1.0 - READING) * self._task.fraction

    @property
    def stage(self) -> str:
        """What is being done now."""
        return "reading poses" if self._task is None else self._task.stage

    def wait(self, seconds: float) -> bool:
        """Go on for about so long; true when the work has ended."""
        if self._failure is not None:
            return True
        if self._task is None:
            try:
                if self._walk.step(max(seconds, POLL_SECONDS)):
                    self._task = self._follow()
                    self._task.start()
            except BaseException as failure:  # noqa: BLE001  (result() raises it where it is awaited)
                self._stop(failure)
                return True
            return False
        return self._task.wait(seconds)

    def cancel(self) -> None:
        """Stop soon; `result` then raises `dermis_native.Cancelled`."""
        if self._task is not None:
            self._task.cancel()
        elif self._failure is None:
            self._stop(Cancelled("cancelled"))

    def abandon(self) -> None:
        """Go back at once while poses are read; afterwards leave the work to end by itself."""
        self.cancel()
        if self._task is not None:
            self._task.abandon()

    def result(self) -> Any:
        """What the second step gave; raises what went wrong in either."""
        if self._failure is not None:
            raise self._failure
        return self._task.result()

    def _stop(self, failure: BaseException) -> None:
        self._failure = failure
        try:
            self._walk.restore()
        except ReferenceError:
            # Another file is open: there is nothing to go back to.
            return
