# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in a thread of its own, watched and cancelled from the thread that started it."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Generic, TypeVar

# How often the thread that waits looks at the working one.
POLL_SECONDS = 0.05

Result = TypeVar("Result")


class BackgroundTask(ABC, Generic[Result]):
    """Subclasses do the work in `work`, which touches nothing but arrays, and say how far it is."""

    def __init__(self, name: str) -> None:
        self._outcome: list[Result] = []
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._guarded, name=name, daemon=True)

    @abstractmethod
    def work(self) -> Result:
        """Do the work in the thread that calls."""

    @property
    @abstractmethod
    def fraction(self) -> float:
        """Share of the work done, 0 to 1."""

    @abstractmethod
    def cancel(self) -> None:
        """Ask the thread to stop soon; `result` then raises `dermis_native.Cancelled`."""

    def start(self) -> None:
        """Begin; call once."""
        self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Wait at most so long; true when the thread has ended."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def run(self, show_progress: Callable[[float], None]) -> None:
        """Work to the end; the thread that calls stays able to be interrupted."""
        self.start()
        try:
            while not self.wait(POLL_SECONDS):
                show_progress(self.fraction)
        except BaseException:
            self.cancel()
            raise

    def result(self) -> Result:
        """What `work` gave, after the thread has ended; raises what it raised."""
        self._thread.join()
        if self._failure is not None:
            raise self._failure
        return self._outcome[0]

    def _guarded(self) -> None:
        try:
            self._outcome.append(self.work())
        except BaseException as failure:  # noqa: BLE001  (result() raises it where it is awaited)
            self._failure = failure
