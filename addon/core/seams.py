# SPDX-License-Identifier: GPL-3.0-or-later
"""Equal weights where open edges of one or several objects meet, so that seams stay closed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .character import BoneWeights, Flags, Floats, Integers, Surface

# Vertices nearer to each other than this share of the largest extent are at the same place.
COINCIDENT = 1e-6


def open_vertices(surface: Surface) -> Flags:
    """Vertices (V,) at an edge that only one polygon uses, or at no polygon's edge at all."""
    first = surface.loop_indices
    ends = np.cumsum(surface.loop_counts)
    following = np.arange(1, len(first) + 1)
    following[ends - 1] = ends - surface.loop_counts
    second = first[following]
    low, high = np.minimum(first, second).astype(np.int64), np.maximum(first, second).astype(np.int64)
    count = len(surface.vertices)
    edges, uses = np.unique(low * count + high, return_counts=True)
    single = edges[uses == 1]
    marked = np.ones(count, np.bool_)
    marked[first] = False
    marked[single // count] = True
    marked[single % count] = True
    return marked


def coincident(points: Floats, tolerance: float) -> Integers:
    """Label (n,) of each point (n,3), equal where points are within the tolerance, chains included.

    The tolerance is at least COINCIDENT times the extent of the points.
    """
    places = []
    low = points.min(axis=0)
    # Two points within the tolerance share a cell of one of these grids of twice its width.
    for shift in range(8):
        offset = np.array([(shift >> axis) & 1 for axis in range(3)]) * tolerance
        cell = np.floor((points - low + offset) / (2.0 * tolerance)).astype(np.int64)
        width = cell.max(axis=0) + 1
        # At most (0.5 / COINCIDENT + 2)³ cells, which 64 bits hold.
        key = (cell[:, 0] * width[1] + cell[:, 1]) * width[2] + cell[:, 2]
        places.append(np.unique(key, return_inverse=True)[1])
    label = np.arange(len(points))
    while True:
        before = label
        for place in places:
            least = np.full(len(points), len(points))
            np.minimum.at(least, place, label)
            label = least[place]
        if (label == before).all():
            return label.astype(np.int32)


def close_seams(
    surfaces: Sequence[Surface], weights: Sequence[BoneWeights], bone_names: Sequence[Sequence[str]]
) -> tuple[list[BoneWeights], list[int]]:
    """Weights with the mean of all where open vertices coincide, and how many vertices of each object that are.

    Bones of several objects are the same where their names are. Other vertices keep their weights
    bit for bit.
    """
    opened = [np.flatnonzero(open_vertices(surface)) for surface in surfaces]
    owner = np.repeat(np.arange(len(surfaces)), [len(vertices) for vertices in opened])
    vertex = np.concatenate(opened)
    points = np.concatenate([surface.vertices[v] for surface, v in zip(surfaces, opened, strict=True)])
    if len(points) < 2:
        return list(weights), [0] * len(weights)
    extent = float(np.ptp(np.concatenate([surface.vertices for surface in surfaces]), axis=0).max())
    label = coincident(points, max(COINCIDENT * extent, float(np.finfo(np.float32).tiny)))
    uses = np.bincount(label, minlength=len(points))
    shared = uses[label] > 1
    if not shared.any():
        return list(weights), [0] * len(weights)
    names = sorted({name for some in bone_names for name in some})
    column = {name: i for i, name in enumerate(names)}
    place, group = np.unique(label[shared], return_inverse=True)
    columns = [np.array([column[name] for name in some], np.int32) for some in bone_names]
    seams = []
    parts = []
    for index, (surface, some) in enumerate(zip(surfaces, weights, strict=True)):
        seam = np.full(len(surface.vertices), -1, np.int32)
        mine = owner[shared] == index
        seam[vertex[shared][mine]] = group[mine]
        seams.append(seam)
        entry = seam[some.vertex] >= 0
        parts.append(BoneWeights(seam[some.vertex[entry]], columns[index][some.bone[entry]], some.value[entry]))
    means = _mean(parts, np.bincount(group, minlength=len(place)))
    closed = [_replaced(some, seam, means, own) for some, seam, own in zip(weights, seams, columns, strict=True)]
    return closed, [int(np.count_nonzero(seam >= 0)) for seam in seams]


def _mean(parts: Sequence[BoneWeights], uses: Integers) -> BoneWeights:
    """Mean weights of each seam, in the place of vertices."""
    both = BoneWeights(
        np.concatenate([part.vertex for part in parts]),
        np.concatenate([part.bone for part in parts]),
        np.concatenate([part.value for part in parts]),
    ).summed()
    return BoneWeights(both.vertex, both.bone, (both.value / uses[both.vertex]).astype(np.float32))


def _replaced(weights: BoneWeights, seam: Integers, means: BoneWeights, own: Integers) -> BoneWeights:
    """The weights with the mean at each vertex that is of a seam (V,), -1 at others.

    `own` are the object's bones among those of all objects; what it lacks, it cannot get.
    """
    rest = weights.where(seam[weights.vertex] < 0)
    vertices = np.flatnonzero(seam >= 0).astype(np.int32)
    first = np.searchsorted(means.vertex, seam[vertices])
    count = np.searchsorted(means.vertex, seam[vertices], side="right") - first
    entry = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
    bone_of = np.full(int(max(means.bone.max(initial=-1), own.max(initial=-1))) + 1, -1, np.int32)
    bone_of[own] = np.arange(len(own), dtype=np.int32)
    new = BoneWeights(np.repeat(vertices, count), bone_of[means.bone[entry]], means.value[entry])
    new = new.where(new.bone >= 0)
    return BoneWeights(
        np.concatenate([rest.vertex, new.vertex]),
        np.concatenate([rest.bone, new.bone]),
        np.concatenate([rest.value, new.value]),
    )
