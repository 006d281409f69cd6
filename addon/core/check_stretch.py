# SPDX-License-Identifier: GPL-3.0-or-later
"""Range-of-motion test: how far edges stretch when one joint after the other turns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .character import Bones, BoneWeights, Floats, Integers, Surface

# Edges shorter than this share of the mean one are left aside: their length is noise.
SHORTEST = 1e-3


@dataclass(frozen=True)
class Stretch:
    """Edges (E,2) of the surface, the largest ratio (E,) of each one's length to its length at rest, and the
    joint (E,) that did it, -1 for none.
    """

    edges: Integers
    ratio: Floats
    joint: Integers


def surface_edges(surface: Surface) -> Integers:
    """Each edge of the polygons once (E,2), the lower vertex first."""
    first = surface.loop_indices.astype(np.int64)
    ends = np.cumsum(surface.loop_counts)
    following = np.arange(1, len(first) + 1)
    following[ends - 1] = ends - surface.loop_counts
    second = first[following]
    count = len(surface.vertices)
    key = np.unique(np.minimum(first, second) * count + np.maximum(first, second))
    edges = np.stack([key // count, key % count], axis=1)
    proper: Integers = edges[edges[:, 0] != edges[:, 1]].astype(np.int32)
    return proper


def range_of_motion(
    surface: Surface,
    bones: Bones,
    weights: BoneWeights,
    degrees: float,
    step: Callable[[float], None] = lambda _: None,
) -> Stretch:
    """Turn every joint by ± `degrees` around its bone and two axes across it, one at a time.

    Linear blend skinning (eq. 1) with one joint turned moves a vertex x by s (R - I)(x - h), where
    h is the joint and s the vertex's weight on the bones below it, totals scaled to 1 as the
    Armature modifier does. `step` hears the share of the work done and may raise to end it.
    """
    points = surface.vertices
    edges = surface_edges(surface)
    rest = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    ratio, joint = np.ones(len(edges)), np.full(len(edges), -1, np.int32)
    if not len(edges):
        return Stretch(edges, ratio, joint)
    long_enough = rest > SHORTEST * rest.mean()
    totals = weights.totals(len(points))
    value = weights.value / np.where(totals > 0, totals, 1.0)[weights.vertex]
    below = _below(bones.parents)
    turns = [sign * np.deg2rad(degrees) for sign in (1, -1)]
    for bone in range(len(bones)):
        step(bone / len(bones))
        mine = below[weights.bone, bone]
        share = np.bincount(weights.vertex[mine], weights=value[mine], minlength=len(points))
        # Ends that move alike keep their distance or come nearer.
        moved = np.flatnonzero((np.abs(share[edges[:, 0]] - share[edges[:, 1]]) > 1e-6) & long_enough)
        if not len(moved):
            continue
        ends = edges[moved]
        offsets = points[ends] - bones.heads[bone]
        longest = np.zeros(len(moved))
        for axis in _axes(bones.tails[bone] - bones.heads[bone]):
            for turn in turns:
                displaced = offsets + share[ends][..., None] * (_rotated(offsets, axis, turn) - offsets)
                np.maximum(longest, np.linalg.norm(displaced[:, 0] - displaced[:, 1], axis=1), out=longest)
        stretched = longest / rest[moved]
        larger = stretched > ratio[moved]
        ratio[moved[larger]] = stretched[larger]
        joint[moved[larger]] = bone
    return Stretch(edges, ratio, joint)


def _below(parents: Integers) -> np.typing.NDArray[np.bool_]:
    """Whether bone i is j or below it (B,B)."""
    below = np.eye(len(parents), dtype=np.bool_)
    for bone in range(len(parents)):
        ancestor = int(parents[bone])
        while ancestor >= 0:
            below[bone, ancestor] = True
            ancestor = int(parents[ancestor])
    return below


def _axes(direction: Floats) -> Floats:
    """The bone's direction and two axes across it (3,3)."""
    length = float(np.linalg.norm(direction))
    along = direction / length if length > 0 else np.array([0.0, 1.0, 0.0])
    across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    across /= np.linalg.norm(across)
    return np.stack([along, across, np.cross(along, across)])


def _rotated(vectors: Floats, axis: Floats, angle: float) -> Floats:
    """Vectors (...,3) turned around a unit axis (Rodrigues)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    along = (vectors @ axis)[..., None] * axis
    turned: Floats = vectors * cosine + np.cross(axis, vectors) * sine + along * (1.0 - cosine)
    return turned
