# SPDX-License-Identifier: GPL-3.0-or-later
"""One fit from the scene and back into it: read, work in a thread, move the rest bones."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import bpy
import numpy as np

from ..core.character import Bones
from ..core.errors import InputError, counted, listed
from ..core.fit import FitTask, FittedBones, Template, fit_line, fit_notes
from .body import read_body
from .rest_bones import RestBones, edit_bones, move_rest, read_rest
from .scope import marked_bones
from .target_checks import check_writable
from .transform import to_world, world_matrix

# A bone whose matrix differs from rest by more than this is posed, or held by constraints.
HELD = 0.01


@dataclass(frozen=True)
class FitOptions:
    """What is fitted into what.

    deform_only: bones that deform nothing are carried along; keep_selected: selected bones stay
    where they are, as locked ones always do; symmetric: None to decide from bones and body;
    evaluated: the body with shape keys and modifiers, otherwise as it was made.
    """

    deform_only: bool = True
    keep_selected: bool = False
    symmetric: bool | None = None
    evaluated: bool = True


class FitJob:
    """Reads everything and checks it in the constructor; `finish` moves all bones, or none."""

    def __init__(
        self,
        armature: bpy.types.Object,
        objects: Sequence[bpy.types.Object],
        options: FitOptions,
        depsgraph: bpy.types.Depsgraph,
    ) -> None:
        self._began = perf_counter()
        self._seconds: float | None = None
        self._armature = armature
        self._held = _held_bones(armature, depsgraph)
        check_writable(armature, "armature data", "rest bones")
        with edit_bones(armature) as bones:
            self._rest = read_rest(bones)
        self.template = read_template(armature, self._rest, options)
        self.template.check()
        self._body = read_body(objects, armature, depsgraph, options.evaluated)
        self.task = FitTask(self.template, self._body, options.symmetric)

    def fitted(self) -> FittedBones:
        """The result, once the work has ended; raises what it raised."""
        if self._seconds is None:
            self._seconds = perf_counter() - self._began
        return self.task.result()

    def finish(self) -> tuple[str, list[str]]:
        """Move the bones; the line to report and notes on what to look at."""
        fitted = self.fitted()
        try:
            check_writable(self._armature, "armature data", "rest bones")
            inverse = np.linalg.inv(world_matrix(self._armature))
            heads, tails = (points @ inverse[:3, :3].T + inverse[:3, 3] for points in (fitted.heads, fitted.tails))
            with edit_bones(self._armature) as bones:
                if not read_rest(bones).same_rest(self._rest):
                    raise InputError(f"'{self._armature.name}' was edited while it was being fitted.")
                kept = self.template.fixed[:, None]
                move_rest(
                    self._armature.name,
                    bones,
                    self._rest,
                    np.where(kept, self._rest.heads, heads),
                    np.where(kept, self._rest.tails, tails),
                )
        except ReferenceError as error:
            raise InputError("The armature was removed while it was being fitted.") from error
        notes = [*fit_notes(fitted), *_stretch_notes(self._armature), *self._constraint_notes()]
        return fit_line(self.template, self._body, fitted, self._seconds), notes

    def _constraint_notes(self) -> list[str]:
        """A sentence on bones that constraints hold away from their new places, where they did not before."""
        if self._armature.mode == "EDIT" or self._held:
            return []
        held = _held_bones(self._armature, bpy.context.evaluated_depsgraph_get())
        if not held:
            return []
        return [
            f"Constraints now hold {counted(len(held), 'deforming bone')} off the new rest place: {listed(held)}. "
            "Fit the skeleton that this rig was made from instead, for Rigify the metarig."
        ]


def _held_bones(armature: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> list[str]:
    """Deforming bones that are not at rest in an evaluated scene, outside Edit Mode."""
    bones = armature.evaluated_get(depsgraph).pose.bones
    channels = np.empty(len(bones) * 16, np.float32)
    bones.foreach_get("matrix_channel", channels)
    off = np.abs(channels.reshape(-1, 4, 4) - np.eye(4)).max(axis=(1, 2), initial=0.0) > HELD
    return [bone.name for bone, is_off in zip(bones, off, strict=True) if is_off and bone.bone.use_deform]


def read_template(armature: bpy.types.Object, rest: RestBones, options: FitOptions) -> Template:
    """The bones of an armature in world space; InputError where a selection is asked for and there is none."""
    fixed = rest.locked.copy()
    if options.keep_selected:
        selected = rest.selected
        if armature.mode != "EDIT":
            marked = marked_bones(armature)
            selected = np.array([name in marked for name in rest.names], np.bool_)
        if not selected.any():
            raise InputError(
                f"No bone of '{armature.name}' is selected: select those to keep in Edit Mode or Pose Mode."
            )
        fixed |= selected
    return Template(
        name=armature.name,
        bones=Bones(rest.names, to_world(armature, rest.heads), to_world(armature, rest.tails), rest.parents),
        deform=rest.deform if options.deform_only else np.ones(len(rest.names), np.bool_),
        fixed=fixed,
    )


def _stretch_notes(armature: bpy.types.Object) -> list[str]:
    """A sentence on constraints that hold a length of the bones as they were."""
    names = [
        bone.name
        for bone in armature.pose.bones
        if any(constraint.type == "STRETCH_TO" and constraint.rest_length > 0 for constraint in bone.constraints)
    ]
    return [f"Stretch To keeps its old length on {listed(names)}: reset it there."] if names else []
