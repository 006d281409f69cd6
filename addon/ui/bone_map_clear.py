# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that empties a target's bone list."""

import bpy

from .bone_map_operator import BoneMapOperator
from .selection import single_target


class DERMIS_OT_bone_map_clear(BoneMapOperator, bpy.types.Operator):
    """Empties the list, so that bones are mapped anew each time."""

    bl_idname = "dermis.bone_map_clear"
    bl_label = "Clear Bone List"
    bl_description = "Empty the list; bones are then mapped anew with each retargeting"
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context):
        """Remove all rows."""
        kept = single_target(context).dermis_retarget
        kept.bone_map.clear()
        kept.active_bone_pair = 0
        kept.bone_map_source = None
        return {"FINISHED"}
