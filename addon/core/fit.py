# SPDX-License-Identifier: GPL-3.0-or-later
"""Fitting the bones of an armature into a body that has none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from dermis_native import Cancelled, DermisError, Progress, TriangleMesh, fit_skeleton

from .bind import joined_surface
from .bones import native_skeleton
from .character import Bones, Flags, Floats, Surface
from .errors import InputError, counted, listed, sentence
from .native_task import NativeTask

# Below this the result is reported as a warning.
GOOD_SCORE = 0.5


@dataclass(frozen=True)
class Template:
    """The skeleton to fit: all bones of an armature in world space.

    deform (B,) marks the bones that follow the body's shape, the others are carried along; fixed
    (B,) marks those that stay where they are.
    """

    name: str
    bones: Bones
    deform: Flags
    fixed: Flags

    def check(self) -> None:
        """Raise InputError when there is nothing to fit."""
        count = int(self.deform.sum())
        if count == 0:
            raise InputError(f"Armature '{self.name}' has no deforming bone.")
        self.bones.check(self.name)
        if count == 1:
            only = self.bones.names[int(np.argmax(self.deform))]
            raise InputError(
                f"Armature '{self.name}' has one bone to fit, '{only}': a skeleton of at least two is needed."
            )
        if self.fixed.all():
            raise InputError(f"All bones of '{self.name}' are kept where they are, so there is nothing to fit.")


@dataclass(frozen=True)
class Body:
    """The meshes that count as one body, in world space."""

    names: tuple[str, ...]
    surfaces: tuple[Surface, ...]

    def check(self) -> None:
        """Raise InputError when a mesh has no polygon or a coordinate that is not finite."""
        for name, surface in zip(self.names, self.surfaces, strict=True):
            surface.check(name)


@dataclass(frozen=True)
class FittedBones:
    """Where the bones go: heads and tails (B,3) in world space.

    found (B,) marks the bones that the body's shape placed; score, 0 to 1, says how well all fit;
    message is empty or one sentence on what was not found.
    """

    heads: Floats
    tails: Floats
    found: Flags
    score: float
    method: str
    symmetric: bool
    message: str


class FitTask(NativeTask[FittedBones]):
    """Fits one template to one body; symmetric is None to decide from both.

    Bad input raises at once, in the constructor. The thread touches nothing but its arrays.
    """

    def __init__(self, template: Template, body: Body, symmetric: bool | None) -> None:
        super().__init__("dermis-fit")
        template.check()
        body.check()
        self._template, self._body, self._symmetric = template, body, symmetric

    def work(self) -> FittedBones:
        """The fitted bones."""
        return fit_bones(self._template, self._body, self._symmetric, self._progress[0])


def fit_bones(template: Template, body: Body, symmetric: bool | None, progress: Progress) -> FittedBones:
    """The template's bones fitted into the body; InputError where that cannot be done."""
    surface = joined_surface(body.surfaces)
    try:
        fitted = fit_skeleton(
            TriangleMesh.from_polygons(surface.vertices, surface.loop_counts, surface.loop_indices),
            native_skeleton(template.bones),
            deform=template.deform.tolist(),
            fixed=template.fixed.tolist(),
            symmetric=symmetric,
            progress=progress,
        )
    except Cancelled:
        raise
    except (DermisError, ValueError) as error:
        reason = str(error).strip().rstrip(".")
        raise InputError(f"'{template.name}' cannot be fitted into {listed(body.names)}: {reason}.") from error
    heads, tails = fitted.skeleton.heads, fitted.skeleton.tails
    bad = ~(np.isfinite(heads).all(axis=1) & np.isfinite(tails).all(axis=1))
    if bad.any():
        names = [template.bones.names[bone] for bone in np.flatnonzero(bad)]
        raise InputError(f"No place was found for {listed(names)} of '{template.name}'.")
    return FittedBones(
        heads=heads,
        tails=tails,
        found=np.asarray(fitted.found),
        score=fitted.score,
        method=fitted.method,
        symmetric=fitted.symmetric,
        message=fitted.message,
    )


def fit_line(template: Template, body: Body, fitted: FittedBones, seconds: float) -> str:
    """What was fitted into what."""
    parts = [*fit_counts(template, fitted), *(["symmetric"] if fitted.symmetric else []), f"{seconds:.2f} s"]
    return f"'{template.name}' fitted into {listed(body.names)}: {', '.join(parts)}."


def fit_counts(template: Template, fitted: FittedBones) -> list[str]:
    """How many bones were placed in which way, and the score."""
    fixed = int(template.fixed.sum())
    found = int((fitted.found & ~template.fixed).sum())
    carried = len(template.bones) - found - fixed
    return [
        f"{counted(found, 'bone')} placed by the shape",
        *([f"{carried:,} carried along"] if carried else []),
        *([f"{fixed:,} kept"] if fixed else []),
        f"score {fitted.score:.2f}",
    ]


def fit_notes(fitted: FittedBones) -> list[str]:
    """Sentences on what to look at, empty when all is well."""
    if fitted.message:
        return [sentence(fitted.message)]
    if fitted.score < GOOD_SCORE:
        return ["The skeleton fits badly: compare it with the body before you use it."]
    return []


def check_lengths(name: str, bones: Sequence[str], lengths: Floats, shortest: float) -> None:
    """Raise InputError when a bone's length (B,), in the armature's own unit, is under what Blender keeps."""
    short = [bones[bone] for bone in np.flatnonzero(lengths <= shortest)]
    if short:
        raise InputError(
            f"Bones of '{name}' would be too short for Blender: {listed(short)}. If the armature is scaled up, "
            "apply its scale first; otherwise the body has no room for them."
        )
