# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that switches PBD skins off."""

import bpy

from ..blender.skin_switch import disable_skins
from ..core.errors import InputError
from .skin_operator import SkinOperator
from .skin_selection import chosen_meshes


class DERMIS_OT_skin_disable(SkinOperator, bpy.types.Operator):
    """All meshes of the active armature, or the selected meshes."""

    bl_idname = "dermis.skin_disable"
    bl_label = "Disable PBD Skin"
    bl_description = (
        "Remove the PBD skin and its shape key: of all meshes of the active armature, or of the selected meshes"
    )
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context):
        """Switch off what is on."""
        meshes = [ob for ob in chosen_meshes(context) if ob.dermis_skin.enabled]
        if not meshes:
            raise InputError("No mesh here has a PBD skin.")
        disable_skins(meshes)
        return {"FINISHED"}
