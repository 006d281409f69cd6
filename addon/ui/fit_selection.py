# SPDX-License-Identifier: GPL-3.0-or-later
"""The armature and the meshes that the fit speaks of."""

import bpy

from ..core.errors import listed

MODES = {"OBJECT", "EDIT", "POSE"}


def fit_armature(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object where it is an armature."""
    active = context.active_object
    return active if active is not None and active.type == "ARMATURE" else None


def fit_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected meshes, by name."""
    return sorted((ob for ob in context.selected_objects if ob.type == "MESH"), key=lambda ob: ob.name)


def missing_fit(context: bpy.types.Context) -> str:
    """What is missing before a skeleton can be fitted; empty when all is there."""
    armature, meshes = fit_armature(context), fit_meshes(context)
    if armature is None:
        others = [ob.name for ob in context.selected_objects if ob.type == "ARMATURE"]
        if others:
            return f"Make the armature active: click {listed(others)} last, with Shift."
        return "Select the meshes, then the armature to fit into them, so that the armature is active."
    if not meshes:
        return "Select the meshes too; the active armature will be fitted into them."
    editing = [ob.name for ob in meshes if ob.mode == "EDIT"]
    if editing:
        return f"Leave Edit Mode of {listed(editing)} first."
    if armature.mode not in MODES:
        return "Go to Object Mode, Pose Mode or Edit Mode first."
    return ""
