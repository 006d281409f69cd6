# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that looks at weights and tells what to look at."""

import math

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty

from ..blender.check_job import CheckJob, write_text
from ..core.check import CheckSettings, summary
from ..core.errors import InputError
from .modal_job import ModalJobOperator
from .retarget_options import RetargetOptions
from .selection import checked_meshes, missing_selection, source_of, targets_of


class DERMIS_OT_check(RetargetOptions, ModalJobOperator, bpy.types.Operator):
    """The selected meshes, or what a retargeting to them would give."""

    bl_idname = "dermis.check"
    bl_label = "Check Weights"
    bl_description = (
        "Look for vertices without weights, totals other than 1, weights on the wrong side or finger, and edges that "
        "stretch when joints turn. Changes nothing"
    )
    bl_options = {"REGISTER", "UNDO", "PRESET"}
    doing = "Checking"

    use_retarget: BoolProperty(
        name="Dry Run of Retarget Weights",
        description="Check the weights that Retarget Weights would give to the other selected meshes with these "
        "options, instead of the weights that the selected meshes have",
        default=False,
    )
    most_influences: IntProperty(
        name="Influences",
        description="Report vertices that follow more bones than this; 0 for any number",
        min=0,
        soft_max=8,
        max=64,
        default=4,
    )
    angle: FloatProperty(
        name="Angle",
        description="How far each joint turns both ways around each axis, one joint at a time, to see what stretches",
        min=0.0,
        max=math.pi,
        soft_max=math.pi / 2,
        default=math.pi / 4,
        subtype="ANGLE",
    )
    stretch: FloatProperty(
        name="Stretch",
        description="Report edges that become longer than this many times their length at rest",
        min=1.0,
        soft_max=10.0,
        default=2.0,
    )
    output: EnumProperty(
        name="Output",
        description="Where the whole report goes besides the panel",
        items=(
            ("NONE", "Panel Only", "Nowhere else"),
            ("TEXT", "Text", "The text 'Dermis Check' of this file"),
            ("JSON", "JSON", "The text 'Dermis Check.json' of this file, with the indices of all vertices found"),
        ),
        default="NONE",
    )

    @classmethod
    def missing(cls, context) -> str:
        """A mesh is needed."""
        return "" if checked_meshes(context) else "Select a mesh to check."

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        column = layout.column(align=True)
        for name in ("angle", "stretch", "most_influences"):
            column.prop(self, name)
        layout.prop(self, "output")
        layout.prop(self, "use_retarget")
        if self.use_retarget:
            self.draw_retarget(context)

    def job(self, context) -> CheckJob:
        """Read and check what is selected."""
        settings = CheckSettings(self.most_influences or None, math.degrees(self.angle), self.stretch)
        if not self.use_retarget:
            return CheckJob(checked_meshes(context), settings, context.evaluated_depsgraph_get())
        reason = missing_selection(context)
        if not reason and any(ob.mode == "EDIT" for ob in (source_of(context), *targets_of(context))):
            reason = "Leave Edit Mode first."
        if reason:
            raise InputError(reason)
        return CheckJob.of_retargeting(self.retarget_job(context), settings)

    def finished(self, job: CheckJob) -> set[str]:
        """Keep the reports and tell what was found."""
        reports = job.finish()
        if self.output != "NONE":
            write_text(reports, self.output == "JSON")
        self.tell({"WARNING"} if any(report.faults for report in reports) else {"INFO"}, summary(reports))
        return {"FINISHED"}
