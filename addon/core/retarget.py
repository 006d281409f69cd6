# SPDX-License-Identifier: GPL-3.0-or-later
"""One call of the native retargeting (Algorithm 2) for a source and a target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from dermis_native import (
    Cancelled,
    DermisError,
    Progress,
    RetargetResult,
    Skeleton,
    SkinWeights,
    TriangleMesh,
    retarget_weights,
)

from .bones import BonePairs, pair_bones
from .character import Bones, BoneWeights, Integers, Source, Surface, Target
from .errors import InputError
from .locks import check_totals, merge_weights

Method = Literal["auto", "paper"]


@dataclass(frozen=True)
class RetargetSettings:
    """How weights are retargeted; max_influences None means any number."""

    method: Method = "auto"
    max_influences: int | None = None
    eigenpairs: int = 100
    replace: bool = True


@dataclass(frozen=True)
class TargetWeights:
    """What one target gets.

    Columns of `weights` are the target's bones; `replaced` (m,) are the vertices that it holds
    for; `groups` are the bones that must have a group; matched and filled count the replaced
    vertices by how their weights were found; influences is the most that one vertex has.
    """

    weights: BoneWeights
    replaced: Integers
    groups: tuple[int, ...]
    only_in_target: tuple[str, ...]
    matched: int
    filled: int
    landmarks: int
    influences: int


def check_source(source: Source) -> None:
    """Raise InputError when the source has nothing to give."""
    source.surface.check(source.name)
    source.bones.check(source.armature)
    if not (source.weights.value > 0).any():
        raise InputError(f"No vertex of '{source.name}' has weight on a bone of '{source.armature}'.")
    if not np.isfinite(source.weights.value).all():
        vertex = source.weights.vertex[~np.isfinite(source.weights.value)][0]
        raise InputError(f"'{source.name}' has a weight that is not finite at vertex {vertex}.")


def check_target(source: Source, target: Target) -> BonePairs:
    """Raise InputError when the target cannot be given weights; return the pairs of bones."""
    target.surface.check(target.name)
    target.bones.check(target.armature)
    if target.locked.all():
        raise InputError(f"All bone groups of '{target.name}' are locked.")
    if target.landmarks is not None:
        _check_landmarks(source, target, target.landmarks)
    return pair_bones(source, target)


def retarget(source: Source, target: Target, settings: RetargetSettings, progress: Progress) -> TargetWeights:
    """Retarget the weights of `source` to `target`.

    Raises InputError when the characters cannot be matched, and `dermis_native.Cancelled` soon
    after `progress.cancel()`.
    """
    check_source(source)
    pairs = check_target(source, target)
    try:
        found = retarget_weights(
            _native_mesh(source.name, source.surface),
            _source_weights(source, pairs),
            _native_mesh(target.name, target.surface),
            source_skeleton=_native_skeleton(source.bones.subset(pairs.source)),
            target_skeleton=_native_skeleton(target.bones.subset(pairs.target)),
            landmarks=target.landmarks,
            method=settings.method,
            max_influences=settings.max_influences,
            eigenpairs=settings.eigenpairs,
            progress=progress,
        )
    except (Cancelled, InputError):
        raise
    except (DermisError, ValueError) as error:
        raise InputError(f"'{target.name}' cannot be given the weights of '{source.name}': {_plain(error)}.") from error
    return _merged(target, pairs, found, settings)


def _merged(target: Target, pairs: BonePairs, found: RetargetResult, settings: RetargetSettings) -> TargetWeights:
    vertex, column, value = found.weights.to_triplets()
    bone = np.asarray(pairs.target, np.int32)[column.astype(np.intp)]
    new = BoneWeights(vertex.astype(np.int32), bone, value)
    check_totals(target.name, new, len(target.surface.vertices))
    weights, replaced = merge_weights(new, target, max_influences=settings.max_influences, replace=settings.replace)
    matched = int(np.count_nonzero(found.matched[replaced]))
    influences = np.bincount(weights.vertex, minlength=1)
    return TargetWeights(
        weights=weights,
        replaced=replaced,
        groups=pairs.target,
        only_in_target=pairs.only_in_target,
        matched=matched,
        filled=len(replaced) - matched,
        landmarks=len(found.landmarks),
        influences=int(influences.max()),
    )


def _source_weights(source: Source, pairs: BonePairs) -> SkinWeights:
    """The source's weights, columns in the order of the pairs, rows scaled to a total of 1."""
    column = np.full(len(source.bones), -1, np.int32)
    column[list(pairs.source)] = np.arange(len(pairs.source), dtype=np.int32)
    kept = source.weights.where(column[source.weights.bone] >= 0)
    return SkinWeights.from_triplets(
        kept.vertex, column[kept.bone], kept.value, len(source.surface.vertices), len(pairs.source)
    ).normalized()


def _native_mesh(name: str, surface: Surface) -> TriangleMesh:
    try:
        return TriangleMesh.from_polygons(surface.vertices, surface.loop_counts, surface.loop_indices)
    except (DermisError, ValueError) as error:
        raise InputError(f"The surface of '{name}' cannot be used: {_plain(error)}.") from error


def _plain(error: Exception) -> str:
    """The error's message as the end of a sentence."""
    return str(error).strip().rstrip(".")


def _native_skeleton(bones: Bones) -> Skeleton:
    return Skeleton(bones.heads, bones.tails, bones.parents, list(bones.names))


def _check_landmarks(source: Source, target: Target, landmarks: npt.NDArray[np.int64]) -> None:
    for side, name, count in (
        (0, source.name, len(source.surface.vertices)),
        (1, target.name, len(target.surface.vertices)),
    ):
        column = landmarks[:, side]
        bad = np.flatnonzero((column < 0) | (column >= count))
        if len(bad):
            raise InputError(
                f"Landmark {bad[0] + 1} names vertex {column[bad[0]]} of '{name}', which has {count:,} vertices."
            )
        unique, uses = np.unique(column, return_counts=True)
        if (uses > 1).any():
            raise InputError(f"Two landmarks name the same vertex {unique[uses > 1][0]} of '{name}'.")
