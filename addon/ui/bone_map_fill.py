# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that fills a target's bone list with what is found."""

import bpy

from ..blender.armature import read_bones
from ..blender.target_checks import check_writable
from ..core.bones import found_bones
from ..core.errors import InputError
from ..core.report import mapping_line
from .bone_map_operator import BoneMapOperator, armatures
from .selection import single_target, source_of


class DERMIS_OT_map_bones(BoneMapOperator, bpy.types.Operator):
    """Lists the target's bones for each bone of the source."""

    bl_idname = "dermis.map_bones"
    bl_label = "Map Bones"
    bl_description = (
        "List which bones of the target stand for each bone of the source, found by name, naming scheme, structure "
        "and position, so that the list can be changed before it is used"
    )
    bl_options = {"REGISTER", "UNDO"}
    needs_rows = False

    def run(self, context):
        """Fill the list anew."""
        source, target = source_of(context), single_target(context)
        check_writable(target)
        from_armature, to_armature = armatures(source, target)
        if from_armature is None:
            raise InputError(f"The source '{source.name}' has no armature.")
        bones = [read_bones(armature) for armature in (from_armature, to_armature)]
        for armature, some in zip((from_armature, to_armature), bones, strict=True):
            some.check(armature.name)
        mapping = found_bones(from_armature.name, bones[0], to_armature.name, bones[1])
        kept = target.dermis_retarget
        kept.bone_map.clear()
        for name, counterpart, how in mapping.rows():
            row = kept.bone_map.add()
            row.source, row.target = name, counterpart
            row.how = how.upper()
        kept.active_bone_pair = 0
        kept.bone_map_source = from_armature
        self.tell({"INFO"}, mapping_line(from_armature.name, to_armature.name, mapping))
        return {"FINISHED"}
