# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the PBD skin in the sidebar of the 3D viewport."""

import bpy

from ..blender.bake_state import is_baked
from ..blender.skin_key import find_key
from ..blender.skin_reading import skin_lines
from ..blender.skin_state import registry
from .panel import SidebarPanel
from .skin_disable import DERMIS_OT_skin_disable
from .skin_enable import DERMIS_OT_skin_enable
from .skin_selection import chosen_meshes
from .text import draw_missing, draw_text


def skin_of(context: bpy.types.Context) -> bpy.types.Object | None:
    """The mesh whose settings are shown: the active one, otherwise the only one with a skin."""
    active = context.active_object
    if active is not None and active.type == "MESH":
        return active
    enabled = [ob for ob in chosen_meshes(context) if ob.dermis_skin.enabled]
    return enabled[0] if len(enabled) == 1 else None


class DERMIS_PT_skin(SidebarPanel, bpy.types.Panel):
    """The switch, and what each skin does."""

    bl_label = "PBD Skin"

    def draw(self, context):
        """Draw the panel."""
        layout = self.layout
        meshes = chosen_meshes(context)
        enabled = [ob for ob in meshes if ob.dermis_skin.enabled]
        draw_missing(layout, DERMIS_OT_skin_enable, context)
        row = layout.row(align=True)
        row.scale_y = 1.4
        row.operator(
            DERMIS_OT_skin_enable.bl_idname,
            text="Bind Again" if meshes and len(enabled) == len(meshes) else "Enable PBD Skin",
            icon="MOD_CLOTH",
        )
        if enabled:
            row.operator(DERMIS_OT_skin_disable.bl_idname, text="", icon="X")
        for ob in enabled:
            _draw_skin(layout.column(align=True), ob, "Influence" if len(meshes) == 1 else ob.name, context)
        render = context.scene.render
        if enabled and not render.use_lock_interface:
            # A render started from a window evaluates frames on another thread.
            layout.label(text="Before rendering in this window:", icon="INFO")
            layout.prop(render, "use_lock_interface")


class DERMIS_PT_skin_settings(SidebarPanel, bpy.types.Panel):
    """Settings of one skin."""

    bl_label = "Settings"
    bl_parent_id = "DERMIS_PT_skin"

    @classmethod
    def poll(cls, context):
        """One mesh is needed."""
        return skin_of(context) is not None

    def draw(self, context):
        """Draw the panel."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        ob = skin_of(context)
        kept = ob.dermis_skin
        layout.prop(kept, "preset")
        column = layout.column(align=True)
        column.prop(kept, "iterations")
        column.prop(kept, "cell_size", text="Cell Size" if kept.cell_size else "Cell Size (Auto)")
        column.prop(kept, "start")
        column = layout.column(align=True)
        for name in ("stretch", "volume", "bind", "energy"):
            column.prop(kept, name, slider=True)
        column = layout.column(align=True)
        column.active = kept.energy > 0
        column.prop(kept, "stiffness")
        column.prop_search(kept, "stiffness_group", ob, "vertex_groups")
        layout.prop(kept, "self_collision")
        layout.prop(kept, "smoothing", slider=True)
        layout.prop_search(kept, "mask_group", ob, "vertex_groups")


def _draw_skin(layout, ob, title, context):
    if is_baked(ob):
        layout.label(text=f"{title}: baked" if title == ob.name else "Baked", icon="CHECKMARK")
        return
    key = find_key(ob)
    if key is None:
        layout.label(text=title, icon="OUTLINER_OB_MESH")
    else:
        layout.prop(key, "value", text=title, slider=True)
    state = registry.find(ob)
    if state is None:
        return
    if state.error:
        draw_text(layout, state.error, context, icon="ERROR")
    elif state.stats:
        for line in skin_lines(state.stats, state.limited, state.milliseconds):
            draw_text(layout, line, context)
    if state.notice:
        draw_text(layout, state.notice, context, icon="INFO")


CLASSES = (DERMIS_PT_skin, DERMIS_PT_skin_settings)
