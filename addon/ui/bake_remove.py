# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that brings live skins back after a bake."""

import bpy
from bpy.props import BoolProperty

from ..blender.bake_state import back_to_live, is_baked
from ..core.errors import InputError, listed
from .skin_operator import SkinOperator
from .skin_selection import chosen_meshes


class DERMIS_OT_bake_remove(SkinOperator, bpy.types.Operator):
    """All meshes of the active armature, or the selected meshes."""

    bl_idname = "dermis.bake_remove"
    bl_label = "Back to Live"
    bl_description = (
        "Remove the baked skin and switch the live one on again, as it was: "
        "for all meshes of the active armature, or for the selected meshes"
    )
    bl_options = {"REGISTER", "UNDO"}

    delete_files: BoolProperty(
        name="Delete Cache Files",
        description="Delete the point caches too, where no other modifier of this file plays them. "
        "Undo does not bring them back",
        default=False,
    )

    def run(self, context):
        """Remove, switch on and show the present pose."""
        meshes = [ob for ob in chosen_meshes(context) if is_baked(ob)]
        if not meshes:
            raise InputError("No mesh here is baked.")
        files = back_to_live(meshes)
        kept = []
        for path in files if self.delete_files else ():
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                kept.append(f"'{path}': {error.strerror or error}")
        context.view_layer.update()
        if kept:
            self.tell({"WARNING"}, f"Back to live; not deleted: {', '.join(kept)}.")
        else:
            self.tell({"INFO"}, f"Live again: {listed([ob.name for ob in meshes])}.")
        return {"FINISHED"}
