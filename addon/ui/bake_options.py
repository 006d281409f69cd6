# SPDX-License-Identifier: GPL-3.0-or-later
"""Options of the bakes: kept with the scene for the panel, and in each operator for Adjust Last Operation."""

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, PointerProperty, StringProperty

from ..core.frame_range import FrameRange

# From 4.5 on Blender wants to be told of properties that understand "//".
RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()


class FrameOptions:
    """Which frames."""

    use_scene_range: BoolProperty(
        name="Scene Range", description="From the scene's first frame to its last", default=True
    )
    frame_start: IntProperty(name="Start", description="First frame", default=1)
    frame_end: IntProperty(name="End", description="Last frame", default=250)
    samples_per_frame: IntProperty(
        name="Samples per Frame",
        description="Samples from one frame to the next: 1 for whole frames, more for motion blur and slow motion",
        min=1,
        soft_max=8,
        max=64,
        default=1,
    )

    def frame_range(self, scene: bpy.types.Scene) -> FrameRange:
        """The frames that the options choose."""
        start, end = self.frame_start, self.frame_end
        if self.use_scene_range:
            start, end = scene.frame_start, scene.frame_end
        return FrameRange(start, end, self.samples_per_frame)


class CacheOptions:
    """Where a point cache goes."""

    directory: StringProperty(
        name="Folder",
        description="Folder of the cache files; // is the folder of this file",
        subtype="DIR_PATH",
        default="//",
        options=RELATIVE,
    )
    file_format: EnumProperty(
        name="Format",
        description="Format of the point cache",
        items=(
            ("PC2", "PC2", "Point cache of 3ds Max, little-endian"),
            ("MDD", "MDD", "Motion designer data of LightWave, big-endian"),
        ),
        default="PC2",
    )


class DermisBake(FrameOptions, CacheOptions, bpy.types.PropertyGroup):
    """What the panel shows."""


def draw_frames(layout: bpy.types.UILayout, options: FrameOptions) -> None:
    """Draw the options of the frames."""
    layout.prop(options, "use_scene_range")
    if not options.use_scene_range:
        column = layout.column(align=True)
        column.prop(options, "frame_start")
        column.prop(options, "frame_end")


def fill_from_scene(operator: bpy.types.Operator, scene: bpy.types.Scene) -> None:
    """Give an operator that was started from a button what the panel shows."""
    kept = scene.dermis_bake
    offered = {*operator.properties.bl_rna.properties.keys()} - {"name", "rna_type"}
    for name in kept.bl_rna.properties.keys():  # noqa: SIM118  (a collection of Blender's)
        if name in offered and not operator.properties.is_property_set(name):
            setattr(operator, name, getattr(kept, name))


def register() -> None:
    """Register the property group and put one on scenes."""
    bpy.utils.register_class(DermisBake)
    bpy.types.Scene.dermis_bake = PointerProperty(type=DermisBake)


def unregister() -> None:
    """Take it away."""
    del bpy.types.Scene.dermis_bake
    bpy.utils.unregister_class(DermisBake)
