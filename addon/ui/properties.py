# SPDX-License-Identifier: GPL-3.0-or-later
"""What Dermis keeps on objects."""

import bpy
from bpy.props import CollectionProperty, EnumProperty, IntProperty, PointerProperty, StringProperty


class DermisLandmark(bpy.types.PropertyGroup):
    """A vertex of the source and the vertex of the target that is the same place of the body."""

    source_vertex: IntProperty(name="Source Vertex", description="Index of the vertex of the source", min=0)
    target_vertex: IntProperty(name="Target Vertex", description="Index of the vertex of the target", min=0)


def _chosen_by_hand(pair, _context):
    pair.how = "USER"


class DermisBonePair(bpy.types.PropertyGroup):
    """A bone of the source and a bone of the target that stands for it; a source bone may have several pairs."""

    source: StringProperty(name="Source Bone", description="Bone of the source's armature")
    target: StringProperty(
        name="Target Bone",
        description="Bone of the target's armature that gets the weight; empty to give it to the nearest mapped "
        "ancestor of the source bone",
        update=_chosen_by_hand,
    )
    how: EnumProperty(
        name="Found",
        description="How the pair was found",
        items=(
            ("NAME", "Name", "Both bones have one name"),
            ("SCHEME", "Naming Scheme", "Both names mean one part of the body"),
            ("STRUCTURE", "Structure", "By its place in the skeleton and in space"),
            ("USER", "User", "Chosen by hand"),
            ("NONE", "None", "There is no counterpart"),
        ),
        default="NONE",
    )


class DermisRetarget(bpy.types.PropertyGroup):
    """Kept on a target: its landmarks and what it was given last."""

    landmarks: CollectionProperty(type=DermisLandmark, name="Landmarks")
    active_landmark: IntProperty(name="Active Landmark", description="Landmark pair chosen in the list")
    landmark_source: PointerProperty(
        type=bpy.types.Object, name="Landmark Source", description="Source that the landmark pairs belong to"
    )
    bone_map: CollectionProperty(
        type=DermisBonePair, name="Bone List", description="Target bones that stand for each source bone"
    )
    active_bone_pair: IntProperty(name="Active Bone Pair", description="Pair of bones chosen in the list")
    bone_map_source: PointerProperty(
        type=bpy.types.Object, name="Bone List Source", description="Armature that the bone list belongs to"
    )
    result: StringProperty(name="Result", description="What the last retargeting to this object did")
    status: StringProperty(
        name="Status",
        description="How the last retargeting found the weights of each vertex, packed",
        options={"HIDDEN"},
    )


CLASSES = (DermisLandmark, DermisBonePair, DermisRetarget)


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
