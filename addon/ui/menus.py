# SPDX-License-Identifier: GPL-3.0-or-later
"""Entries in Blender's own menus."""

import bpy

from .bind_weights import DERMIS_OT_bind_weights
from .check_weights import DERMIS_OT_check
from .fit_skeleton import DERMIS_OT_fit_skeleton
from .retarget_weights import DERMIS_OT_retarget_weights


def draw_retarget(menu, _context):
    """Entry of Object > Link/Transfer Data and of Weight Paint > Weights."""
    layout = menu.layout
    layout.separator()
    layout.operator_context = "INVOKE_DEFAULT"
    layout.operator(DERMIS_OT_retarget_weights.bl_idname)


def draw_check(menu, _context):
    """Entry of Weight Paint > Weights."""
    layout = menu.layout
    layout.operator_context = "INVOKE_DEFAULT"
    layout.operator(DERMIS_OT_check.bl_idname)


def draw_bind(menu, _context):
    """Entry of Object > Parent, after the fit, as the next step."""
    layout = menu.layout
    layout.operator_context = "INVOKE_DEFAULT"
    layout.operator(DERMIS_OT_bind_weights.bl_idname)


def draw_fit(menu, _context):
    """Entry of Object > Parent after Blender's own automatic weights, and of the menus Armature and Pose."""
    layout = menu.layout
    layout.separator()
    layout.operator_context = "INVOKE_DEFAULT"
    layout.operator(DERMIS_OT_fit_skeleton.bl_idname)


def register() -> None:
    """Append the entries."""
    bpy.types.VIEW3D_MT_make_links.append(draw_retarget)
    bpy.types.VIEW3D_MT_paint_weight.append(draw_retarget)
    bpy.types.VIEW3D_MT_paint_weight.append(draw_check)
    for menu in (bpy.types.VIEW3D_MT_object_parent, bpy.types.VIEW3D_MT_edit_armature, bpy.types.VIEW3D_MT_pose):
        menu.append(draw_fit)
    bpy.types.VIEW3D_MT_object_parent.append(draw_bind)


def unregister() -> None:
    """Remove the entries."""
    bpy.types.VIEW3D_MT_object_parent.remove(draw_bind)
    for menu in (bpy.types.VIEW3D_MT_pose, bpy.types.VIEW3D_MT_edit_armature, bpy.types.VIEW3D_MT_object_parent):
        menu.remove(draw_fit)
    bpy.types.VIEW3D_MT_paint_weight.remove(draw_check)
    bpy.types.VIEW3D_MT_paint_weight.remove(draw_retarget)
    bpy.types.VIEW3D_MT_make_links.remove(draw_retarget)
