# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrections of sampled poses as offsets of the rest shape, in a thread of its own."""

from __future__ import annotations

from collections.abc import Sequence

from dermis_native import Cancelled

from .background import BackgroundTask
from .character import Weights
from .skin_frames import PoseSample, SkinFrames


class OffsetsTask(BackgroundTask[list[list[Weights]]]):
    """For each object the offsets (V,3) of each of its samples: what a shape key at value 1 has to add."""

    def __init__(self, orders: Sequence[tuple[SkinFrames, Sequence[PoseSample]]]) -> None:
        super().__init__("dermis-offsets")
        self._orders = tuple(orders)
        self._total = sum(len(samples) for _, samples in orders)
        self._done = 0
        self._cancelled = False

    def cancel(self) -> None:
        """Ask the thread to stop soon."""
        self._cancelled = True

    @property
    def fraction(self) -> float:
        """Share of the samples solved."""
        return self._done / max(self._total, 1)

    @property
    def stage(self) -> str:
        """What is being done now."""
        return "solving poses"

    def work(self) -> list[list[Weights]]:
        """Solve one after the other."""
        return [[self._solved(frames, sample) for sample in samples] for frames, samples in self._orders]

    def _solved(self, frames: SkinFrames, sample: PoseSample) -> Weights:
        if self._cancelled:
            raise Cancelled("cancelled")
        self._done += 1
        return frames.acting_offsets(sample)
