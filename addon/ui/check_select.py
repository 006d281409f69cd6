# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that selects what a check found."""

import bpy
from bpy.props import BoolProperty, EnumProperty

from ..blender.check_reports import kept_report, problem_vertices
from ..blender.selected_vertices import select_vertices
from ..core.check import CATEGORIES, NOTED
from ..core.errors import InputError, counted, listed
from .operator_base import DermisOperator
from .selection import checked_meshes

LABELS = {
    "unweighted": "Without Weights",
    "totals": "Wrong Totals",
    "sides": "Other Side",
    "fingers": "Other Finger",
    "stretch": "Stretched Edges",
    "seams": "Unequal Seams",
    "influences": "Too Many Influences",
    "filled": "Filled In",
    "parts": "Loose Parts",
}


class DERMIS_OT_select_problems(DermisOperator, bpy.types.Operator):
    """Selects vertices of the checked meshes, in the mode that they are in."""

    bl_idname = "dermis.select_problems"
    bl_label = "Select Problem Vertices"
    bl_description = (
        "Select the vertices of the selected meshes that the last check found; those that were filled in also "
        "right after Retarget Weights"
    )
    bl_options = {"REGISTER", "UNDO"}

    category: EnumProperty(
        name="Problem",
        description="Which of the vertices found are selected",
        items=(
            ("ALL", "All", "Vertices with any fault"),
            *((name.upper(), LABELS[name], f"Vertices {words}") for name, words in CATEGORIES.items()),
        ),
        default="ALL",
    )
    extend: BoolProperty(name="Extend", description="Keep what is selected already", default=False)

    @classmethod
    def missing(cls, context) -> str:
        """A mesh is needed."""
        return "" if checked_meshes(context) else "Select a mesh that was checked."

    def run(self, context):
        """Select the vertices of each mesh, and make vertices what is selected in Edit Mode."""
        meshes = checked_meshes(context)
        known = [(ob, self._vertices(ob)) for ob in meshes]
        chosen = [(ob, vertices) for ob, vertices in known if vertices is not None]
        if not chosen:
            raise InputError(f"{listed([ob.name for ob in meshes])} must be checked first.")
        for ob, _ in chosen:
            if ob.library is not None or ob.data.library is not None:
                raise InputError(f"'{ob.name}' is linked, its vertices cannot be selected.")
        context.tool_settings.mesh_select_mode = (True, False, False)
        for ob, vertices in chosen:
            select_vertices(ob, vertices, self.extend)
        count = sum(len(vertices) for _, vertices in chosen)
        self.tell({"INFO"}, f"Selected {counted(count, 'vertex', 'vertices')}.")
        return {"FINISHED"}

    def _vertices(self, ob):
        if self.category != "ALL":
            return problem_vertices(ob, self.category.lower())
        if kept_report(ob) is None:
            return None
        found = {v for name in CATEGORIES if name not in NOTED for v in problem_vertices(ob, name).tolist()}
        return sorted(found)
