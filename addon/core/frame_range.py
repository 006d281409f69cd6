# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames and subframes at which something is sampled."""

from __future__ import annotations

from dataclasses import dataclass

from .errors import InputError


@dataclass(frozen=True)
class FrameRange:
    """From frame `start` to frame `end`, both included, with `per_frame` samples from one frame to the next."""

    start: int
    end: int
    per_frame: int = 1

    def __post_init__(self) -> None:
        if self.end < self.start:
            raise InputError(f"The last frame, {self.end}, lies before the first one, {self.start}.")
        if self.per_frame < 1:
            raise InputError(f"{self.per_frame} samples per frame are too few: give at least 1.")

    def __len__(self) -> int:
        return (self.end - self.start) * self.per_frame + 1

    def place(self, index: int) -> tuple[int, float]:
        """Frame and subframe of a sample."""
        whole, part = divmod(index, self.per_frame)
        return self.start + whole, part / self.per_frame


@dataclass(frozen=True)
class FrameList:
    """Chosen frames and subframes, in order."""

    places: tuple[tuple[int, float], ...]

    @classmethod
    def spread(cls, frames: FrameRange, most: int) -> FrameList:
        """At most so many of a range's samples, evenly spread, its ends included."""
        count = len(frames)
        chosen = range(count) if count <= most else (round(i * (count - 1) / (most - 1)) for i in range(most))
        return cls(tuple(frames.place(index) for index in chosen))

    def __len__(self) -> int:
        return len(self.places)

    def place(self, index: int) -> tuple[int, float]:
        """Frame and subframe of a sample."""
        return self.places[index]
