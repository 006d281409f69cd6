# SPDX-License-Identifier: GPL-3.0-or-later
"""Loose parts of a mesh, and whether their weights move them as one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dermis_native import DermisError, TriangleMesh

from .character import BoneWeights, Floats, Integers, Surface
from .errors import InputError

# Weights that differ less than this from the part's mean move it as one.
RIGID_TOLERANCE = 0.01


@dataclass(frozen=True)
class LooseParts:
    """Connected parts of a mesh: `part` (V,) of each vertex, numbered from the largest; sizes (P,);
    rigid (P,) where all vertices of a part have the same weights.
    """

    part: Integers
    sizes: Integers
    rigid: np.typing.NDArray[np.bool_]


def loose_parts(name: str, surface: Surface, weights: BoneWeights) -> LooseParts:
    """The parts of the surface, the largest first, of equal ones that with the lowest vertex."""
    try:
        mesh = TriangleMesh.from_polygons(surface.vertices, surface.loop_counts, surface.loop_indices)
    except (DermisError, ValueError) as error:
        raise InputError(f"The surface of '{name}' cannot be used: {str(error).rstrip('.')}.") from error
    component = mesh.components.astype(np.int64)
    sizes = np.bincount(component)
    order = np.argsort(-sizes, kind="stable")
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    part = rank[component]
    return LooseParts(part, sizes[order].astype(np.int32), _spread(part, sizes[order], weights) < RIGID_TOLERANCE)


def _spread(part: Integers, sizes: Integers, weights: BoneWeights) -> Floats:
    """The largest difference (P,) of a weight in each part from the part's mean of that bone."""
    both = BoneWeights(part[weights.vertex], weights.bone, weights.value).summed()
    count = int(weights.bone.max(initial=0)) + 1
    key = both.vertex.astype(np.int64) * count + both.bone
    mean = both.value / sizes[both.vertex]
    place = np.searchsorted(key, part[weights.vertex].astype(np.int64) * count + weights.bone)
    spread = np.zeros(len(sizes))
    np.maximum.at(spread, part[weights.vertex], np.abs(weights.value - mean[place]))
    # A vertex that is not on a bone at all differs from the mean by the mean.
    have = np.bincount(place, minlength=len(key))
    missing = have < sizes[both.vertex]
    np.maximum.at(spread, both.vertex[missing], mean[missing])
    return spread
