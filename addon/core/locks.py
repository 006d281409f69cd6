# SPDX-License-Identifier: GPL-3.0-or-later
"""Fits new weights into a target whose locked bones keep theirs, with totals of 1."""

from __future__ import annotations

import numpy as np

from .bones import distances_to_bones
from .character import Bones, BoneWeights, Floats, Integers, Target
from .errors import InputError, counted

# Room below this is rounding of float32 totals, not a share that some bone should get.
SMALLEST_ROOM = 1e-6


def merge_weights(
    new: BoneWeights, target: Target, *, max_influences: int | None = None, replace: bool = True
) -> tuple[BoneWeights, Integers]:
    """Weights to write into the unlocked groups, and the vertices (m,) that they replace.

    The columns of `new` are the target's bones. Each vertex's unlocked weights are scaled so that
    they and the locked ones total 1; where nothing unlocked remains, the nearest unlocked bone
    takes the share. `max_influences` counts locked weights too. Without `replace`, vertices that
    have weight on any bone are left alone.
    """
    vertex_count = len(target.surface.vertices)
    if target.locked.all():
        raise InputError(f"All bone groups of '{target.name}' are locked.")
    replaced = np.ones(vertex_count, np.bool_)
    if not replace:
        replaced = target.existing.totals(vertex_count) <= 0.0
    kept = target.existing.where(target.locked[target.existing.bone] & (target.existing.value > 0))
    fresh = new.where(~target.locked[new.bone] & replaced[new.vertex] & (new.value > 0))
    if max_influences is not None:
        kept_count = np.bincount(kept.vertex, minlength=vertex_count)
        fresh = _strongest(fresh, np.maximum(max_influences - kept_count, 1))
    room = np.clip(1.0 - kept.totals(vertex_count), 0.0, 1.0)
    room[room < SMALLEST_ROOM] = 0.0
    total = fresh.totals(vertex_count)
    scale = np.divide(room, total, out=np.zeros(vertex_count), where=total > 0)
    values = (fresh.value * scale[fresh.vertex]).astype(np.float32)
    fresh = BoneWeights(fresh.vertex, fresh.bone, values)
    orphans = np.flatnonzero(replaced & (total <= 0) & (room > 0)).astype(np.int32)
    fresh = _joined(fresh, _nearest_unlocked(orphans, room, target))
    return fresh.where(fresh.value > 0), np.flatnonzero(replaced).astype(np.int32)


def check_totals(name: str, weights: BoneWeights, vertex_count: int) -> None:
    """Raise RuntimeError unless every vertex has weights that are finite, not negative and total 1.

    A wrong result must never reach the scene, whatever made it.
    """
    wrong = np.flatnonzero(~np.isfinite(weights.value) | (weights.value < 0))
    if len(wrong):
        raise RuntimeError(f"Vertex {weights.vertex[wrong[0]]} of '{name}' got an impossible weight.")
    off = np.flatnonzero(np.abs(weights.totals(vertex_count) - 1.0) > 1e-4)
    if len(off):
        vertices = counted(len(off), "vertex", "vertices")
        raise RuntimeError(f"{vertices} of '{name}' got no full weight, the first is vertex {off[0]}.")


def _strongest(weights: BoneWeights, limit: Integers) -> BoneWeights:
    """The `limit` (V,) largest entries of each vertex, the lower bone first among equals."""
    order = np.lexsort((weights.bone, -weights.value, weights.vertex))
    vertex = weights.vertex[order]
    first = np.searchsorted(vertex, vertex)
    rank = np.arange(len(vertex)) - first
    kept = np.sort(order[rank < limit[vertex]])
    return BoneWeights(weights.vertex[kept], weights.bone[kept], weights.value[kept])


def _nearest_unlocked(vertices: Integers, room: Floats, target: Target) -> BoneWeights:
    """The whole room of each of the vertices for its nearest unlocked bone."""
    unlocked = np.flatnonzero(~target.locked)
    free: Bones = target.bones.subset(unlocked.tolist())
    nearest = [
        distances_to_bones(target.surface.vertices[block], free).argmin(axis=1)
        for block in np.array_split(vertices, len(vertices) // 4096 + 1)
    ]
    bone = unlocked[np.concatenate(nearest)].astype(np.int32)
    return BoneWeights(vertices, bone, room[vertices].astype(np.float32))


def _joined(first: BoneWeights, second: BoneWeights) -> BoneWeights:
    return BoneWeights(
        np.concatenate([first.vertex, second.vertex]),
        np.concatenate([first.bone, second.bone]),
        np.concatenate([first.value, second.value]),
    )
