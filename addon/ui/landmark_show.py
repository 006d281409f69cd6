# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that shows a landmark pair."""

import bpy

from ..blender.selected_vertices import select_only
from ..core.errors import InputError
from .landmark_operator import LandmarkOperator
from .selection import check_landmark_source, single_target, source_of


class DERMIS_OT_landmark_show(LandmarkOperator, bpy.types.Operator):
    """Selects the vertices of one of the only target's landmarks."""

    bl_idname = "dermis.landmark_show"
    bl_label = "Show Landmark"
    bl_description = "Select both vertices of the chosen landmark pair, in Edit Mode"
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context):
        """Enter Edit Mode and select one vertex of each mesh."""
        source, target = source_of(context), single_target(context)
        check_landmark_source(source, target)
        kept, index = self.chosen(context)
        pair = kept.landmarks[index]
        vertices = ((source, pair.source_vertex), (target, pair.target_vertex))
        for ob, vertex in vertices:
            if vertex >= len(ob.data.vertices):
                raise InputError(f"Landmark '{pair.name}' names vertex {vertex}, which '{ob.name}' does not have.")
            if ob.library is not None or ob.data.library is not None:
                raise InputError(f"'{ob.name}' is linked and cannot enter Edit Mode.")
            if not ob.visible_get():
                raise InputError(f"'{ob.name}' is hidden.")
        source.select_set(True)
        if any(ob.mode != "EDIT" for ob, _ in vertices):
            bpy.ops.object.mode_set(mode="OBJECT")
            bpy.ops.object.mode_set(mode="EDIT")
        context.tool_settings.mesh_select_mode = (True, False, False)
        for ob, vertex in vertices:
            select_only(ob, [vertex])
        return {"FINISHED"}
