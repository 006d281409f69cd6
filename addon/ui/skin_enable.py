# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that switches PBD skins on."""

import bpy

from ..blender.skin_state import registry
from ..blender.skin_switch import enable_skins, rigid_meshes
from ..core.errors import InputError, counted, listed
from .skin_operator import SkinOperator
from .skin_selection import chosen_meshes


class DERMIS_OT_skin_enable(SkinOperator, bpy.types.Operator):
    """All meshes of the active armature, or the selected meshes."""

    bl_idname = "dermis.skin_enable"
    bl_label = "Enable PBD Skin"
    bl_description = (
        "Let joints keep their volume and folds touch, live in every frame and render: "
        "for all meshes of the active armature, or for the selected meshes"
    )
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context):
        """Build, switch on and show the present pose."""
        meshes = chosen_meshes(context)
        active = context.active_object
        rigid = []
        if active.type == "ARMATURE":
            if not meshes:
                raise InputError(f"No mesh follows the armature '{active.name}'.")
            # Eyes and buttons come with a character; alone they would be a mistake.
            rigid = rigid_meshes(meshes)
            meshes = [ob for ob in meshes if ob not in rigid] or meshes
            rigid = [ob.name for ob in rigid if ob not in meshes]
        enable_skins(meshes, context.evaluated_depsgraph_get())
        context.view_layer.update()
        states = [registry.state(ob) for ob in meshes]
        troubles = [f"'{ob.name}': {state.error}" for ob, state in zip(meshes, states, strict=True) if state.error]
        if troubles:
            self.tell({"WARNING"}, " ".join(troubles))
        tetrahedra = sum(state.stats.get("tetrahedra", 0) for state in states)
        line = f"PBD skin of {listed([ob.name for ob in meshes])}: {counted(tetrahedra, 'tetrahedron', 'tetrahedra')}."
        if rigid:
            line += f" Left out, as no joint bends them: {listed(rigid)}."
        self.tell({"INFO"}, line)
        return {"FINISHED"}
