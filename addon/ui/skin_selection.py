# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes that the skin operators and the panel speak of."""

import bpy

from ..blender.skin_switch import meshes_of


def chosen_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """All meshes of the active armature, otherwise the selected meshes, by name."""
    active = context.active_object
    if active is not None and active.type == "ARMATURE":
        return meshes_of(active, context.scene)
    return sorted((ob for ob in context.selected_objects if ob.type == "MESH"), key=lambda ob: ob.name)


def missing_meshes(context: bpy.types.Context) -> str:
    """Why there are none, empty where there are some. An active armature without meshes counts as some."""
    active = context.active_object
    if active is not None and active.type == "ARMATURE":
        return ""
    return "" if chosen_meshes(context) else "Make an armature active, or select its meshes."
