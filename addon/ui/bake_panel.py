# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the bakes in the sidebar of the 3D viewport."""

import bpy

from ..blender.bake_state import is_baked
from .bake_driven_keys import DERMIS_OT_bake_driven_keys
from .bake_join import DERMIS_OT_bake_join
from .bake_options import draw_frames
from .bake_point_cache import DERMIS_OT_bake
from .bake_remove import DERMIS_OT_bake_remove
from .bake_shape_key import DERMIS_OT_bake_shape_key
from .bake_weights import DERMIS_OT_bake_weights
from .panel import SidebarPanel
from .skin_selection import chosen_meshes

STANDING_IN = {
    "": "Point cache",  # of a library override, which keeps nothing but the modifier
    "CACHE": "Point cache",
    "KEYS": "Shape keys",
    "WEIGHTS": "Fitted weights",
}


class DERMIS_PT_bake(SidebarPanel, bpy.types.Panel):
    """What to bake, and the way back."""

    bl_label = "Bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draw the panel."""
        layout = self.layout
        kept = context.scene.dermis_bake
        column = layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        draw_frames(column, kept)
        column.separator()
        column.prop(kept, "directory")
        column.prop(kept, "file_format")
        column.prop(kept, "samples_per_frame", text="Samples")
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.operator(DERMIS_OT_bake.bl_idname, icon="FILE_CACHE")
        row.operator(DERMIS_OT_bake_join.bl_idname, text="", icon="FILEBROWSER")
        column = layout.column(align=True)
        column.operator(DERMIS_OT_bake_driven_keys.bl_idname, icon="DRIVER")
        column.operator(DERMIS_OT_bake_weights.bl_idname, icon="MOD_VERTEX_WEIGHT")
        column.operator(DERMIS_OT_bake_shape_key.bl_idname, icon="SHAPEKEY_DATA")
        baked = [ob for ob in chosen_meshes(context) if is_baked(ob)]
        if baked:
            column = layout.column(align=True)
            for ob in baked:
                column.label(text=f"{ob.name}: {STANDING_IN[ob.dermis_skin.baked]}", icon="CHECKMARK")
            column.operator(DERMIS_OT_bake_remove.bl_idname, icon="LOOP_BACK")


CLASSES = (DERMIS_PT_bake,)
