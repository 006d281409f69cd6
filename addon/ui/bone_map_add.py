# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that gives a source bone one more target bone."""

import bpy

from .bone_map_operator import BoneMapOperator


class DERMIS_OT_bone_map_add(BoneMapOperator, bpy.types.Operator):
    """Adds a row for the source bone of the chosen one."""

    bl_idname = "dermis.bone_map_add"
    bl_label = "Add Target Bone"
    bl_description = (
        "Add a row for the same source bone, for one more target bone: its weight is split over a chain of bones, "
        "such as a forearm and its twist bone"
    )
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context):
        """Add the row below the chosen one and choose it."""
        kept, index = self.chosen(context)
        row = kept.bone_map.add()
        row.source, row.how = kept.bone_map[index].source, "USER"
        kept.bone_map.move(len(kept.bone_map) - 1, index + 1)
        kept.active_bone_pair = index + 1
        return {"FINISHED"}
