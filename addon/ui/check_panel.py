# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of the check in the sidebar of the 3D viewport."""

import bpy

from ..blender.check_reports import kept_report
from ..core.check import CATEGORIES
from ..core.errors import counted
from .check_select import LABELS, DERMIS_OT_select_problems
from .check_weights import DERMIS_OT_check
from .panel import SidebarPanel
from .selection import checked_meshes, missing_selection
from .text import draw_missing, draw_text


class DERMIS_PT_check(SidebarPanel, bpy.types.Panel):
    """The button, and what the last check of each selected mesh found."""

    bl_label = "Check Weights"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draw the panel."""
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        draw_missing(layout, DERMIS_OT_check, context)
        column = layout.column(align=True)
        column.operator(DERMIS_OT_check.bl_idname, icon="VIEWZOOM").use_retarget = False
        if not missing_selection(context):
            column.operator(DERMIS_OT_check.bl_idname, text="Dry Run of Retarget Weights").use_retarget = True
        reports = [report for ob in checked_meshes(context) if (report := kept_report(ob)) is not None]
        for report in reports:
            box = layout.box().column(align=True)
            draw_text(box, report.lines()[0], context, icon="ERROR" if report.faults else "CHECKMARK")
            for note in report.notes:
                draw_text(box, note, context)
        column = layout.column(align=True)
        for category in CATEGORIES:
            count = sum(len(report.vertices.get(category, ())) for report in reports)
            if count:
                text = f"{LABELS[category]}: {counted(count, 'vertex', 'vertices')}"
                button = column.operator(DERMIS_OT_select_problems.bl_idname, text=text, icon="RESTRICT_SELECT_OFF")
                button.category = category.upper()


CLASSES = (DERMIS_PT_check,)
