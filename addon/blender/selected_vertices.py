# SPDX-License-Identifier: GPL-3.0-or-later
"""Which vertices are selected, in Edit Mode or outside it, and selecting others."""

from collections.abc import Sequence

import bmesh
import bpy
import numpy as np


def selected_vertices(ob: bpy.types.Object) -> list[int]:
    """Indices of the object's selected vertices."""
    if ob.mode == "EDIT":
        return [vertex.index for vertex in bmesh.from_edit_mesh(ob.data).verts if vertex.select]
    selected = np.empty(len(ob.data.vertices), np.bool_)
    ob.data.vertices.foreach_get("select", selected)
    return np.flatnonzero(selected).tolist()


def select_only(ob: bpy.types.Object, vertices: Sequence[int]) -> None:
    """Select these vertices of an object in Edit Mode, showing them where they are hidden."""
    mesh = bmesh.from_edit_mesh(ob.data)
    mesh.verts.ensure_lookup_table()
    for element in (*mesh.verts, *mesh.edges, *mesh.faces):
        element.select = False
    for index in vertices:
        mesh.verts[index].hide = False
        mesh.verts[index].select = True
    mesh.select_flush_mode()
    bmesh.update_edit_mesh(ob.data, loop_triangles=False, destructive=False)


def strongest_group(ob: bpy.types.Object, vertex: int) -> str:
    """Name of the vertex group with the largest weight at a vertex, empty where there is none."""
    if ob.mode == "EDIT":
        mesh = bmesh.from_edit_mesh(ob.data)
        layer = mesh.verts.layers.deform.active
        mesh.verts.ensure_lookup_table()
        weights = [] if layer is None else mesh.verts[vertex][layer].items()
    else:
        weights = [(entry.group, entry.weight) for entry in ob.data.vertices[vertex].groups]
    group = max(weights, key=lambda entry: entry[1], default=(-1, 0.0))[0]
    return ob.vertex_groups[group].name if 0 <= group < len(ob.vertex_groups) else ""
