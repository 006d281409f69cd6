# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits how many bones a vertex follows, without jumps between neighbours."""

from __future__ import annotations

import numpy as np

from .character import BoneWeights, Flags, Floats, Integers, Weights

# A weight this many times the largest one that has to go stays as it is.
UNTOUCHED = 2.0


def limit_influences(weights: BoneWeights, limit: Integers) -> BoneWeights:
    """At most `limit` (V,) entries of each vertex, with each vertex's total as before.

    A weight fades to zero as it comes near to the largest one that has to go, so that a vertex
    whose fifth bone overtakes its fourth differs little from its neighbour. Where all that would
    stay are equal to that one, they stay in equal shares, the lower bone first.
    """
    vertex_count = len(limit)
    order, rank = _ranks(weights)
    entry_limit = limit[weights.vertex]
    threshold = np.zeros(vertex_count)
    beyond = order[rank == entry_limit[order]]
    threshold[weights.vertex[beyond]] = weights.value[beyond]
    stays = np.empty(len(weights), np.bool_)
    stays[order] = rank < entry_limit[order]
    above = threshold[weights.vertex]
    ratio = np.divide(weights.value, above, out=np.full(len(weights), UNTOUCHED), where=above > 0)
    faded = np.where(stays, weights.value * np.clip((ratio - 1.0) / (UNTOUCHED - 1.0), 0.0, 1.0), 0.0)
    left = np.bincount(weights.vertex, weights=faded, minlength=vertex_count)
    level = (left <= 0)[weights.vertex]
    faded = np.where(level & stays, weights.value, faded)
    return _with_totals(weights, faded, above > 0, vertex_count)


def _ranks(weights: BoneWeights) -> tuple[Integers, Integers]:
    """Entries by vertex, then from the strongest, the lower bone first among equals; rank in the vertex."""
    order = np.lexsort((weights.bone, -weights.value, weights.vertex)).astype(np.int32)
    vertex = weights.vertex[order]
    return order, (np.arange(len(order)) - np.searchsorted(vertex, vertex)).astype(np.int32)


def _with_totals(weights: BoneWeights, faded: Floats, limited: Flags, vertex_count: int) -> BoneWeights:
    """The entries above zero, scaled to the old totals where anything was limited, else bit for bit as before."""
    before = weights.totals(vertex_count)
    after = np.bincount(weights.vertex, weights=faded, minlength=vertex_count)
    scale = np.divide(before, after, out=np.ones(vertex_count), where=after > 0)
    scaled: Weights = (faded * scale[weights.vertex]).astype(np.float32)
    values = np.where(limited, scaled, weights.value)
    kept = values > 0
    return BoneWeights(weights.vertex[kept], weights.bone[kept], values[kept])
