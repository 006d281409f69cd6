# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the sidebar of the 3D viewport."""

import bpy

from ..blender.armature import find_armature
from ..blender.match_display import kept_status
from ..core.errors import counted
from ..core.retarget import FILLED
from .landmark_add import DERMIS_OT_landmark_add
from .landmark_clear import DERMIS_OT_landmark_clear
from .landmark_remove import DERMIS_OT_landmark_remove
from .landmark_show import DERMIS_OT_landmark_show
from .retarget_weights import DERMIS_OT_retarget_weights
from .selection import single_target, source_of, targets_of
from .text import draw_missing, draw_text


class DERMIS_UL_landmarks(bpy.types.UIList):
    """Landmark pairs: name, vertex of the source, vertex of the target."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        """Draw one pair."""
        split = layout.split(factor=0.5, align=True)
        split.prop(item, "name", text="", emboss=False, icon="PMARKER_ACT")
        row = split.row(align=True)
        row.prop(item, "source_vertex", text="", emboss=False)
        row.prop(item, "target_vertex", text="", emboss=False)


class SidebarPanel:
    """Place of all panels of Dermis."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Dermis"


class DERMIS_PT_retarget(SidebarPanel, bpy.types.Panel):
    """Source, targets, the button and what it did last."""

    bl_label = "Retarget Weights"

    def draw(self, context):
        """Draw the panel."""
        layout = self.layout
        source, targets = source_of(context), targets_of(context)
        column = layout.column(align=True)
        _draw_character(column, "Source", source, "The active mesh")
        if len(targets) > 1:
            _labelled(column, "Targets", counted(len(targets), "mesh", "meshes"), "OUTLINER_OB_MESH")
        else:
            _draw_character(column, "Target", targets[0] if targets else None, "Other selected meshes")
        draw_missing(layout, DERMIS_OT_retarget_weights, context)
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row()
        row.scale_y = 1.4
        row.operator(DERMIS_OT_retarget_weights.bl_idname, icon="MOD_DATA_TRANSFER")
        target = single_target(context)
        if target is not None and target.dermis_retarget.result:
            draw_text(layout.column(align=True), target.dermis_retarget.result, context)
            status = kept_status(target)
            if status is not None and (status == FILLED).any():
                button = layout.operator(
                    "dermis.select_problems", text="Select Filled Vertices", icon="RESTRICT_SELECT_OFF"
                )
                button.category = "FILLED"


class DERMIS_PT_landmarks(SidebarPanel, bpy.types.Panel):
    """The landmark pairs of the only target."""

    bl_label = "Landmarks"
    bl_parent_id = "DERMIS_PT_retarget"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draw the panel."""
        layout = self.layout
        target = single_target(context) if source_of(context) is not None else None
        if target is None:
            layout.label(text="Select one source and one target", icon="INFO")
            return
        kept = target.dermis_retarget
        if kept.landmarks and kept.landmark_source != source_of(context):
            owner = kept.landmark_source.name if kept.landmark_source else "a removed mesh"
            layout.label(text=f"These belong to {owner}", icon="ERROR")
        row = layout.row()
        row.template_list("DERMIS_UL_landmarks", "", kept, "landmarks", kept, "active_landmark", rows=4)
        column = row.column(align=True)
        column.operator(DERMIS_OT_landmark_add.bl_idname, text="", icon="ADD")
        column.operator(DERMIS_OT_landmark_remove.bl_idname, text="", icon="REMOVE")
        column.separator()
        column.operator(DERMIS_OT_landmark_show.bl_idname, text="", icon="RESTRICT_SELECT_OFF")
        column.operator(DERMIS_OT_landmark_clear.bl_idname, text="", icon="TRASH")
        if not kept.landmarks:
            layout.label(text="None: chosen on the skeletons", icon="INFO")


def _draw_character(layout, title, ob, hint):
    if ob is None:
        _labelled(layout, title, hint, "BLANK1")
        return
    armature = find_armature(ob)
    _labelled(layout, title, ob.name, "OUTLINER_OB_MESH")
    if armature is not None:
        _labelled(layout, "", armature.name, "OUTLINER_OB_ARMATURE")
    elif title == "Source":
        _labelled(layout, "", "No armature", "ERROR")
    else:
        _labelled(layout, "", "Armature of the source", "OUTLINER_OB_ARMATURE")


def _labelled(layout, title, text, icon):
    split = layout.split(factor=0.3)
    split.label(text=title)
    split.label(text=text, icon=icon)


CLASSES = (DERMIS_UL_landmarks, DERMIS_PT_retarget, DERMIS_PT_landmarks)
