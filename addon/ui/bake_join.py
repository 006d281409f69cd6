# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that joins point caches of parts of a range, baked elsewhere or at other times."""

from pathlib import Path

import bpy
from bpy.props import CollectionProperty, StringProperty

from ..blender.cache_join import join_parts
from ..core.errors import InputError
from .bake_operator import bakeable_meshes
from .bake_options import RELATIVE
from .skin_operator import SkinOperator


class DERMIS_OT_bake_join(SkinOperator, bpy.types.Operator):
    """The active mesh."""

    bl_idname = "dermis.bake_join"
    bl_label = "Play Cache Parts"
    bl_description = (
        "Join point caches of parts of a range, baked in any order or on several machines, into one file in the "
        "folder of the caches, and play it in the place of the live skin"
    )
    bl_options = {"REGISTER", "UNDO"}

    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: StringProperty(
        name="Parts", description="Folder of the parts", subtype="DIR_PATH", options={"SKIP_SAVE", *RELATIVE}
    )
    filter_glob: StringProperty(default="*.pc2;*.mdd", options={"HIDDEN"})
    target: StringProperty(
        name="Folder",
        description="Folder of the joined file; // is the folder of this file",
        subtype="DIR_PATH",
        default="",
        options=RELATIVE,
    )

    def invoke(self, context, event):
        """Ask for the parts."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def run(self, context):
        """Join, then play."""
        meshes = [ob for ob in bakeable_meshes(context) if ob == context.active_object] or bakeable_meshes(context)
        if len(meshes) != 1:
            raise InputError("Make the mesh active whose parts are to be joined.")
        names = sorted({item.name for item in self.files if item.name})
        if not names:
            raise InputError("Select the files of the parts.")
        parts = [Path(bpy.path.abspath(self.directory)) / name for name in names]
        folder = self.target or context.scene.dermis_bake.directory
        self.tell({"INFO"}, join_parts(meshes[0], context.scene, parts, folder))
        context.view_layer.update()
        return {"FINISHED"}
