# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that refits weights to live skins."""

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty

from ..blender.refit_job import RefitJob
from ..core.frame_range import FrameList
from .bake_operator import BakeOperator, live_meshes
from .bake_options import FrameOptions, draw_frames


class DERMIS_OT_bake_weights(FrameOptions, BakeOperator, bpy.types.Operator):
    """All meshes of the active armature, or the selected meshes."""

    bl_idname = "dermis.bake_weights"
    bl_label = "Refit Weights"
    bl_description = (
        "Change the weights so that plain skinning comes as near to the PBD skin as it can over the frames, and "
        "switch the live skin off. Locked groups stay; Back to Live brings the old weights back"
    )
    bl_options = {"REGISTER", "UNDO", "PRESET"}
    doing = "Refitting"

    influences: EnumProperty(
        name="Influences",
        description="At most so many bones for a vertex",
        items=(("4", "4", "What every game engine plays"), ("8", "8", "What most engines play")),
        default="4",
    )
    least: FloatProperty(
        name="At Least",
        description="Leave the weights as they are where they would keep less than this share of the correction",
        min=0.0,
        max=1.0,
        default=0.5,
        subtype="FACTOR",
    )
    most_poses: IntProperty(
        name="Poses",
        description="At most so many poses, evenly spread over the frames, are fitted to",
        min=2,
        soft_max=500,
        max=10000,
        default=100,
    )

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "influences")
        layout.prop(self, "least", slider=True)
        layout.prop(self, "most_poses")
        draw_frames(layout, self)

    def job(self, context) -> RefitJob:
        """Read and check what is chosen."""
        frames = FrameList.spread(self.frame_range(context.scene), self.most_poses)
        return RefitJob(live_meshes(context), context.scene, frames, int(self.influences), self.least)
