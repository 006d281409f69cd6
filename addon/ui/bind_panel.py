# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the bind in the sidebar of the 3D viewport."""

import bpy

from ..core.errors import counted
from .bind_selection import bind_armature, bind_meshes, missing_bind
from .bind_weights import DERMIS_OT_bind_weights
from .panel import SidebarPanel
from .text import draw_text


class DERMIS_PT_bind(SidebarPanel, bpy.types.Panel):
    """What would be bound to what, and the button."""

    bl_label = "Bind Weights"

    def draw(self, context):
        """Draw the panel."""
        layout = self.layout
        column = layout.column(align=True)
        reason = missing_bind(context)
        if reason:
            draw_text(column, reason, context, icon="INFO")
        else:
            meshes = bind_meshes(context)
            text = meshes[0].name if len(meshes) == 1 else counted(len(meshes), "mesh", "meshes")
            column.label(text=text, icon="OUTLINER_OB_MESH")
            column.label(text=bind_armature(context).name, icon="OUTLINER_OB_ARMATURE")
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row()
        row.scale_y = 1.4
        row.operator(DERMIS_OT_bind_weights.bl_idname, icon="MOD_ARMATURE")


CLASSES = (DERMIS_PT_bind,)
