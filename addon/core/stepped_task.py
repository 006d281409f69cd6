# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in Python that goes on in steps, each of which may be the last."""

from __future__ import annotations

from typing import TypeVar

from dermis_native import Cancelled

from .background import BackgroundTask

Result = TypeVar("Result")


class SteppedTask(BackgroundTask[Result]):
    """A task that says at every step how far it is, and stops there once it is cancelled."""

    def __init__(self, name: str, stage: str = "") -> None:
        super().__init__(name)
        self._cancelled = False
        self._fraction = 0.0
        self._stage = stage

    def cancel(self) -> None:
        """Ask the thread to stop at its next step."""
        self._cancelled = True

    @property
    def fraction(self) -> float:
        """Share of the work done, 0 to 1."""
        return self._fraction

    @property
    def stage(self) -> str:
        """What is being done now."""
        return self._stage

    def _step(self, fraction: float) -> None:
        """So much is done; raises `dermis_native.Cancelled` when no more is wanted."""
        if self._cancelled:
            raise Cancelled("cancelled")
        self._fraction = min(fraction, 1.0)
