# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrections of sampled poses as offsets of the rest shape, in a thread of its own."""

from __future__ import annotations

from collections.abc import Sequence

from .character import Weights
from .skin_frames import PoseSample, SkinFrames
from .stepped_task import SteppedTask


class OffsetsTask(SteppedTask[list[list[Weights]]]):
    """For each object the offsets (V,3) of each of its samples: what a shape key at value 1 has to add."""

    def __init__(self, orders: Sequence[tuple[SkinFrames, Sequence[PoseSample]]]) -> None:
        super().__init__("dermis-offsets", "solving poses")
        self._orders = tuple(orders)
        self._total = sum(len(samples) for _, samples in orders)
        self._done = 0

    def work(self) -> list[list[Weights]]:
        """Solve one after the other."""
        return [[self._solved(frames, sample) for sample in samples] for frames, samples in self._orders]

    def _solved(self, frames: SkinFrames, sample: PoseSample) -> Weights:
        self._step(self._done / self._total)
        self._done += 1
        return frames.acting_offsets(sample)
