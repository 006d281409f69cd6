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


def select_vertices(ob: bpy.types.Object, vertices: np.ndarray, extend: bool = False) -> None:
    """Select these vertices (m,) in the object's mode, also with what was selected before where `extend`.

    Edges and faces are selected where all their vertices are; hidden vertices stay hidden.
    """
    chosen = np.zeros(vertex_count(ob), np.bool_)
    chosen[vertices] = True
    if ob.mode == "EDIT":
        mesh = bmesh.from_edit_mesh(ob.data)
        if extend:
            chosen[[vertex.index for vertex in mesh.verts if vertex.select]] = True
        for element in (*mesh.faces, *mesh.edges):
            element.select = False
        for vertex in mesh.verts:
            vertex.select = bool(chosen[vertex.index]) and not vertex.hide
        mesh.select_mode = {"VERT"}
        mesh.select_flush_mode()
        bmesh.update_edit_mesh(ob.data, loop_triangles=False, destructive=False)
        return
    mesh = ob.data
    if extend:
        chosen[selected_vertices(ob)] = True
    hidden = np.empty(len(chosen), np.bool_)
    mesh.vertices.foreach_get("hide", hidden)
    chosen &= ~hidden
    mesh.vertices.foreach_set("select", chosen)
    ends = np.empty(len(mesh.edges) * 2, np.int32)
    mesh.edges.foreach_get("vertices", ends)
    mesh.edges.foreach_set("select", chosen[ends.reshape(-1, 2)].all(axis=1))
    starts = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    if len(starts):
        mesh.polygons.foreach_set("select", np.logical_and.reduceat(chosen[corners], starts))
    mesh.update()


def vertex_count(ob: bpy.types.Object) -> int:
    """Number of vertices of the object's mesh, in Edit Mode as it is edited."""
    return len(bmesh.from_edit_mesh(ob.data).verts) if ob.mode == "EDIT" else len(ob.data.vertices)


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
