# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in a thread of its own, watched and cancelled from the thread that started it.

The native module looks between its steps whether it should stop, and a single step can take seconds. What
is not wanted any more is therefore abandoned: nobody waits for it or takes its result, and `end_all` joins
it before the add-on or the process goes.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Generic, TypeVar

from dermis_native import Cancelled

# How often the thread that waits looks at the working one.
POLL_SECONDS = 0.05

Result = TypeVar("Result")

# What may still run: threads, and how to ask each to stop.
_running: dict[threading.Thread, Callable[[], None]] = {}


class Watched(ABC, Generic[Result]):
    """Long work as whoever waits for it sees it."""

    @property
    @abstractmethod
    def fraction(self) -> float:
        """Share of the work done, 0 to 1."""

    @property
    @abstractmethod
    def stage(self) -> str:
        """What is being done now, for a status bar."""

    @abstractmethod
    def start(self) -> None:
        """Begin; call once."""

    @abstractmethod
    def wait(self, seconds: float) -> bool:
        """Wait at most about so long; true when the work has ended."""

    @abstractmethod
    def cancel(self) -> None:
        """Ask the work to stop soon; `result` then raises `dermis_native.Cancelled`."""

    @abstractmethod
    def abandon(self) -> None:
        """Leave the work to end by itself: it is asked to stop, and what it gives is dropped."""

    @abstractmethod
    def result(self) -> Result:
        """What the work gave, after it has ended; raises what it raised, or that it was abandoned."""

    def run(self, show_progress: Callable[[float], None]) -> None:
        """Work to the end; the thread that calls stays able to be interrupted."""
        self.start()
        try:
            while not self.wait(POLL_SECONDS):
                show_progress(self.fraction)
        except BaseException:
            self.cancel()
            raise


class BackgroundTask(Watched[Result]):
    """Subclasses do the work in `work`, which touches nothing but arrays, and say how far it is."""

    def __init__(self, name: str) -> None:
        self._outcome: list[Result] = []
        self._failure: BaseException | None = None
        self._abandoned = False
        # Python waits for it at its end: a native call must not outlive the interpreter.
        self._thread = threading.Thread(target=self._guarded, name=name, daemon=False)

    @abstractmethod
    def work(self) -> Result:
        """Do the work in the thread that calls."""

    def start(self) -> None:
        """Begin; call once."""
        _running[self._thread] = self.cancel
        try:
            self._thread.start()
        except RuntimeError:
            del _running[self._thread]
            raise

    def abandon(self) -> None:
        """Leave the work to end by itself: it is asked to stop, and what it gives is dropped."""
        self.cancel()
        self._abandoned = True

    def wait(self, seconds: float) -> bool:
        """Wait at most so long; true when the thread has ended."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def result(self) -> Result:
        """What `work` gave, after the thread has ended; raises what it raised, or that it was abandoned."""
        if self._abandoned:
            raise Cancelled("abandoned")
        self._thread.join()
        if self._failure is not None:
            raise self._failure
        return self._outcome[0]

    def _guarded(self) -> None:
        try:
            outcome = self.work()
            if not self._abandoned:
                self._outcome.append(outcome)
        except BaseException as failure:  # noqa: BLE001  (result() raises it where it is awaited)
            self._failure = failure
        finally:
            _running.pop(self._thread, None)


def end_all() -> None:
    """Ask all work that still runs to stop, and wait until it has."""
    left = dict(_running)
    for cancel in left.values():
        cancel()
    for thread in left:
        thread.join()
