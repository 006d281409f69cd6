# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices at open edges whose neighbours at the same place have other weights: the seam opens in a pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .character import BoneWeights, Flags, Surface
from .seams import close_seams

# A sum of differences up to this is rounding, not a gap.
TOLERANCE = 1e-3


def open_seams(
    surfaces: Sequence[Surface], weights: Sequence[BoneWeights], bone_names: Sequence[Sequence[str]]
) -> list[Flags]:
    """Vertices (V,) of each mesh that differ from the mean weights at their place."""
    closed, counts = close_seams(surfaces, weights, bone_names)
    found = []
    for surface, own, mean, count in zip(surfaces, weights, closed, counts, strict=True):
        differences = np.zeros(len(surface.vertices))
        if count:
            both = BoneWeights(
                np.concatenate([own.vertex, mean.vertex]),
                np.concatenate([own.bone, mean.bone]),
                np.concatenate([own.value, -mean.value]),
            ).summed()
            np.add.at(differences, both.vertex, np.abs(both.value))
        found.append(np.asarray(differences > TOLERANCE, np.bool_))
    return found
