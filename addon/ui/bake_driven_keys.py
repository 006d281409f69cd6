# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that turns live skins into pose-driven shape keys."""

import math

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty

from ..blender.driven_keys_job import DrivenKeysJob, DrivenKeysSettings
from ..core.errors import InputError
from .bake_operator import BakeOperator, live_meshes
from .bake_options import FrameOptions, draw_frames


class DERMIS_OT_bake_driven_keys(FrameOptions, BakeOperator, bpy.types.Operator):
    """All meshes of the active armature, or the selected meshes."""

    bl_idname = "dermis.bake_driven_keys"
    bl_label = "Bake Driven Shape Keys"
    bl_description = (
        "Turn the live PBD skin into as few shape keys as keep the wanted share of its corrections, driven by bone "
        "rotations without Python, and switch the live skin off"
    )
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    poses: EnumProperty(
        name="Poses",
        description="Which poses the keys are made for",
        items=(
            ("FRAMES", "Frames", "Those of the frames"),
            ("MOTION", "Range of Motion", "Each joint alone, bent both ways about both axes and twisted"),
            ("BOTH", "Both", "Frames and range of motion"),
        ),
        default="FRAMES",
    )
    angle: FloatProperty(
        name="Angle",
        description="How far each joint bends in its range of motion; it twists half as far",
        min=math.radians(10.0),
        max=math.radians(150.0),
        default=math.radians(60.0),
        subtype="ANGLE",
    )
    kept: FloatProperty(
        name="Keep",
        description="Share of the correction to be kept, as root mean square over the poses",
        min=0.1,
        max=0.999,
        default=0.9,
        subtype="FACTOR",
    )
    most_keys: IntProperty(
        name="Keys", description="At most so many keys for a mesh", min=1, soft_max=200, max=1000, default=64
    )
    most_poses: IntProperty(
        name="Poses at Most",
        description="At most so many of the frames, evenly spread, are fitted to",
        min=2,
        soft_max=500,
        max=10000,
        default=100,
    )
    output: EnumProperty(
        name="Values",
        description="Where the keys have their values from",
        items=(
            ("DRIVERS", "Drivers", "Drivers on bone rotations, which follow any pose"),
            ("KEYFRAMES", "Keyframes", "Key values at each frame instead of drivers, for formats without drivers"),
        ),
        default="DRIVERS",
    )

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "kept", slider=True)
        layout.prop(self, "most_keys")
        layout.prop(self, "output")
        layout.prop(self, "poses")
        if self.poses != "FRAMES":
            layout.prop(self, "angle")
        if self.poses != "MOTION":
            draw_frames(layout, self)
            layout.prop(self, "samples_per_frame")
            layout.prop(self, "most_poses")

    def job(self, context) -> DrivenKeysJob:
        """Read and check what is chosen."""
        if self.poses == "MOTION" and self.output == "KEYFRAMES":
            raise InputError("A range of motion has no frames to put key values at: choose Drivers.")
        settings = DrivenKeysSettings(
            frames=None if self.poses == "MOTION" else self.frame_range(context.scene),
            motion=None if self.poses == "FRAMES" else self.angle,
            kept=self.kept,
            most_keys=self.most_keys,
            most_poses=self.most_poses,
            as_keyframes=self.output == "KEYFRAMES",
        )
        return DrivenKeysJob(live_meshes(context), context.scene, settings)
