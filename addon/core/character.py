# SPDX-License-Identifier: GPL-3.0-or-later
"""A character as arrays: surface, bones, weights. All positions are in world space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from .errors import InputError, counted, listed

Floats = npt.NDArray[np.float64]
Weights = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int32]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Surface:
    """Polygons over shared vertices.

    vertices (V,3); loop_counts (F,) corners of each polygon; loop_indices (sum of loop_counts,)
    vertex of each corner, polygon after polygon.
    """

    vertices: Floats
    loop_counts: Integers
    loop_indices: Integers

    def check(self, name: str) -> None:
        """Raise InputError when the surface has no polygon or a coordinate that is not finite."""
        count = len(self.vertices)
        if len(self.loop_counts) == 0:
            raise InputError(f"'{name}' has {counted(count, 'vertex', 'vertices')} and no faces.")
        bad = np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))
        if len(bad):
            raise InputError(
                f"'{name}' has coordinates that are not finite at "
                f"{counted(len(bad), 'vertex', 'vertices')}, the first is vertex {bad[0]}."
            )

    def flipped(self) -> Surface:
        """The same polygons with the opposite winding, for a transform that mirrors."""
        ends = np.cumsum(self.loop_counts)
        starts = ends - self.loop_counts
        corner = np.arange(len(self.loop_indices))
        mirrored = np.repeat(starts + ends - 1, self.loop_counts) - corner
        return Surface(self.vertices, self.loop_counts, self.loop_indices[mirrored])


@dataclass(frozen=True)
class Bones:
    """Deforming bones: names (B), heads and tails (B,3), parents (B,) with -1 for a root."""

    names: tuple[str, ...]
    heads: Floats
    tails: Floats
    parents: Integers

    def __len__(self) -> int:
        return len(self.names)

    def check(self, name: str) -> None:
        """Raise InputError when there is no bone, or one has a coordinate that is not finite."""
        if len(self) == 0:
            raise InputError(f"Armature '{name}' has no deforming bone.")
        bad = ~(np.isfinite(self.heads).all(axis=1) & np.isfinite(self.tails).all(axis=1))
        if bad.any():
            names = [self.names[i] for i in np.flatnonzero(bad)]
            raise InputError(f"Armature '{name}' has coordinates that are not finite at {listed(names)}.")

    def subset(self, kept: Sequence[int]) -> Bones:
        """The bones with the indices `kept`, each under its nearest ancestor that is kept too."""
        position = {bone: i for i, bone in enumerate(kept)}
        parents = np.full(len(kept), -1, np.int32)
        for i, bone in enumerate(kept):
            ancestor = int(self.parents[bone])
            while ancestor >= 0 and ancestor not in position:
                ancestor = int(self.parents[ancestor])
            parents[i] = position.get(ancestor, -1)
        index = np.asarray(kept, np.intp)
        return Bones(tuple(self.names[i] for i in kept), self.heads[index], self.tails[index], parents)


@dataclass(frozen=True)
class BoneWeights:
    """Entries (n,) of a sparse matrix: vertex, bone (column of a list of bones), value."""

    vertex: Integers
    bone: Integers
    value: Weights

    @classmethod
    def none(cls) -> BoneWeights:
        """No entry at all."""
        return cls(np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0, np.float32))

    def __len__(self) -> int:
        return len(self.value)

    def totals(self, vertex_count: int) -> Floats:
        """Sum of each vertex's values (V,)."""
        return np.bincount(self.vertex, weights=self.value, minlength=vertex_count).astype(np.float64)

    def where(self, kept: Flags) -> BoneWeights:
        """The entries that `kept` (n,) marks."""
        return BoneWeights(self.vertex[kept], self.bone[kept], self.value[kept])

    def summed(self) -> BoneWeights:
        """One entry for each pair of vertex and bone, by vertex, then bone; repeated ones are added."""
        width = int(self.bone.max(initial=0)) + 1
        key, place = np.unique(self.vertex.astype(np.int64) * width + self.bone, return_inverse=True)
        value = np.bincount(place, weights=self.value, minlength=len(key)).astype(np.float32)
        return BoneWeights((key // width).astype(np.int32), (key % width).astype(np.int32), value)


class BonePair(NamedTuple):
    """A row of a bone list: source bone, target bone or nothing, and how it was found ("user": by hand)."""

    source: str
    target: str
    how: str = "user"


@dataclass(frozen=True)
class Source:
    """The character that gives its weights.

    Columns of `weights` are `bones`; `boneless_groups` are vertex groups that no bone has, the
    columns of `boneless`. `shape` says in which shape it was read.
    """

    name: str
    armature: str
    surface: Surface
    bones: Bones
    weights: BoneWeights
    boneless_groups: tuple[str, ...] = ()
    boneless: BoneWeights = field(default_factory=BoneWeights.none)
    shape: Literal["rest", "pose ignored", "evaluated"] = "rest"


@dataclass(frozen=True)
class Target:
    """The character that gets weights.

    Columns of `existing`, the weights it has now, are `bones`; `locked` (B,) marks the bones
    whose groups must stay as they are. landmarks (k,2) pair a source vertex with a target vertex.
    `only_bones` (B,) and `only_vertices` (V,) restrict what is written, `copied_groups` are the
    source's groups without a bone that are copied too, columns of `copied_existing`; bone_map pairs
    a source bone with each of its target bones, None to have them found. A treatment of loose parts is
    for those with one of `part_vertices` (V,), for all with None.
    """

    name: str
    armature: str
    surface: Surface
    bones: Bones
    existing: BoneWeights
    locked: Flags
    landmarks: npt.NDArray[np.int64] | None = None
    only_bones: Flags | None = None
    only_vertices: Flags | None = None
    part_vertices: Flags | None = None
    copied_groups: tuple[str, ...] = ()
    copied_existing: BoneWeights = field(default_factory=BoneWeights.none)
    bone_map: tuple[BonePair, ...] | None = None

    @property
    def chosen(self) -> Flags:
        """Which bones (B,) get weights, locks left aside."""
        return np.ones(len(self.bones), np.bool_) if self.only_bones is None else self.only_bones

    @property
    def selected(self) -> Flags:
        """Which vertices (V,) get weights."""
        return np.ones(len(self.surface.vertices), np.bool_) if self.only_vertices is None else self.only_vertices
