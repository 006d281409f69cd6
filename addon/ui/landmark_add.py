# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that makes a landmark pair of the selected vertices."""

import bpy

from ..blender.selected_vertices import selected_vertices, strongest_group
from ..blender.target_checks import check_writable
from ..core.errors import InputError, counted
from .operator_base import DermisOperator
from .selection import check_landmark_source, missing_selection, single_target, source_of


class DERMIS_OT_landmark_add(DermisOperator, bpy.types.Operator):
    """Adds a pair to the only target's landmarks."""

    bl_idname = "dermis.landmark_add"
    bl_label = "Add Landmark"
    bl_description = (
        "Pair the selected vertex of the source with the selected vertex of the target. "
        "Edit both meshes together and select exactly one vertex of each"
    )
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def missing(cls, context) -> str:
        """A source and exactly one target are needed."""
        reason = missing_selection(context)
        if not reason and single_target(context) is None:
            reason = "Select one target only: each target has landmarks of its own."
        return reason

    def run(self, context):
        """Add the pair and choose it in the list."""
        source, target = source_of(context), single_target(context)
        check_writable(target)
        check_landmark_source(source, target)
        source_vertex, target_vertex = _only_vertex(source), _only_vertex(target)
        kept = target.dermis_retarget
        for pair in kept.landmarks:
            if source_vertex == pair.source_vertex:
                raise InputError(f"Vertex {source_vertex} of '{source.name}' already is landmark '{pair.name}'.")
            if target_vertex == pair.target_vertex:
                raise InputError(f"Vertex {target_vertex} of '{target.name}' already is landmark '{pair.name}'.")
        name = strongest_group(source, source_vertex) or "Landmark"
        names = {pair.name for pair in kept.landmarks}
        pair = kept.landmarks.add()
        pair.name = next(n for n in _numbered(name) if n not in names)
        pair.source_vertex = source_vertex
        pair.target_vertex = target_vertex
        kept.landmark_source = source
        kept.active_landmark = len(kept.landmarks) - 1
        return {"FINISHED"}


def _only_vertex(ob: bpy.types.Object) -> int:
    vertices = selected_vertices(ob)
    if len(vertices) != 1:
        selected = counted(len(vertices), "vertex", "vertices") if vertices else "no vertex"
        raise InputError(f"'{ob.name}' has {selected} selected instead of one.")
    return vertices[0]


def _numbered(name: str):
    yield name
    number = 2
    while True:
        yield f"{name} {number}"
        number += 1
