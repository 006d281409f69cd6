# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the armature of a mesh object, reads its deforming bones, gives a mesh an armature."""

import bpy
import numpy as np

from ..core.character import Bones
from ..core.errors import InputError
from .transform import to_world, world_matrix

MODIFIER_NAME = "Armature"
# Modifiers that multiply vertices; an Armature modifier costs less before them.
SUBDIVIDING = {"SUBSURF", "MULTIRES"}


def armature_modifier(ob: bpy.types.Object) -> bpy.types.ArmatureModifier | None:
    """The first Armature modifier that has an armature."""
    return next((m for m in ob.modifiers if m.type == "ARMATURE" and m.object is not None), None)


def find_armature(ob: bpy.types.Object) -> bpy.types.Object | None:
    """The armature that deforms the object: of its modifier, otherwise its parent."""
    modifier = armature_modifier(ob)
    if modifier is not None:
        return modifier.object
    parent = ob.parent
    if parent is not None and parent.type == "ARMATURE" and ob.parent_type != "BONE":
        return parent
    return None


def is_deformed(ob: bpy.types.Object) -> bool:
    """Whether bones move the object's vertices now: by a modifier or an Armature Deform parent."""
    return armature_modifier(ob) is not None or (
        ob.parent is not None and ob.parent.type == "ARMATURE" and ob.parent_type == "ARMATURE"
    )


def read_bones(armature: bpy.types.Object, posed_in: bpy.types.Depsgraph | None = None) -> Bones:
    """Deforming bones in world space, at rest or as posed in an evaluated scene.

    A bone whose parent does not deform comes under its nearest ancestor that does.
    """
    bones = armature.data.bones
    count = len(bones)
    deforming = np.empty(count, np.bool_)
    bones.foreach_get("use_deform", deforming)
    index = {bone.name: i for i, bone in enumerate(bones)}
    parents = np.array([-1 if bone.parent is None else index[bone.parent.name] for bone in bones], np.int32)
    if posed_in is None:
        places, head, tail = bones, "head_local", "tail_local"
    else:
        places, head, tail = armature.evaluated_get(posed_in).pose.bones, "head", "tail"
    ends = []
    for name in (head, tail):
        points = np.empty(count * 3, np.float32)
        places.foreach_get(name, points)
        ends.append(to_world(armature, points.reshape(-1, 3)))
    everything = Bones(tuple(index), ends[0], ends[1], parents)
    return everything.subset(np.flatnonzero(deforming).tolist())


def is_posed(armature: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether some bone stands elsewhere than at rest in an evaluated scene."""
    bones = armature.evaluated_get(depsgraph).pose.bones
    matrices = np.empty(len(bones) * 16, np.float32)
    bones.foreach_get("matrix_channel", matrices)
    return bool(np.abs(matrices.reshape(-1, 4, 4) - np.eye(4)).max(initial=0.0) > 1e-4)


def check_attachable(ob: bpy.types.Object, armature: bpy.types.Object) -> None:
    """Raise InputError when `attach_armature` would have to refuse."""
    if is_deformed(ob):
        return
    ancestor = armature
    while ancestor is not None:
        if ancestor == ob:
            raise InputError(f"Armature '{armature.name}' is a child of '{ob.name}' and cannot deform it.")
        ancestor = ancestor.parent
    if ob.parent is not None and ob.parent_type == "BONE":
        raise InputError(
            f"'{ob.name}' is parented to the bone '{ob.parent_bone}' and would follow it twice: clear its parent first."
        )
    world_matrix(armature)


def attach_armature(ob: bpy.types.Object, armature: bpy.types.Object) -> None:
    """Let the armature deform the object: a modifier, and a parent where the object has none.

    An Armature modifier that has no armature gets this one. The object stays where it is.
    """
    check_attachable(ob, armature)
    if is_deformed(ob):
        return
    if ob.parent is None:
        ob.parent = armature
        ob.parent_type = "OBJECT"
        ob.matrix_parent_inverse = armature.matrix_world.inverted()
    empty = next((m for m in ob.modifiers if m.type == "ARMATURE"), None)
    if empty is not None:
        empty.object = armature
        return
    ob.modifiers.new(MODIFIER_NAME, "ARMATURE").object = armature
    first = next((i for i, m in enumerate(ob.modifiers) if m.type in SUBDIVIDING), None)
    if first is not None:
        ob.modifiers.move(len(ob.modifiers) - 1, first)
