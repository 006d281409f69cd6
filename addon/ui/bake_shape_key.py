# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that saves corrections of chosen poses as shape keys."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ..blender.shape_key_job import ShapeKeyJob
from ..core.errors import InputError
from ..core.frame_range import FrameList
from .bake_operator import BakeOperator, live_meshes


class DERMIS_OT_bake_shape_key(BakeOperator, bpy.types.Operator):
    """All meshes of the active armature, or the selected meshes."""

    bl_idname = "dermis.bake_shape_key"
    bl_label = "Save Correction as Shape Key"
    bl_description = (
        "Save what the live PBD skin corrects in this pose, or at each timeline marker, as a shape key under the "
        "Armature modifier: of all meshes of the active armature, or of the selected meshes"
    )
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    key_name: StringProperty(
        name="Name", description="Name of the key; after the frame or the marker when empty", default=""
    )
    poses: EnumProperty(
        name="Poses",
        description="Which poses to save",
        items=(
            ("CURRENT", "Current Pose", "The pose that is shown now"),
            ("MARKERS", "Markers", "The pose at each marker of the timeline"),
        ),
        default="CURRENT",
    )
    value: FloatProperty(name="Value", description="Value of the new keys", min=0.0, max=1.0, default=0.0)
    switch_off: BoolProperty(
        name="Switch Live Skin Off",
        description="Mute the live skin, so that the keys stand in for it; Back to Live switches it on again",
        default=False,
    )

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        for name in ("key_name", "poses", "value", "switch_off"):
            layout.prop(self, name)

    def job(self, context) -> ShapeKeyJob:
        """Read and check what is chosen."""
        scene = context.scene
        frames = None
        names = [self.key_name or f"Correction {scene.frame_float:g}"]
        if self.poses == "MARKERS":
            markers = sorted(scene.timeline_markers, key=lambda marker: (marker.frame, marker.name))
            if not markers:
                raise InputError("The timeline has no marker: add one at each pose to save.")
            frames = FrameList(tuple((marker.frame, 0.0) for marker in markers))
            start = f"{self.key_name} " if self.key_name else ""
            names = [start + (marker.name or str(marker.frame)) for marker in markers]
        return ShapeKeyJob(live_meshes(context), scene, names, frames, value=self.value, off=self.switch_off)
