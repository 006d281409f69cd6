# SPDX-License-Identifier: GPL-3.0-or-later
"""One call of the native retargeting for a source and a target."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from dermis_native import (
    Cancelled,
    DermisError,
    Progress,
    SkinWeights,
    TriangleMesh,
    retarget_weights,
)

from .bones import BoneMapping, map_characters, native_skeleton
from .character import BoneWeights, Flags, Integers, Source, Surface, Target
from .errors import InputError
from .merge import MergeSettings, check_totals, merge_weights
from .mirror import Mirror, blended, left_shares
from .parts import parts_argument, treatments

Method = Literal["auto", "paper"]
PartPolicy = Literal["auto", "rigid", "surface", "match"]

# How a vertex got its weights, in `TargetWeights.status`.
KEPT, MATCHED, FILLED, PART = 0, 1, 2, 3
# The same for each code of `RetargetResult.status`; a closest point that passed no test counts as filled in.
NATIVE_STATUS = np.array([MATCHED, FILLED, PART, FILLED], np.uint8)


@dataclass(frozen=True)
class RetargetSettings:
    """How weights are found and written.

    mirror "flip" uses the source's mirror image, "left" and "right" its left or right side for both
    halves; close_seams gives coincident open-edge vertices of all targets equal weights;
    keep_unmapped keeps the weights of target bones that stand for no source bone, as a lock does; parts is
    the treatment of loose parts.
    """

    method: Method = "auto"
    eigenpairs: int = 100
    mirror: Mirror = "none"
    close_seams: bool = True
    keep_unmapped: bool = False
    parts: PartPolicy = "auto"
    merge: MergeSettings = field(default_factory=MergeSettings)

    @property
    def runs(self) -> int:
        """How many times a target is matched."""
        return 2 if self.mirror in ("left", "right") else 1


@dataclass(frozen=True)
class FoundWeights:
    """What the native module found for every vertex of one target, whatever is chosen to be written.

    Columns of `weights` are the target's bones, of `copied` its copied groups; status (V,); `parts` counts
    the loose parts by their treatment.
    """

    mapping: BoneMapping
    weights: BoneWeights
    copied: BoneWeights
    status: npt.NDArray[np.uint8]
    landmarks: int
    parts: Mapping[str, int]


@dataclass(frozen=True)
class TargetWeights:
    """What one target gets.

    Columns of `weights` are the target's bones; `replaced` (m,) are the vertices and `written` (B,)
    the bones that it holds for; `groups` are the bones that must have a group. Columns of `copied`
    are the target's copied groups. `status` (V,) tells how each vertex's weights were found;
    matched, filled and part count the replaced vertices by it. influences is the most that one vertex
    has, `limited` how many vertices had more; `seams` how many lie at a seam that was closed; `parts`
    how many loose parts were treated in which way.
    """

    weights: BoneWeights
    replaced: Integers
    written: Flags
    groups: tuple[int, ...]
    copied: BoneWeights
    mapping: BoneMapping
    status: npt.NDArray[np.uint8]
    matched: int
    filled: int
    part: int
    landmarks: int
    influences: int
    limited: int
    seams: int = 0
    parts: Mapping[str, int] = field(default_factory=dict)


def check_source(source: Source) -> None:
    """Raise InputError when the source has nothing to give."""
    source.surface.check(source.name)
    source.bones.check(source.armature)
    if not (source.weights.value > 0).any():
        raise InputError(f"No vertex of '{source.name}' has weight on a bone of '{source.armature}'.")
    if not np.isfinite(source.weights.value).all():
        vertex = source.weights.vertex[~np.isfinite(source.weights.value)][0]
        raise InputError(f"'{source.name}' has a weight that is not finite at vertex {vertex}.")


def check_target(source: Source, target: Target) -> BoneMapping:
    """Raise InputError when the target cannot be given weights; return the map of its bones."""
    target.surface.check(target.name)
    target.bones.check(target.armature)
    if target.locked.all():
        raise InputError(f"All bone groups of '{target.name}' are locked.")
    if not (target.chosen & ~target.locked).any():
        raise InputError(f"All chosen bone groups of '{target.name}' are locked.")
    if not target.selected.any():
        raise InputError(f"No vertex of '{target.name}' is selected.")
    if target.landmarks is not None:
        _check_landmarks(source, target, target.landmarks)
    return map_characters(source, target)


def find_weights(source: Source, target: Target, settings: RetargetSettings, progress: Progress) -> FoundWeights:
    """Match the surfaces and find weights for every vertex of `target`.

    Raises InputError when the characters cannot be matched, and `dermis_native.Cancelled` soon
    after `progress.cancel()`.
    """
    check_source(source)
    mapping = check_target(source, target)
    try:
        mesh = _native_mesh(target.name, target.surface)
        found = retarget_weights(
            _native_mesh(source.name, source.surface),
            _source_weights(source),
            mesh,
            source_skeleton=native_skeleton(source.bones),
            target_skeleton=native_skeleton(target.bones),
            bone_map=mapping.native,
            landmarks=target.landmarks,
            method=settings.method,
            parts=parts_argument(mesh, settings.parts, "auto", target.part_vertices),
            eigenpairs=settings.eigenpairs,
            progress=progress,
        )
    except (Cancelled, InputError):
        raise
    except (DermisError, ValueError) as error:
        raise InputError(f"'{target.name}' cannot be given the weights of '{source.name}': {_plain(error)}.") from error
    vertex, bone, value = found.weights.to_triplets()
    new = BoneWeights(vertex.astype(np.int32), bone.astype(np.int32), value)
    check_totals(target.name, new, len(target.surface.vertices))
    return FoundWeights(
        mapping=mapping,
        weights=new,
        copied=_copied(source, target, found.correspondence),
        status=NATIVE_STATUS[found.status],
        landmarks=len(found.landmarks),
        parts=treatments(found),
    )


def two_halves(target: Target, plain: FoundWeights, mirrored: FoundWeights, mirror: Mirror) -> FoundWeights:
    """Both halves of the target from one side of the source: `plain` on that side, `mirrored` on the other."""
    share = left_shares(target) if mirror == "left" else 1.0 - left_shares(target)
    own = share >= 0.5
    return replace(
        plain,
        weights=blended(plain.weights, mirrored.weights, share),
        copied=blended(plain.copied, mirrored.copied, own.astype(np.float64)),
        status=np.where(own, plain.status, mirrored.status).astype(np.uint8),
    )


def fit_weights(target: Target, found: FoundWeights, settings: RetargetSettings, seams: int = 0) -> TargetWeights:
    """What of the found weights is written, beside what stays."""
    if settings.keep_unmapped:
        unmapped = np.ones(len(target.bones), np.bool_)
        unmapped[list(found.mapping.mapped)] = False
        target = replace(target, locked=target.locked | unmapped)
    merged = merge_weights(found.weights, target, settings.merge)
    status = found.status[merged.replaced]
    stays = target.existing.where(~merged.written[target.existing.bone])
    at = np.zeros(len(target.surface.vertices), np.bool_)
    at[merged.replaced] = True
    copied = blended(found.copied, target.copied_existing, np.full(len(at), settings.merge.mix))
    everything = np.concatenate([merged.weights.vertex, stays.vertex[at[stays.vertex] & (stays.value > 0)]])
    # Mapped bones have a group even where no vertex follows them; the others where one does.
    grouped = np.zeros(len(target.bones), np.bool_)
    grouped[list(found.mapping.mapped)] = True
    grouped[merged.weights.bone[merged.weights.value > 0]] = True
    return TargetWeights(
        weights=merged.weights,
        replaced=merged.replaced,
        written=merged.written,
        groups=tuple(np.flatnonzero(grouped & target.chosen & ~target.locked).tolist()),
        copied=copied.where(at[copied.vertex]),
        mapping=found.mapping,
        status=np.where(at, found.status, KEPT).astype(np.uint8),
        matched=int(np.count_nonzero(status == MATCHED)),
        filled=int(np.count_nonzero(status == FILLED)),
        part=int(np.count_nonzero(status == PART)),
        landmarks=found.landmarks,
        influences=int(np.bincount(everything, minlength=1).max()),
        limited=merged.limited,
        seams=seams,
        parts=found.parts,
    )


def _copied(source: Source, target: Target, correspondence: npt.NDArray[np.int64]) -> BoneWeights:
    """Weights of the source's groups without a bone at the source vertices that were matched, none where none was."""
    if not target.copied_groups:
        return BoneWeights.none()
    dense = np.zeros((len(source.surface.vertices), len(target.copied_groups)), np.float32)
    column = {name: i for i, name in enumerate(target.copied_groups)}
    place = np.array([column.get(name, -1) for name in source.boneless_groups], np.int32)[source.boneless.bone]
    kept = place >= 0
    dense[source.boneless.vertex[kept], place[kept]] = source.boneless.value[kept]
    values = np.where(correspondence[:, None] >= 0, dense[correspondence], np.float32(0.0))
    vertex, group = np.nonzero(values)
    return BoneWeights(vertex.astype(np.int32), group.astype(np.int32), values[vertex, group])


def _source_weights(source: Source) -> SkinWeights:
    """The source's weights, rows scaled to a total of 1."""
    weights = source.weights
    return SkinWeights.from_triplets(
        weights.vertex, weights.bone, weights.value, len(source.surface.vertices), len(source.bones)
    ).normalized()


def _native_mesh(name: str, surface: Surface) -> TriangleMesh:
    try:
        return TriangleMesh.from_polygons(surface.vertices, surface.loop_counts, surface.loop_indices)
    except (DermisError, ValueError) as error:
        raise InputError(f"The surface of '{name}' cannot be used: {_plain(error)}.") from error


def _plain(error: Exception) -> str:
    """The error's message as the end of a sentence."""
    return str(error).strip().rstrip(".")


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
