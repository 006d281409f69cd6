# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that removes a row of a target's bone list."""

import bpy

from .bone_map_operator import BoneMapOperator


class DERMIS_OT_bone_map_remove(BoneMapOperator, bpy.types.Operator):
    """Removes the chosen row; the last one of a source bone is emptied instead."""

    bl_idname = "dermis.bone_map_remove"
    bl_label = "Remove Target Bone"
    bl_description = (
        "Remove the chosen pair; a source bone without any target bone gives its weight to its nearest mapped ancestor"
    )
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context):
        """Remove the row, or its target bone where the source bone has no other row."""
        kept, index = self.chosen(context)
        row = kept.bone_map[index]
        if sum(other.source == row.source for other in kept.bone_map) > 1:
            kept.bone_map.remove(index)
            kept.active_bone_pair = max(0, min(index, len(kept.bone_map) - 1))
        else:
            row.target = ""
        return {"FINISHED"}
