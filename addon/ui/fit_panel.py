# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the fit in the sidebar of the 3D viewport."""

import bpy

from ..core.errors import counted
from .fit_selection import fit_armature, fit_meshes, missing_fit
from .fit_skeleton import DERMIS_OT_fit_skeleton
from .panel import SidebarPanel
from .text import draw_text


class DERMIS_PT_fit(SidebarPanel, bpy.types.Panel):
    """What would be fitted into what, and the buttons."""

    bl_label = "Skeleton"

    def draw(self, context):
        """Draw the panel."""
        layout = self.layout
        column = layout.column(align=True)
        reason = missing_fit(context)
        armature = fit_armature(context)
        if reason:
            draw_text(column, reason, context, icon="INFO")
        else:
            meshes = fit_meshes(context)
            column.label(text=armature.name, icon="OUTLINER_OB_ARMATURE")
            text = meshes[0].name if len(meshes) == 1 else counted(len(meshes), "mesh", "meshes")
            column.label(text=text, icon="OUTLINER_OB_MESH")
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row()
        row.scale_y = 1.4
        _button(row, "Fit Skeleton", preview=True, icon="ARMATURE_DATA")
        column = layout.column(align=True)
        _button(column, "Fit without Preview", preview=False)
        if armature is not None and armature.mode in {"EDIT", "POSE"}:
            _button(column, "Keep Selected, Fit the Others", preview=True, keep_selected=True)


def _button(layout, text, *, preview, keep_selected=False, icon="NONE"):
    button = layout.operator(DERMIS_OT_fit_skeleton.bl_idname, text=text, icon=icon)
    button.preview = preview
    button.keep_selected = keep_selected


CLASSES = (DERMIS_PT_fit,)
