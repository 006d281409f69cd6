# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights that no skin can use well: missing ones, totals other than 1, too many."""

from __future__ import annotations

import numpy as np

from .character import BoneWeights, Flags

# Rounding of a total of 1, as files and engines keep it.
TOTAL_TOLERANCE = 1e-3


def unweighted(weights: BoneWeights, vertex_count: int) -> Flags:
    """Vertices (V,) without weight on any bone: they stay behind when the character moves."""
    return weights.totals(vertex_count) <= 0.0


def wrong_totals(weights: BoneWeights, vertex_count: int) -> Flags:
    """Vertices (V,) that have weights which total more or less than 1."""
    totals = weights.totals(vertex_count)
    wrong: Flags = (totals > 0.0) & (np.abs(totals - 1.0) > TOTAL_TOLERANCE)
    return wrong


def too_many(weights: BoneWeights, vertex_count: int, limit: int) -> Flags:
    """Vertices (V,) that follow more than `limit` bones."""
    counts = np.bincount(weights.vertex[weights.value > 0], minlength=vertex_count)
    return np.asarray(counts > limit, np.bool_)
