# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that gives the selected meshes the weights of the active one."""

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty

from ..blender.retarget_job import POLL_SECONDS, GeometryChoice, RetargetJob
from ..core.retarget import RetargetSettings
from .operator_base import DermisOperator
from .selection import landmark_pairs, missing_selection, source_of, targets_of

# A job that ends this soon needs no modal state.
PATIENCE_SECONDS = 0.2

GEOMETRY = (
    ("REST", "Rest", "The mesh and the bones as they were made, without shape keys, modifiers and pose"),
    ("EVALUATED", "Evaluated", "The mesh and the bones as they are shown now, with shape keys, modifiers and pose"),
)


class DERMIS_OT_retarget_weights(DermisOperator, bpy.types.Operator):
    """Active mesh to the other selected meshes (Algorithm 2)."""

    bl_idname = "dermis.retarget_weights"
    bl_label = "Retarget Weights"
    bl_description = (
        "Give the selected meshes the bone weights of the active mesh, matched over the surfaces. "
        "Locked vertex groups and groups without a bone stay as they are"
    )
    bl_options = {"REGISTER", "UNDO"}

    method: EnumProperty(
        name="Method",
        description="How the vertices of the target find their place on the source",
        items=(
            ("AUTO", "Auto", "The best method that Dermis has"),
            ("PAPER", "Paper", "Biharmonic distances to landmarks and Shepard interpolation, as published"),
        ),
        default="AUTO",
    )
    use_landmarks: BoolProperty(
        name="Use Landmarks",
        description="Use the landmark pairs of the target, if it has any; otherwise they are chosen on the skeletons",
        default=True,
    )
    source_geometry: EnumProperty(
        name="Source Geometry", description="Shape of the source that is matched", items=GEOMETRY, default="REST"
    )
    target_geometry: EnumProperty(
        name="Target Geometry", description="Shape of the targets that is matched", items=GEOMETRY, default="REST"
    )
    max_influences: IntProperty(
        name="Limit Influences",
        description="Most bones that one vertex may follow; 0 for any number. Game engines often want 4",
        min=0,
        soft_max=8,
        max=64,
        default=0,
    )
    eigenpairs: IntProperty(
        name="Eigenpairs",
        description="Number of surface harmonics behind the biharmonic distance; more are more exact and slower",
        min=10,
        soft_max=300,
        max=1000,
        default=100,
    )
    replace: BoolProperty(
        name="Replace Existing",
        description="Replace the bone weights that the target has; otherwise only vertices without any get weights",
        default=True,
    )

    @classmethod
    def poll(cls, context):
        """A source and a target are needed, outside Edit Mode."""
        reason = missing_selection(context)
        if not reason and any(ob.mode == "EDIT" for ob in (source_of(context), *targets_of(context))):
            reason = "Leave Edit Mode first."
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def draw(self, context):
        """Draw the options of Adjust Last Operation."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "method")
        layout.prop(self, "use_landmarks")
        layout.prop(self, "eigenpairs")
        column = layout.column(align=True)
        column.prop(self, "source_geometry")
        column.prop(self, "target_geometry", text="Target")
        column = layout.column(align=True)
        column.prop(self, "max_influences")
        column.prop(self, "replace")

    def run(self, context):
        """Retarget while Blender waits."""
        job = self._job(context)
        manager = context.window_manager
        manager.progress_begin(0, 100)
        try:
            job.run(lambda fraction: manager.progress_update(int(100 * fraction)))
        finally:
            manager.progress_end()
        return self._finish(job)

    def invoke(self, context, event):
        """Retarget while Blender stays responsive, where it has a window."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        return self.guarded(lambda: self._start(context))

    def modal(self, context, event):
        """Watch the thread; ESC stops it."""
        if event.type == "ESC" and event.value == "PRESS":
            self._running.task.cancel()
        elif event.type == "TIMER":
            if self._running.task.wait(0):
                self._end_modal(context)
                return self.guarded(lambda: self._finish(self._running))
            self._show_progress(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context):
        """Blender ends the operator, for instance because another file is opened."""
        self._running.task.cancel()
        self._end_modal(context)

    def _job(self, context) -> RetargetJob:
        source, targets = source_of(context), targets_of(context)
        landmarks = [landmark_pairs(source, ob) if self.use_landmarks else [] for ob in targets]
        return RetargetJob(
            source,
            targets,
            landmarks,
            GeometryChoice(self.source_geometry == "EVALUATED", self.target_geometry == "EVALUATED"),
            RetargetSettings(
                method=self.method.lower(),
                max_influences=self.max_influences or None,
                eigenpairs=self.eigenpairs,
                replace=self.replace,
            ),
            context.evaluated_depsgraph_get(),
        )

    def _finish(self, job: RetargetJob) -> set[str]:
        line, notes = job.finish()
        for ob in job.objects:
            ob.dermis_retarget.result = " ".join([line, *notes])
        self.report({"INFO"}, " ".join([line, *notes]))
        return {"FINISHED"}

    def _start(self, context) -> set[str]:
        self._running = self._job(context)
        self._running.task.start()
        if self._running.task.wait(PATIENCE_SECONDS):
            return self._finish(self._running)
        manager = context.window_manager
        self._timer = manager.event_timer_add(POLL_SECONDS, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        self._show_progress(context)
        return {"RUNNING_MODAL"}

    def _show_progress(self, context) -> None:
        task = self._running.task
        context.window_manager.progress_update(int(100 * task.fraction))
        context.workspace.status_text_set(f"Retargeting: {task.stage} ({task.fraction:.0%})    ESC: cancel")

    def _end_modal(self, context) -> None:
        manager = context.window_manager
        manager.event_timer_remove(self._timer)
        manager.progress_end()
        context.workspace.status_text_set(None)
