# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in a thread of its own, watched and cancelled from the thread that started it."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

Result = TypeVar("Result")


class BackgroundTask(Generic[Result]):
    """Subclasses do the work in `work`, which touches nothing but arrays, and say how far it is."""

    def __init__(self, name: str) -> None:
        self._outcome: list[Result] = []
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._guarded, name=name, daemon=True)

    def work(self) -> Result:
        """Do the work in the thread that calls."""
        raise NotImplementedError

    def cancel(self) -> None:
        """Ask the thread to stop soon; `result` then raises `dermis_native.Cancelled`."""
        raise NotImplementedError

    def start(self) -> None:
        """Begin; call once."""
        self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Wait at most so long; true when the thread has ended."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

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
