# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of bones in the sidebar: which target bones stand for each source bone."""

import bpy

from .bone_map_add import DERMIS_OT_bone_map_add
from .bone_map_clear import DERMIS_OT_bone_map_clear
from .bone_map_fill import DERMIS_OT_map_bones
from .bone_map_operator import armatures
from .bone_map_remove import DERMIS_OT_bone_map_remove
from .panel import SidebarPanel
from .selection import single_target, source_of

# How a pair was found. A question mark asks to look at it; an arrow is for weight that goes to an ancestor.
FOUND = {"NAME": "CHECKMARK", "SCHEME": "CHECKMARK", "STRUCTURE": "QUESTION", "USER": "USER"}
NOWHERE = "TRIA_UP"


class DERMIS_UL_bone_map(bpy.types.UIList):
    """A sign for how the pair was found, source bone, target bone."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        """Draw one pair."""
        split = layout.split(factor=0.55)
        split.label(text=item.source, icon=FOUND.get(item.how, "BLANK1") if item.target else NOWHERE)
        split.label(text=item.target)

    def filter_items(self, context, data, propname):
        """Show the rows whose source or target bone has the text of the filter."""
        rows = getattr(data, propname)
        if not self.filter_name:
            return [], []
        wanted = self.filter_name.lower()
        shown = [
            self.bitflag_filter_item if wanted in row.source.lower() or wanted in row.target.lower() else 0
            for row in rows
        ]
        return shown, []


def draw_pair(layout, pair, armature):
    """Draw the target bone of the chosen pair, which can be changed, and how it was found."""
    column = layout.column(align=True)
    if armature is None:
        column.prop(pair, "target", text="")
    else:
        column.prop_search(pair, "target", armature.data, "bones", text="")
    if pair.target:
        told = pair.bl_rna.properties["how"].enum_items[pair.how].description
        column.label(text=told, icon=FOUND.get(pair.how, "BLANK1"))
    else:
        column.label(text="Weight goes to the nearest mapped ancestor", icon=NOWHERE)


class DERMIS_PT_bone_map(SidebarPanel, bpy.types.Panel):
    """The bone list of the only target."""

    bl_label = "Bones"
    bl_parent_id = "DERMIS_PT_retarget"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draw the panel."""
        layout = self.layout
        source, target = source_of(context), single_target(context)
        if source is None or target is None:
            layout.label(text="Select one source and one target", icon="INFO")
            return
        kept = target.dermis_retarget
        own = armatures(source, target)[0]
        if kept.bone_map and (own is None or kept.bone_map_source != own):
            owner = kept.bone_map_source.name if kept.bone_map_source else "a removed armature"
            layout.label(text=f"This list belongs to {owner}", icon="ERROR")
        if kept.bone_map:
            row = layout.row()
            row.template_list("DERMIS_UL_bone_map", "", kept, "bone_map", kept, "active_bone_pair", rows=6)
            column = row.column(align=True)
            column.operator(DERMIS_OT_bone_map_add.bl_idname, text="", icon="ADD")
            column.operator(DERMIS_OT_bone_map_remove.bl_idname, text="", icon="REMOVE")
            column.separator()
            column.operator(DERMIS_OT_bone_map_clear.bl_idname, text="", icon="TRASH")
            if 0 <= kept.active_bone_pair < len(kept.bone_map):
                draw_pair(layout, kept.bone_map[kept.active_bone_pair], armatures(source, target)[1])
        else:
            layout.label(text="None: mapped with each retargeting", icon="INFO")
        layout.operator(DERMIS_OT_map_bones.bl_idname, icon="BONE_DATA")


CLASSES = (DERMIS_UL_bone_map, DERMIS_PT_bone_map)
