# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a skin from sampled poses alone: what a live skin shows, without Blender.

A frame is a function of its pose, so samples can be worked through in any order, in any thread or
process, and give the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from .character import Floats, Weights
from .skin import Skin

SolverPoints = npt.NDArray[Any]  # (V,3) float32


@dataclass(frozen=True)
class PoseSample:
    """What a skin depends on in one frame.

    transforms (B,4,4) float32 are those of the solver; values maps the other shape keys that act to
    their values; influence is the skin's own. While not `deformed`, the Armature modifier is hidden.
    """

    transforms: npt.NDArray[Any]
    values: dict[str, float] = field(default_factory=dict)
    influence: float = 1.0
    deformed: bool = True


@dataclass(frozen=True)
class SkinFrames:
    """A skin with everything that stands between its solver and the mesh.

    rest (V,3) float32 are the object's vertices; to_solver and to_object (3,3) turn its axes into the
    solver's and back, None where they are the same. shape_keys holds the offsets (V,3) float64 of the
    other shape keys by name in their order; shares (V,) the Armature modifier's mask, mask (V,) the
    skin's own.
    """

    name: str
    skin: Skin
    rest: Weights
    to_solver: Floats | None = None
    to_object: Floats | None = None
    shape_keys: dict[str, Floats] = field(default_factory=dict)
    shares: Weights | None = None
    mask: Weights | None = None

    def mixed(self, sample: PoseSample) -> Floats | None:
        """The vertices (V,3) that the other shape keys make, None where none acts."""
        mix: Floats | None = None
        for name, offsets in self.shape_keys.items():
            value = sample.values.get(name, 0.0)
            if value:
                mix = (self.rest.astype(np.float64) if mix is None else mix) + value * offsets
        return mix

    def offsets(self, sample: PoseSample) -> Weights:
        """What the skin's shape key adds (V,3) in the object's space, before its value and its mask."""
        mix = self.mixed(sample)
        return self._in_object(self._solved_offsets(sample, None if mix is None else self._in_solver(mix)))

    def acting_offsets(self, sample: PoseSample) -> Weights:
        """What the skin's shape key adds (V,3) in the object's space, at its value and behind its mask."""
        if not sample.deformed or not sample.influence:
            return np.zeros_like(self.rest)
        offsets = np.float32(sample.influence) * self.offsets(sample)
        return offsets if self.mask is None else offsets * self.mask[:, None]

    def positions(self, sample: PoseSample) -> Weights:
        """What the Armature modifier shows (V,3) in the object's space, the skin's key included."""
        mix = self.mixed(sample)
        if not sample.deformed:
            return self.rest if mix is None else mix.astype(np.float32)
        vertices = None if mix is None else self._in_solver(mix)
        shape = self._in_solver(self.rest.astype(np.float64)) if vertices is None else vertices
        if sample.influence:
            offsets = np.float32(sample.influence) * self._solved_offsets(sample, vertices)
            shape = shape + (offsets if self.mask is None else offsets * self.mask[:, None])
        return self._in_object(self._skinned(sample, shape))

    def with_offsets(self, sample: PoseSample, offsets: Floats | Weights) -> Weights:
        """What the Armature modifier shows (V,3) where the shape is moved by offsets (V,3) of the object's space."""
        mix = self.mixed(sample)
        shape = (self.rest if mix is None else mix) + offsets
        return self._in_object(self._skinned(sample, self._in_solver(shape.astype(np.float64))))

    def _solved_offsets(self, sample: PoseSample, vertices: SolverPoints | None) -> Weights:
        return self.skin.correction(sample.transforms, vertices, self.shares).offsets

    def _skinned(self, sample: PoseSample, shape: SolverPoints) -> Weights:
        posed = self.skin.plain(sample.transforms, shape)
        if self.shares is None:
            return posed
        return (shape + self.shares[:, None] * (posed - shape)).astype(np.float32)

    def _in_solver(self, points: Floats) -> SolverPoints:
        return (points if self.to_solver is None else points @ self.to_solver.T).astype(np.float32)

    def _in_object(self, points: Weights) -> Weights:
        if self.to_object is None:
            return points
        return (points.astype(np.float64) @ self.to_object.T).astype(np.float32)
