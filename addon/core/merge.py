# SPDX-License-Identifier: GPL-3.0-or-later
"""Fits new weights into a target: chosen bones and vertices, mixing, locks, limits, totals of 1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .bones import distances_to_bones
from .character import Bones, BoneWeights, Flags, Floats, Integers, Target
from .errors import InputError, counted
from .influences import limit_influences

# Room below this is rounding of float32 totals, not a share that some bone should get.
SMALLEST_ROOM = 1e-6

OtherGroups = Literal["keep", "scale"]


@dataclass(frozen=True)
class MergeSettings:
    """How new weights meet old ones.

    replace: also vertices that have weights. mix: 0 keeps the old weights, 1 takes the new ones.
    max_influences None means any number. other_groups: whether unlocked bones that are not chosen
    stay bit for bit ("keep") or give way so that the chosen ones get their full weight ("scale").
    """

    replace: bool = True
    mix: float = 1.0
    max_influences: int | None = None
    other_groups: OtherGroups = "keep"


@dataclass(frozen=True)
class Merged:
    """Weights to write: all that the bones `written` (B,) get at the vertices `replaced` (m,)."""

    weights: BoneWeights
    replaced: Integers
    written: Flags
    limited: int


def merge_weights(new: BoneWeights, target: Target, settings: MergeSettings) -> Merged:
    """Fit `new`, in columns of the target's bones, into the target.

    Nothing of a locked bone, of a vertex that is not selected or, with other_groups "keep", of a
    bone that is not chosen is in the result: those stay as they are. Each vertex's weights total 1
    with what stays; where nothing new fits at a vertex, the nearest bone that is not locked takes
    the share, or, with only some bones chosen, the vertex stays as it is. Vertices without any
    weight get of chosen bones what the source gives, which may total less than 1 when some bones
    are not chosen. `max_influences` counts the weights that stay too.
    """
    count = len(target.surface.vertices)
    free = ~target.locked
    chosen = target.chosen & free
    if not chosen.any():
        raise InputError(f"All chosen bone groups of '{target.name}' are locked.")
    partial = bool((free & ~chosen).any())
    written = free if settings.other_groups == "scale" else chosen
    existing = target.existing.where(target.existing.value > 0)
    had = existing.totals(count) > 0
    replaced = target.selected.copy()
    if not settings.replace:
        replaced &= ~had
    if settings.mix <= 0.0:
        replaced[:] = False
    kept = existing.where(~written[existing.bone])
    room = np.clip(1.0 - kept.totals(count), 0.0, 1.0)
    room[room < SMALLEST_ROOM] = 0.0
    fresh = new.where(chosen[new.bone] & replaced[new.vertex] & (new.value > 0))
    total = fresh.totals(count)
    if partial:
        other = existing.where((written & ~chosen)[existing.bone])
        fitted, stays = _fit_chosen(fresh, other, total, room, had)
        replaced &= ~stays
        fitted = fitted.where(replaced[fitted.vertex])
    else:
        fitted = _scaled(fresh, np.divide(room, total, out=np.zeros(count), where=total > 0))
        orphans = np.flatnonzero(replaced & (total <= 0) & (room > 0)).astype(np.int32)
        fitted = _joined(fitted, _nearest_unlocked(orphans, room, target))
    if settings.mix < 1.0:
        old = existing.where(written[existing.bone] & replaced[existing.vertex])
        fitted = _mixed(old, fitted, room, settings.mix, count)
    limited = 0
    if settings.max_influences is not None:
        kept_count = np.bincount(kept.vertex, minlength=count)
        limit = np.maximum(settings.max_influences - kept_count, 1).astype(np.int32)
        limited = int(np.count_nonzero(np.bincount(fitted.vertex, minlength=count) > limit))
        fitted = limit_influences(fitted, limit)
    return Merged(fitted.where(fitted.value > 0), np.flatnonzero(replaced).astype(np.int32), written, limited)


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


def _fit_chosen(
    fresh: BoneWeights, other: BoneWeights, total: Floats, room: Floats, had: Flags
) -> tuple[BoneWeights, Flags]:
    """Chosen bones beside `other` ones that may be scaled, and the vertices (V,) that stay as they are."""
    others = other.totals(len(room))
    # What there is to fill: all the room where totals were 1 before, else no more than the source gives.
    share = np.minimum(total, room)
    filling = had & (others <= 0) & (total > 0)
    share[filling] = room[filling]
    rest = np.divide(room - share, others, out=np.zeros(len(room)), where=others > 0)
    scaled = _scaled(fresh, np.divide(share, total, out=np.zeros(len(room)), where=total > 0))
    stays = (total <= 0) & (others <= 0)
    return _joined(scaled, _scaled(other, rest)), stays


def _mixed(old: BoneWeights, fitted: BoneWeights, room: Floats, mix: float, vertex_count: int) -> BoneWeights:
    """Old weights, scaled to fill the room as the fitted ones do, mixed with them; bare vertices get those alone."""
    totals = old.totals(vertex_count)
    bare = totals <= 0
    # What is too little to fill the room stays so: both parts then total the same.
    goal = np.minimum(fitted.totals(vertex_count), room)
    old = _scaled(old, np.divide((1.0 - mix) * goal, totals, out=np.zeros(vertex_count), where=~bare))
    fitted = _scaled(fitted, np.where(bare, 1.0, mix))
    return _joined(old, fitted).summed()


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


def _scaled(weights: BoneWeights, factor: Floats) -> BoneWeights:
    """Values times their vertex's factor (V,)."""
    return BoneWeights(weights.vertex, weights.bone, (weights.value * factor[weights.vertex]).astype(np.float32))


def _joined(first: BoneWeights, second: BoneWeights) -> BoneWeights:
    return BoneWeights(
        np.concatenate([first.vertex, second.vertex]),
        np.concatenate([first.bone, second.bone]),
        np.concatenate([first.value, second.value]),
    )
