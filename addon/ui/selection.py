# SPDX-License-Identifier: GPL-3.0-or-later
"""Source and targets among the selected objects, and the landmark pairs between them."""

import bpy

from ..blender.armature import find_armature
from ..core.character import BonePair
from ..core.errors import InputError


def source_of(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object, if it is a mesh."""
    ob = context.active_object
    return ob if ob is not None and ob.type == "MESH" else None


def targets_of(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The other selected meshes, by name."""
    source = context.active_object
    chosen = [ob for ob in context.selected_objects if ob.type == "MESH" and ob != source]
    return sorted(chosen, key=lambda ob: ob.name)


def missing_selection(context: bpy.types.Context) -> str:
    """What is missing before anything can go from a source to a target; empty when all is there."""
    if source_of(context) is None:
        return "The active object must be a mesh: the source of the weights."
    if not targets_of(context):
        return "Select the target meshes too; the active mesh is the source."
    return ""


def checked_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The active mesh and the other selected ones, those in Edit Mode included."""
    active = source_of(context)
    chosen = {ob.name: ob for ob in targets_of(context)}
    if active is not None:
        chosen[active.name] = active
    return [chosen[name] for name in sorted(chosen)]


def single_target(context: bpy.types.Context) -> bpy.types.Object | None:
    """The target, if there is exactly one."""
    targets = targets_of(context)
    return targets[0] if len(targets) == 1 else None


def landmark_pairs(source: bpy.types.Object, target: bpy.types.Object) -> list[tuple[int, int]]:
    """Vertices of the target's landmarks: source vertex, target vertex."""
    kept = target.dermis_retarget
    if kept.landmarks:
        check_landmark_source(source, target)
    return [(pair.source_vertex, pair.target_vertex) for pair in kept.landmarks]


def bone_pairs(source: bpy.types.Object, target: bpy.types.Object) -> tuple[BonePair, ...] | None:
    """The target's bone list: source bone, target bone or nothing; None when it has none."""
    kept = target.dermis_retarget
    if not kept.bone_map:
        return None
    armature = find_armature(source)
    if armature is None or kept.bone_map_source != armature:
        owner = "an armature that was removed" if kept.bone_map_source is None else f"'{kept.bone_map_source.name}'"
        other = "no armature" if armature is None else f"'{armature.name}'"
        raise InputError(f"The bone list of '{target.name}' belongs to {owner}, not to {other}: map the bones again.")
    return tuple(BonePair(pair.source, pair.target, pair.how.lower()) for pair in kept.bone_map)


def check_landmark_source(source: bpy.types.Object, target: bpy.types.Object) -> None:
    """Raise InputError when the target's landmarks belong to another source."""
    kept = target.dermis_retarget.landmark_source
    if target.dermis_retarget.landmarks and kept != source:
        owner = "a mesh that was removed" if kept is None else f"'{kept.name}'"
        raise InputError(f"The landmarks of '{target.name}' belong to {owner}: clear them to use '{source.name}'.")
