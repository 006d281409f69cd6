# SPDX-License-Identifier: GPL-3.0-or-later
"""Retargeting in a thread of its own, watched and cancelled from the thread that started it."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from dermis_native import Cancelled, Progress

from .character import Source, Target
from .retarget import RetargetSettings, TargetWeights, check_source, check_target, retarget


class RetargetTask:
    """Retargets one source to several targets, one after the other.

    Bad input raises at once, in the constructor. The thread touches nothing but its arrays.
    """

    def __init__(self, source: Source, targets: Sequence[Target], settings: RetargetSettings) -> None:
        check_source(source)
        for target in targets:
            check_target(source, target)
        self._source = source
        self._targets = tuple(targets)
        self._settings = settings
        self._progress = [Progress() for _ in self._targets]
        self._results: list[TargetWeights] = []
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="dermis-retarget", daemon=True)

    def start(self) -> None:
        """Begin; call once."""
        self._thread.start()

    def cancel(self) -> None:
        """Ask the thread to stop soon; `result` then raises `dermis_native.Cancelled`."""
        for progress in self._progress:
            progress.cancel()

    def wait(self, seconds: float) -> bool:
        """Wait at most so long; true when the thread has ended."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    @property
    def fraction(self) -> float:
        """Share of the work done, 0 to 1."""
        return sum(progress.fraction for progress in self._progress) / max(len(self._progress), 1)

    @property
    def stage(self) -> str:
        """What is being done now."""
        current = min(len(self._results), len(self._targets) - 1)
        stage = self._progress[current].stage
        prefix = f"{self._targets[current].name}: " if len(self._targets) > 1 else ""
        return prefix + stage

    def result(self) -> list[TargetWeights]:
        """One result for each target, after the thread has ended; raises what it raised."""
        self._thread.join()
        if self._failure is not None:
            raise self._failure
        return self._results

    def _work(self) -> None:
        try:
            for target, progress in zip(self._targets, self._progress, strict=True):
                if progress.cancelled:
                    raise Cancelled("cancelled")
                self._results.append(retarget(self._source, target, self._settings, progress))
        except BaseException as failure:  # noqa: BLE001  (result() raises it where it is awaited)
            self._failure = failure
