# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that gives the selected meshes the weights of the active one."""

import bpy
import numpy as np
from bpy.props import BoolProperty

from ..blender.match_display import keep_status
from ..blender.retarget_job import RetargetJob
from ..blender.selected_vertices import select_vertices
from ..core.retarget import FILLED
from .modal_job import ModalJobOperator
from .retarget_options import RetargetOptions
from .selection import missing_selection, source_of, targets_of


class DERMIS_OT_retarget_weights(RetargetOptions, ModalJobOperator, bpy.types.Operator):
    """Active mesh to the other selected meshes."""

    bl_idname = "dermis.retarget_weights"
    bl_label = "Retarget Weights"
    bl_description = (
        "Give the selected meshes the bone weights of the active mesh, matched over the surfaces. "
        "Locked vertex groups stay as they are"
    )
    bl_options = {"REGISTER", "UNDO", "PRESET"}
    doing = "Retargeting"

    select_filled: BoolProperty(
        name="Select Filled Vertices",
        description="Select the vertices that were not matched but filled in from their neighbors, for a look at them",
        default=False,
    )
    show_match: BoolProperty(
        name="Color Attribute",
        description="Show in the color attribute 'Dermis Match' which vertices were matched (blue), filled in "
        "(orange), treated as loose parts (violet) or left as they were (gray)",
        default=False,
    )

    @classmethod
    def missing(cls, context) -> str:
        """A source and a target are needed, outside Edit Mode."""
        reason = missing_selection(context)
        if not reason and any(ob.mode == "EDIT" for ob in (source_of(context), *targets_of(context))):
            reason = "Leave Edit Mode first."
        return reason

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        self.draw_retarget(context)
        column = layout.column(align=True)
        column.prop(self, "select_filled")
        column.prop(self, "show_match")

    def job(self, context) -> RetargetJob:
        """Read and check what is selected."""
        return self.retarget_job(context, self.show_match)

    def finished(self, job: RetargetJob) -> set[str]:
        """Write the weights and tell what was done."""
        line, notes = job.finish()
        for ob, result in zip(job.objects, job.results, strict=True):
            ob.dermis_retarget.result = " ".join([line, *notes])
            keep_status(ob, result.status)
            if self.select_filled:
                select_vertices(ob, np.flatnonzero(result.status == FILLED))
        self.tell({"INFO"}, " ".join([line, *notes]))
        return {"FINISHED"}
