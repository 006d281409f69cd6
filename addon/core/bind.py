# SPDX-License-Identifier: GPL-3.0-or-later
"""Binding meshes to an armature: weights from the bones alone, for all meshes at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from dermis_native import Cancelled, DermisError, Progress, TriangleMesh, bind_weights

from .bones import native_skeleton
from .character import BoneWeights, Flags, Integers, Surface, Target
from .errors import InputError, counted, listed
from .merge import MergeSettings, check_totals, merge_weights
from .native_task import NativeTask
from .parts import check_part_vertices, parts_argument

Method = Literal["volumetric", "paper"]
PartPolicy = Literal["auto", "rigid", "surface", "own"]


@dataclass(frozen=True)
class BindSettings:
    """How weights are found and written.

    together: all meshes are one body, so that clothes, eyes and buttons follow what they are on;
    otherwise each mesh is a body of its own. parts: the treatment of loose parts.
    """

    method: Method = "volumetric"
    together: bool = True
    parts: PartPolicy = "auto"
    merge: MergeSettings = field(default_factory=MergeSettings)


@dataclass(frozen=True)
class BoundWeights:
    """What one mesh gets.

    Columns of `weights` are the bones; `replaced` (m,) are the vertices and `written` (B,) the bones
    that it holds for; `groups` are the bones that must have a group. `limited` counts the vertices
    that had more influences than allowed.
    """

    weights: BoneWeights
    replaced: Integers
    written: Flags
    groups: tuple[int, ...]
    limited: int


def check_bind(targets: Sequence[Target]) -> None:
    """Raise InputError when a mesh cannot be given weights."""
    for target in targets:
        target.surface.check(target.name)
        target.bones.check(target.armature)
        if not (target.chosen & ~target.locked).any():
            which = "bone groups" if target.only_bones is None else "chosen bone groups"
            raise InputError(f"All {which} of '{target.name}' are locked.")
        if not target.selected.any():
            raise InputError(f"No vertex of '{target.name}' is selected.")


class BindTask(NativeTask[list[BoundWeights]]):
    """Binds meshes to the bones of one armature.

    Bad input raises at once, in the constructor. The thread touches nothing but its arrays.
    """

    def __init__(self, targets: Sequence[Target], settings: BindSettings) -> None:
        check_bind(targets)
        check_part_vertices(settings.parts, targets)
        self._bodies = [list(targets)] if settings.together else [[target] for target in targets]
        self._settings = settings
        super().__init__("dermis-bind", len(self._bodies))

    @property
    def stage(self) -> str:
        """What is being done now."""
        current = min(self._current, len(self._progress) - 1)
        prefix = f"{self._bodies[current][0].name}: " if len(self._bodies) > 1 else ""
        return prefix + super().stage

    def work(self) -> list[BoundWeights]:
        """One result for each mesh."""
        results = []
        for body, progress in zip(self._bodies, self._progress, strict=True):
            if progress.cancelled:
                raise Cancelled("cancelled")
            found = find_weights(body, self._settings, progress)
            results += [
                fit_weights(target, weights, self._settings.merge) for target, weights in zip(body, found, strict=True)
            ]
            self._current += 1
        return results


def find_weights(targets: Sequence[Target], settings: BindSettings, progress: Progress) -> list[BoneWeights]:
    """Weights of every vertex of each mesh, all meshes taken as one body."""
    names = [target.name for target in targets]
    surface = joined_surface([target.surface for target in targets])
    try:
        mesh = TriangleMesh.from_polygons(surface.vertices, surface.loop_counts, surface.loop_indices)
        found = bind_weights(
            mesh,
            native_skeleton(targets[0].bones),
            method=settings.method,
            parts=parts_argument(mesh, settings.parts, "auto", part_vertices(targets)),
            progress=progress,
        )
    except Cancelled:
        raise
    except (DermisError, ValueError) as error:
        reason = str(error).strip().rstrip(".")
        raise InputError(f"{listed(names)} cannot be bound to '{targets[0].armature}': {reason}.") from error
    vertex, bone, value = found.to_triplets()
    starts = np.cumsum([0] + [len(target.surface.vertices) for target in targets])
    weights = []
    for target, first, end in zip(targets, starts[:-1], starts[1:], strict=True):
        low, high = np.searchsorted(vertex, [first, end])
        own = BoneWeights((vertex[low:high] - first).astype(np.int32), bone[low:high].astype(np.int32), value[low:high])
        check_totals(target.name, own, len(target.surface.vertices))
        weights.append(own)
    return weights


def part_vertices(targets: Sequence[Target]) -> Flags | None:
    """The vertices of all meshes whose loose parts are meant, None for all."""
    chosen = [target.part_vertices for target in targets if target.part_vertices is not None]
    return np.concatenate(chosen) if len(chosen) == len(targets) else None


def joined_surface(surfaces: Sequence[Surface]) -> Surface:
    """The surfaces side by side, their vertices one after the other."""
    offsets = np.cumsum([0] + [len(surface.vertices) for surface in surfaces])
    corners = [surface.loop_indices + offset for surface, offset in zip(surfaces, offsets[:-1], strict=True)]
    return Surface(
        np.concatenate([surface.vertices for surface in surfaces]),
        np.concatenate([surface.loop_counts for surface in surfaces]),
        np.concatenate(corners).astype(np.int32),
    )


def fit_weights(target: Target, found: BoneWeights, settings: MergeSettings) -> BoundWeights:
    """What of the found weights is written, beside what stays."""
    merged = merge_weights(found, target, settings)
    return BoundWeights(
        weights=merged.weights,
        replaced=merged.replaced,
        written=merged.written,
        groups=tuple(np.flatnonzero(target.chosen & ~target.locked).tolist()),
        limited=merged.limited,
    )


def bind_line(targets: Sequence[Target], results: Sequence[BoundWeights], seconds: float) -> str:
    """What was bound to what."""
    vertices = sum(len(result.replaced) for result in results)
    influences = max(int(np.bincount(result.weights.vertex, minlength=1).max()) for result in results)
    limited = sum(result.limited for result in results)
    bones = len({int(bone) for result in results for bone in np.unique(result.weights.bone)})
    parts = [
        counted(vertices, "vertex", "vertices"),
        counted(bones, "bone"),
        f"at most {counted(influences, 'influence')}",
        *([counted(limited, "vertex limited", "vertices limited")] if limited else []),
        f"{seconds:.2f} s",
    ]
    names = listed([target.name for target in targets])
    return f"{names} bound to '{targets[0].armature}': {', '.join(parts)}."


def bind_notes(targets: Sequence[Target], results: Sequence[BoundWeights]) -> list[str]:
    """Sentences on what was left out, empty when nothing was."""
    chosen = {bone for result in results for bone in result.groups}
    used = {int(bone) for result in results for bone in np.unique(result.weights.bone)}
    names = targets[0].bones.names
    idle = [names[bone] for bone in sorted(chosen - used)]
    return [f"{counted(len(idle), 'bone')} moved no vertex: {listed(idle)}."] if idle else []
