# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the surface of a mesh object, at rest or evaluated."""

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..core.character import Surface
from ..core.errors import InputError
from .transform import is_mirrored, to_world

# Modifiers that move vertices and keep their number; of the others, some change it.
DEFORMING = {
    "ARMATURE", "CAST", "CLOTH", "CORRECTIVE_SMOOTH", "CURVE", "DATA_TRANSFER", "DISPLACE", "HOOK",
    "LAPLACIANDEFORM", "LAPLACIANSMOOTH", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "MESH_SEQUENCE_CACHE",
    "NORMAL_EDIT", "SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH", "SOFT_BODY", "SURFACE_DEFORM", "UV_PROJECT",
    "UV_WARP", "VERTEX_WEIGHT_EDIT", "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY", "WARP", "WAVE",
    "WEIGHTED_NORMAL",
}  # fmt: skip


def read_surface(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph, evaluated: bool) -> Surface:
    """Surface in world space, with the vertices of the object's own mesh.

    At rest: without shape keys, modifiers and pose. Evaluated: as they show it now; modifiers that
    change the number of vertices are left out.
    """
    positions = _evaluated_positions(ob, depsgraph) if evaluated else rest_positions(ob.data)
    surface = Surface(to_world(ob, positions), *read_polygons(ob.data))
    return surface.flipped() if is_mirrored(ob) else surface


def read_polygons(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Number of corners of each polygon (F,), and the vertex of each corner."""
    counts = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", counts)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    return counts, corners


def rest_positions(mesh: bpy.types.Mesh) -> np.ndarray:
    """Positions (V,3) without shape keys, in the object's space."""
    keys = mesh.shape_keys
    return read_positions(mesh.vertices if keys is None else keys.reference_key.points)


def _evaluated_positions(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    if _same_topology(ob, depsgraph):
        return read_positions(ob.evaluated_get(depsgraph).data.vertices)
    with _only_deforming(ob, depsgraph):
        if not _same_topology(ob, depsgraph):
            raise InputError(
                f"The evaluated mesh of '{ob.name}' has other vertices than the mesh itself: "
                "use its rest geometry, or hide the modifiers that change them."
            )
        return read_positions(ob.evaluated_get(depsgraph).data.vertices)


def _same_topology(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    shown, own = ob.evaluated_get(depsgraph).data, ob.data
    return all(len(getattr(shown, kind)) == len(getattr(own, kind)) for kind in ("vertices", "loops", "polygons"))


@contextmanager
def _only_deforming(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    hidden = [m for m in ob.modifiers if m.show_viewport and m.type not in DEFORMING]
    try:
        for modifier in hidden:
            modifier.show_viewport = False
        depsgraph.update()
        yield
    finally:
        for modifier in hidden:
            modifier.show_viewport = True
        depsgraph.update()


def read_positions(points: bpy.types.bpy_prop_collection) -> np.ndarray:
    """Positions (V,3) of vertices or of a shape key's points."""
    flat = np.empty(len(points) * 3, np.float32)
    points.foreach_get("co", flat)
    return flat.reshape(-1, 3)
