# SPDX-License-Identifier: GPL-3.0-or-later
"""Point caches from sampled poses, in a thread of its own."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

from .cluster import Cluster
from .errors import InputError
from .frame_range import FrameRange
from .new_files import NewFiles
from .point_cache import CacheFormat, CacheLayout, CacheWriter
from .skin_frames import PoseSample, SkinFrames
from .stepped_task import SteppedTask


@dataclass(frozen=True)
class CacheOrder:
    """One cache to be written: where, of what, and its poses in order."""

    place: Path
    frames: SkinFrames
    samples: Sequence[PoseSample]


class CacheTask(SteppedTask[list[int]]):
    """Writes all caches beside their places and then moves them there together; gives their sizes in bytes.

    Cancelled, it leaves nothing on disk.
    """

    def __init__(
        self, orders: Sequence[CacheOrder], frames: FrameRange, kind: CacheFormat, fps: float, scheduler: str = ""
    ) -> None:
        """`scheduler` is the address of a Dask scheduler whose workers solve; empty, this process does."""
        super().__init__("dermis-bake", "solving frames")
        self._orders = tuple(orders)
        self._layouts = [CacheLayout.of_range(kind, len(order.frames.rest), frames, fps) for order in self._orders]
        self._total = sum(len(order.samples) for order in self._orders)
        self._scheduler = scheduler
        self._done = 0

    def work(self) -> list[int]:
        """Solve and write; InputError where the disk does not take it."""
        try:
            with Cluster(self._scheduler) if self._scheduler else nullcontext() as cluster, NewFiles() as files:
                for order, layout in zip(self._orders, self._layouts, strict=True):
                    self._write(order, layout, files.add(order.place, layout.total_bytes), cluster)
                self._step(1.0)
                files.commit()
        except OSError as error:
            place = error.filename or self._orders[0].place.parent
            raise InputError(f"'{place}' cannot be written: {error.strerror or error}.") from error
        return [layout.total_bytes for layout in self._layouts]

    def _write(self, order: CacheOrder, layout: CacheLayout, beside: Path, cluster: Cluster | None) -> None:
        self._stage = f"{order.frames.name}: solving frames" if len(self._orders) > 1 else "solving frames"
        with CacheWriter(beside, layout) as writer:
            solved = (
                ((index, order.frames.positions(sample)) for index, sample in enumerate(order.samples))
                if cluster is None
                else cluster.solved(order.frames, order.samples, self._stop)
            )
            self._stop()
            with closing(solved):
                for index, positions in solved:
                    writer.write(index, positions)
                    self._done += 1
                    self._stop()

    def _stop(self) -> None:
        self._step(self._done / max(self._total, 1))
