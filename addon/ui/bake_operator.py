# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators that bake skins share."""

import bpy

from ..blender.armature import find_armature
from ..blender.bake_source import keeps_no_key
from ..blender.skin_state import is_live
from ..blender.skin_switch import rigid_meshes
from ..core.errors import InputError
from .bake_options import fill_from_scene
from .modal_job import ModalJobOperator
from .skin_operator import SkinOperator
from .skin_selection import chosen_meshes


class BakeOperator(SkinOperator, ModalJobOperator):
    """A skin operator whose work runs in a thread."""

    doing = "Baking"

    def invoke(self, context, event):
        """Start with what the panel shows."""
        fill_from_scene(self, context.scene)
        return ModalJobOperator.invoke(self, context, event)

    def finished(self, job) -> set[str]:
        """Write into the scene and tell what was done."""
        self.tell({"INFO"}, job.finish())
        bpy.context.view_layer.update()
        return {"FINISHED"}


def live_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The meshes here whose skin is live; InputError where there is none."""
    meshes = [ob for ob in chosen_meshes(context) if is_live(ob)]
    if not meshes:
        raise InputError("No mesh here has a live PBD skin: enable it first, or use Back to Live.")
    return meshes


def bakeable_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The meshes here with a skin; where none has one, those that cannot keep a live skin and are baked without."""
    chosen = chosen_meshes(context)
    meshes = [ob for ob in chosen if ob.dermis_skin.enabled]
    if not meshes:
        keyless = [ob for ob in chosen if keeps_no_key(ob) and find_armature(ob) is not None]
        # Eyes that share a mesh come with a character; no joint bends them.
        rigid = rigid_meshes(keyless)
        meshes = [ob for ob in keyless if ob not in rigid] or keyless
    if not meshes:
        raise InputError("No mesh here has a PBD skin: enable it first.")
    return meshes
