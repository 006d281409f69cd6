# SPDX-License-Identifier: GPL-3.0-or-later
"""Point caches from sampled poses, in a thread of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dermis_native import Cancelled

from .background import BackgroundTask
from .errors import InputError
from .frame_range import FrameRange
from .new_files import NewFiles
from .point_cache import CacheFormat, CacheLayout, CacheWriter
from .skin_frames import PoseSample, SkinFrames


@dataclass(frozen=True)
class CacheOrder:
    """One cache to be written: where, of what, and its poses in order."""

    place: Path
    frames: SkinFrames
    samples: Sequence[PoseSample]


class CacheTask(BackgroundTask[list[int]]):
    """Writes all caches beside their places and then moves them there together; gives their sizes in bytes."""

    def __init__(self, orders: Sequence[CacheOrder], frames: FrameRange, kind: CacheFormat, fps: float) -> None:
        super().__init__("dermis-bake")
        self._orders = tuple(orders)
        self._layouts = [CacheLayout.of_range(kind, len(order.frames.rest), frames, fps) for order in self._orders]
        self._total = sum(len(order.samples) for order in self._orders)
        self._done = 0
        self._cancelled = False
        self._current = ""

    def cancel(self) -> None:
        """Ask the thread to stop soon; nothing is left on disk then."""
        self._cancelled = True

    @property
    def fraction(self) -> float:
        """Share of the samples solved."""
        return self._done / max(self._total, 1)

    @property
    def stage(self) -> str:
        """What is being done now."""
        return f"{self._current}solving frames"

    def work(self) -> list[int]:
        """Solve and write; InputError where the disk does not take it."""
        try:
            with NewFiles() as files:
                for order, layout in zip(self._orders, self._layouts, strict=True):
                    self._write(order, layout, files.add(order.place, layout.total_bytes))
                self._stop_if_cancelled()
                files.commit()
        except OSError as error:
            place = error.filename or self._orders[0].place.parent
            raise InputError(f"'{place}' cannot be written: {error.strerror or error}.") from error
        return [layout.total_bytes for layout in self._layouts]

    def _write(self, order: CacheOrder, layout: CacheLayout, beside: Path) -> None:
        self._current = f"{order.frames.name}: " if len(self._orders) > 1 else ""
        with CacheWriter(beside, layout) as writer:
            for index, sample in enumerate(order.samples):
                self._stop_if_cancelled()
                writer.write(index, order.frames.positions(sample))
                self._done += 1

    def _stop_if_cancelled(self) -> None:
        if self._cancelled:
            raise Cancelled("cancelled")
