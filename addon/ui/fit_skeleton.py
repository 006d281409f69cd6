# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that fits the active armature into the selected meshes."""

import bpy
from bpy.props import BoolProperty, EnumProperty

from ..blender.bone_overlay import BoneOverlay, bone_colors, viewports
from ..blender.fit_job import FitJob, FitOptions
from ..core.fit import fit_counts, fit_notes
from .fit_selection import fit_armature, fit_meshes, missing_fit
from .modal_job import ModalJobOperator
from .operator_base import NOTHING_CHANGED

SYMMETRY = {"AUTO": None, "ON": True, "OFF": False}
APPLY_KEYS = {"RET", "NUMPAD_ENTER"}
CANCEL_KEYS = {"ESC", "RIGHTMOUSE"}
# What moves the view goes on to Blender while the preview is shown.
VIEW_EVENTS = {
    "MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM", "MOUSEROTATE", "MOUSESMARTZOOM",
    "MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "NDOF_MOTION", "HOME", "TIMER", "TIMER_REPORT", "WINDOW_DEACTIVATE",
    "NUMPAD_0", "NUMPAD_1", "NUMPAD_2", "NUMPAD_3", "NUMPAD_4", "NUMPAD_5", "NUMPAD_6", "NUMPAD_7", "NUMPAD_8",
    "NUMPAD_9", "NUMPAD_PLUS", "NUMPAD_MINUS", "NUMPAD_PERIOD",
}  # fmt: skip


class DERMIS_OT_fit_skeleton(ModalJobOperator, bpy.types.Operator):
    """Active armature into the selected meshes."""

    bl_idname = "dermis.fit_skeleton"
    bl_label = "Fit Skeleton"
    bl_description = (
        "Move the rest bones of the active armature to where they belong in the selected meshes, which count as one "
        "body. Both must stand upright and face the same way; place and size do not matter. Bones keep their roll, "
        "connections and all other settings, locked bones stay where they are"
    )
    bl_options = {"REGISTER", "UNDO", "PRESET"}
    doing = "Fitting"

    deform_only: BoolProperty(
        name="Deform Bones Only",
        description="Only bones that deform are placed by the shape of the body; the others, such as controls, are "
        "carried along with them",
        default=True,
    )
    keep_selected: BoolProperty(
        name="Keep Selected Bones",
        description="Bones that are selected in Edit Mode or Pose Mode stay exactly where they are, for instance "
        "joints that you placed by hand; the others are fitted around them",
        default=False,
    )
    symmetry: EnumProperty(
        name="Symmetry",
        description="Whether left and right bones are placed as mirror images",
        items=(
            ("AUTO", "Automatic", "Where both the skeleton and the body have a plane of symmetry"),
            ("ON", "On", "Always: the body's deviations from symmetry are evened out"),
            ("OFF", "Off", "Never: each side is placed by its own shape"),
        ),
        default="AUTO",
    )
    geometry: EnumProperty(
        name="Geometry",
        description="Shape of the meshes that is used",
        items=(
            (
                "EVALUATED",
                "Evaluated",
                "The meshes as they are shown now, with shape keys and modifiers such as Mirror, but without poses",
            ),
            ("REST", "Rest", "The meshes as they were made, without shape keys and modifiers"),
        ),
        default="EVALUATED",
    )
    preview: BoolProperty(
        name="Preview",
        description="Show the bones over the body first, to be applied with Enter; only when called in a window",
        default=True,
    )

    @classmethod
    def missing(cls, context) -> str:
        """An active armature and selected meshes are needed."""
        return missing_fit(context)

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        for names in (("symmetry", "geometry"), ("deform_only", "keep_selected")):
            column = layout.column(align=True)
            for name in names:
                column.prop(self, name)

    def invoke(self, context, event):
        """Work while Blender stays responsive, where it has a window."""
        self._overlay = None
        return ModalJobOperator.invoke(self, context, event)

    def modal(self, context, event):
        """Watch the thread, then wait for the user's answer to the preview."""
        if self._overlay is None:
            return ModalJobOperator.modal(self, context, event)
        if event.value == "PRESS" and event.type in APPLY_KEYS:
            self._end_preview(context)
            return self.guarded(lambda: self.finished(self._running))
        if event.value == "PRESS" and event.type in CANCEL_KEYS:
            self._end_preview(context)
            self.tell({"WARNING"}, f"Cancelled. {NOTHING_CHANGED}")
            return {"CANCELLED"}
        return {"PASS_THROUGH"} if event.type in VIEW_EVENTS else {"RUNNING_MODAL"}

    def cancel(self, context):
        """Blender ends the operator, for instance because another file is opened."""
        if self._overlay is None:
            ModalJobOperator.cancel(self, context)
        else:
            self._end_preview(context)

    def job(self, context) -> FitJob:
        """Read and check what is selected."""
        return FitJob(
            fit_armature(context),
            fit_meshes(context),
            FitOptions(
                deform_only=self.deform_only,
                keep_selected=self.keep_selected,
                symmetric=SYMMETRY[self.symmetry],
                evaluated=self.geometry == "EVALUATED",
            ),
            context.evaluated_depsgraph_get(),
        )

    def ended(self, context, watched):
        """Show the bones where they would be, and wait; or move them at once."""
        if not self.preview:
            return self.finished(self._running)
        job, fitted = self._running, self._running.fitted()
        self._overlay = BoneOverlay(fitted.heads, fitted.tails, bone_colors(fitted.found, job.template.fixed))
        try:
            counts = ", ".join(fit_counts(job.template, fitted))
            notes = " ".join([f"{counts} (blue: placed, orange: carried along, gray: kept).", *fit_notes(fitted)])
            text = f"Preview: {notes}    Enter: apply, ESC: cancel"
            context.workspace.status_text_set(text)
            for area in viewports():
                area.header_text_set(text)
            if not watched:
                context.window_manager.modal_handler_add(self)
        except BaseException:
            self._end_preview(context)
            raise
        return {"RUNNING_MODAL"}

    def finished(self, job: FitJob) -> set[str]:
        """Move the bones and tell what was done."""
        line, notes = job.finish()
        self.tell({"WARNING" if notes else "INFO"}, " ".join([line, *notes]))
        return {"FINISHED"}

    def _end_preview(self, context) -> None:
        self._overlay.remove()
        self._overlay = None
        context.workspace.status_text_set(None)
        for area in viewports():
            area.header_text_set(None)
