# SPDX-License-Identifier: GPL-3.0-or-later
"""Point caches: files of vertex positions, sample after sample, in the formats PC2 and MDD.

A sample's place in the file follows from its index alone, so samples may be written in any order
and files of parts of a range can be joined: the bytes are always those of one file written in order.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Literal

import numpy as np

from .character import Weights
from .errors import InputError
from .frame_range import FrameRange

CacheFormat = Literal["PC2", "MDD"]
SUFFIXES: dict[CacheFormat, str] = {"PC2": ".pc2", "MDD": ".mdd"}

# PC2: signature, version, vertices, first frame, frames from one sample to the next, samples; little-endian.
_PC2 = struct.Struct("<12siiffi")
_PC2_SIGNATURE = b"POINTCACHE2\0"
# MDD: samples, vertices; big-endian, like all that follows: the times of the samples in seconds.
_MDD = struct.Struct(">2i")


@dataclass(frozen=True)
class CacheLayout:
    """Head of a cache file: vertices in each sample, and the samples' times (n,) float32.

    Times are frames in PC2 and seconds in MDD.
    """

    format: CacheFormat
    vertex_count: int
    times: Weights
    step: float

    @classmethod
    def of_range(cls, kind: CacheFormat, vertex_count: int, frames: FrameRange, fps: float) -> CacheLayout:
        """Layout of a whole range."""
        places = frames.start + np.arange(len(frames)) / frames.per_frame
        if kind == "MDD":
            return cls(kind, vertex_count, (places / fps).astype(np.float32), 1.0 / frames.per_frame / fps)
        return cls(kind, vertex_count, places.astype(np.float32), 1.0 / frames.per_frame)

    @property
    def head(self) -> bytes:
        """The bytes before the first sample."""
        count = len(self.times)
        if self.format == "MDD":
            return _MDD.pack(count, self.vertex_count) + self.times.astype(">f4").tobytes()
        return _PC2.pack(_PC2_SIGNATURE, 1, self.vertex_count, float(self.times[0]), self.step, count)

    @property
    def sample_bytes(self) -> int:
        """Size of one sample."""
        return 12 * self.vertex_count

    @property
    def total_bytes(self) -> int:
        """Size of the file."""
        return len(self.head) + len(self.times) * self.sample_bytes


class CacheWriter:
    """Writes a cache; leaving the `with` block normally demands that every sample was written."""

    def __init__(self, path: Path, layout: CacheLayout) -> None:
        self._layout = layout
        self._kind = ">f4" if layout.format == "MDD" else "<f4"
        self._written = np.zeros(len(layout.times), np.bool_)
        self._path = path
        self._start = len(layout.head)
        self._file: BinaryIO = path.open("wb")
        self._file.write(layout.head)

    def __enter__(self) -> CacheWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                if not self._written.all():
                    missing = int(np.flatnonzero(~self._written)[0])
                    raise InputError(f"Sample {missing} of '{self._path.name}' was never written.")
                self._file.flush()
                os.fsync(self._file.fileno())
        finally:
            self._file.close()

    def write(self, index: int, positions: Weights) -> None:
        """Put a sample (V,3) in its place."""
        if positions.shape != (self._layout.vertex_count, 3):
            raise InputError(
                f"A sample of '{self._path.name}' has {len(positions)} vertices instead of {self._layout.vertex_count}."
            )
        self._file.seek(self._start + index * self._layout.sample_bytes)
        self._file.write(np.ascontiguousarray(positions, self._kind).tobytes())
        self._written[index] = True


def read_layout(path: Path) -> CacheLayout:
    """Head of a cache file; InputError where it is none or was cut off."""
    with path.open("rb") as file:
        start = file.read(_PC2.size)
        if start.startswith(_PC2_SIGNATURE) and len(start) == _PC2.size:
            _, _, vertices, first, step, count = _PC2.unpack(start)
            times = (first + np.arange(max(count, 0)) * step).astype(np.float32)
            layout = CacheLayout("PC2", vertices, times, step)
        else:
            count, vertices = _MDD.unpack(start[: _MDD.size]) if len(start) >= _MDD.size else (0, 0)
            file.seek(_MDD.size)
            size = path.stat().st_size
            if count < 1 or vertices < 1 or size != _MDD.size + 4 * count + 12 * count * vertices:
                raise InputError(f"'{path.name}' is neither a whole PC2 nor a whole MDD file.")
            times = np.frombuffer(file.read(4 * count), ">f4").astype(np.float32)
            layout = CacheLayout("MDD", vertices, times, float(times[1] - times[0]) if count > 1 else 0.0)
    if len(layout.times) < 1 or layout.vertex_count < 1 or path.stat().st_size != layout.total_bytes:
        raise InputError(f"'{path.name}' is cut off or damaged.")
    return layout


def read_sample(path: Path, layout: CacheLayout, index: int) -> Weights:
    """Positions (V,3) of one sample."""
    with path.open("rb") as file:
        file.seek(len(layout.head) + index * layout.sample_bytes)
        flat = np.frombuffer(file.read(layout.sample_bytes), ">f4" if layout.format == "MDD" else "<f4")
    return flat.astype(np.float32).reshape(-1, 3)


def join_caches(parts: Sequence[Path], target: Path) -> CacheLayout:
    """Join caches of parts of a range, given in any order, into one whose bytes are those of the whole range.

    Parts may share samples, which must then be equal. InputError where they do not fit together.
    """
    if not parts:
        raise InputError("There is no cache to join.")
    layouts = {path: read_layout(path) for path in parts}
    ordered = sorted(parts, key=lambda path: (float(layouts[path].times[0]), -len(layouts[path].times)))
    first = layouts[ordered[0]]
    step = max(layout.step for layout in layouts.values())
    for path in ordered:
        if (layouts[path].format, layouts[path].vertex_count) != (first.format, first.vertex_count):
            raise InputError(f"'{path.name}' has another format or number of vertices than '{ordered[0].name}'.")
    places: dict[int, tuple[Path, int]] = {}
    times: dict[int, float] = {}
    for path in ordered:
        layout = layouts[path]
        if len(layout.times) > 1 and abs(layout.step - step) > 1e-3 * step:
            raise InputError(f"'{path.name}' has another step between its samples than the other parts.")
        for index, time in enumerate(layout.times.tolist()):
            place = 0 if step == 0 else round((time - float(first.times[0])) / step)
            if place in places:
                other, at = places[place]
                if read_sample(path, layout, index).tobytes() != read_sample(other, layouts[other], at).tobytes():
                    raise InputError(f"'{path.name}' and '{other.name}' differ in a sample that both have.")
            places.setdefault(place, (path, index))
            times.setdefault(place, time)
    missing = next((place for place in range(max(places) + 1) if place not in places), None)
    if missing is not None:
        raise InputError(f"The parts leave a gap after '{places[missing - 1][0].name}'.")
    joined = np.array([times[place] for place in range(len(places))], np.float32)
    layout = CacheLayout(first.format, first.vertex_count, joined, step)
    with CacheWriter(target, layout) as writer:
        for place, (path, index) in places.items():
            writer.write(place, read_sample(path, layouts[path], index))
    return layout
