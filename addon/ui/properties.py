# SPDX-License-Identifier: GPL-3.0-or-later
"""What Dermis keeps on objects."""

import bpy
from bpy.props import CollectionProperty, IntProperty, PointerProperty, StringProperty


class DermisLandmark(bpy.types.PropertyGroup):
    """A vertex of the source and the vertex of the target that is the same place of the body."""

    source_vertex: IntProperty(name="Source Vertex", description="Index of the vertex of the source", min=0)
    target_vertex: IntProperty(name="Target Vertex", description="Index of the vertex of the target", min=0)


class DermisRetarget(bpy.types.PropertyGroup):
    """Kept on a target: its landmarks and what it was given last."""

    landmarks: CollectionProperty(type=DermisLandmark, name="Landmarks")
    active_landmark: IntProperty(name="Active Landmark", description="Landmark pair chosen in the list")
    landmark_source: PointerProperty(
        type=bpy.types.Object, name="Landmark Source", description="Source that the landmark pairs belong to"
    )
    result: StringProperty(name="Result", description="What the last retargeting to this object did")
    status: StringProperty(
        name="Status",
        description="How the last retargeting found the weights of each vertex, packed",
        options={"HIDDEN"},
    )


CLASSES = (DermisLandmark, DermisRetarget)


def register() -> None:
    """Register the property groups and put one on objects."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Object.dermis_retarget = PointerProperty(type=DermisRetarget)


def unregister() -> None:
    """Take them away; what files hold of them stays there."""
    del bpy.types.Object.dermis_retarget
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
