# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the meshes that a skeleton is fitted into, in the shape that they have without any pose."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy

from ..core.character import Surface
from ..core.errors import InputError
from ..core.fit import Body
from .mesh import read_polygons, read_positions, read_surface
from .transform import is_mirrored, to_world


def read_body(
    objects: Sequence[bpy.types.Object],
    armature: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    evaluated: bool,
) -> Body:
    """The meshes in world space; InputError for one that the armature's bones carry.

    Evaluated: with shape keys and modifiers, but as armatures leave it at rest. Otherwise the meshes
    as they were made.
    """
    for ob in objects:
        if ob.parent == armature and ob.parent_type == "BONE":
            raise InputError(
                f"'{ob.name}' is parented to the bone '{ob.parent_bone}' of '{armature.name}' and would move with it: "
                "clear its parent first."
            )
    names = tuple(ob.name for ob in objects)
    if not evaluated:
        return Body(names, tuple(read_surface(ob, depsgraph, evaluated=False) for ob in objects))
    with _armatures_at_rest(objects, depsgraph):
        return Body(names, tuple(_shown_surface(ob, depsgraph) for ob in objects))


def _shown_surface(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Surface:
    """The evaluated mesh in world space, whatever its modifiers make of it."""
    shown = ob.evaluated_get(depsgraph)
    surface = Surface(to_world(shown, read_positions(shown.data.vertices)), *read_polygons(shown.data))
    return surface.flipped() if is_mirrored(shown) else surface


@contextmanager
def _armatures_at_rest(objects: Sequence[bpy.types.Object], depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    owners = [ob for ob in objects if ob.parent is not None and ob.parent.type == "ARMATURE"]
    deforming = {ob.parent.data for ob in owners} | {
        modifier.object.data
        for ob in objects
        for modifier in ob.modifiers
        if modifier.type == "ARMATURE" and modifier.object is not None
    }
    posed = [data for data in deforming if data.pose_position == "POSE"]
    if not posed:
        yield
        return
    try:
        for data in posed:
            data.pose_position = "REST"
        depsgraph.update()
        yield
    finally:
        for data in posed:
            data.pose_position = "POSE"
        depsgraph.update()
