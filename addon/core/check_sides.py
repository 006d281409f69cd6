# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices of one side of the body that follow bones of the other side."""

from __future__ import annotations

import numpy as np

from .character import Bones, BoneWeights, Flags, Floats
from .sides import MIDDLE, bone_sides, symmetry_plane

# A vertex may follow the other side's bone up to this share of the bone's own distance from the middle:
# a thigh reaches over the crotch, but not to the other thigh.
REACH = 0.5
# Less weight than this on the other side is not worth a look.
LEAST_WEIGHT = 0.1


def wrong_sides(points: Floats, bones: Bones, weights: BoneWeights) -> Flags | None:
    """Vertices (V,) whose weight on bones of the other side exceeds LEAST_WEIGHT; None where no side is known.

    Sides are those of the names; bones that stand on the other side than their name says are left
    aside.
    """
    plane = symmetry_plane(bones)
    if plane is None:
        return None
    sides = bone_sides(bones.names)
    offsets = plane.heights((bones.heads + bones.tails) / 2)
    sided = (sides != MIDDLE) & (sides * offsets > 0)
    heights = plane.heights(points)
    bone = weights.bone
    across = sided[bone] & (-sides[bone] * heights[weights.vertex] > REACH * np.abs(offsets[bone]))
    total = np.bincount(weights.vertex[across], weights=weights.value[across], minlength=len(points))
    wrong: Flags = total > LEAST_WEIGHT
    return wrong
