# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that bakes skins into point caches."""

import bpy
from bpy.props import BoolProperty, StringProperty

from ..blender.cache_job import CacheJob
from .bake_operator import BakeOperator, bakeable_meshes
from .bake_options import CacheOptions, FrameOptions, draw_frames


class DERMIS_OT_bake(FrameOptions, CacheOptions, BakeOperator, bpy.types.Operator):
    """All meshes of the active armature, or the selected meshes."""

    bl_idname = "dermis.bake"
    bl_label = "Bake Point Cache"
    bl_description = (
        "Write the PBD skin of every frame to a file that Blender plays without Dermis, and switch the live skin off: "
        "for all meshes of the active armature, or for the selected meshes. Works on library overrides too"
    )
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    play: BoolProperty(
        name="Play the Cache",
        description="Add a Mesh Cache modifier that plays the file and switch the live skin off; "
        "without it only the file is written, for instance a part of a range on a farm",
        default=True,
    )

    dask: StringProperty(
        name="Dask Scheduler",
        description="Address of a Dask scheduler whose workers solve the frames, for instance tcp://10.0.0.2:8786; "
        "empty to solve them here",
    )

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "directory")
        layout.prop(self, "file_format")
        draw_frames(layout, self)
        layout.prop(self, "samples_per_frame")
        layout.prop(self, "play")

    def job(self, context) -> CacheJob:
        """Read and check what is chosen."""
        return CacheJob(
            bakeable_meshes(context),
            context.scene,
            self.frame_range(context.scene),
            self.directory,
            self.file_format,
            play=self.play,
            scheduler=self.dask,
        )
