# SPDX-License-Identifier: GPL-3.0-or-later
"""The armature and the meshes that the bind speaks of."""

import bpy

from ..blender.armature import find_armature


def bind_armature(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active armature, otherwise the armature of the active mesh."""
    active = context.active_object
    if active is None or active.type == "ARMATURE":
        return active
    return find_armature(active) if active.type == "MESH" else None


def bind_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected meshes and the active one, by name."""
    chosen = {ob.name: ob for ob in context.selected_objects if ob.type == "MESH"}
    active = context.active_object
    if active is not None and active.type == "MESH":
        chosen[active.name] = active
    return [chosen[name] for name in sorted(chosen)]


def missing_bind(context: bpy.types.Context) -> str:
    """What is missing before meshes can be bound; empty when all is there."""
    armature, meshes = bind_armature(context), bind_meshes(context)
    if armature is None:
        return "Select the meshes, then the armature, so that the armature is active."
    if not meshes:
        return "Select the meshes too; the active armature will deform them."
    if any(ob.mode == "EDIT" for ob in (armature, *meshes)):
        return "Leave Edit Mode first."
    return ""
