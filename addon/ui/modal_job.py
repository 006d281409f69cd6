# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators whose work runs in a thread: Blender stays responsive, ESC ends them at once."""

import bpy

from ..core.background import POLL_SECONDS
from .operator_base import DermisOperator

# A job that ends this soon needs no modal state.
PATIENCE_SECONDS = 0.2
# Without a window progress is printed at each new stage and after each such share.
PRINTED_SHARE = 0.1


class ModalJobOperator(DermisOperator):
    """Mixin: `job(context)` reads everything, its `task` works, `finished(job)` writes and reports.

    `doing` names the work in the status bar. `ended` may ask the user before anything is written.
    """

    doing = "Working"

    def run(self, context):
        """Work while Blender waits."""
        job = self.job(context)
        manager = context.window_manager
        manager.progress_begin(0, 100)
        said, next_share = "", 0.0

        def show(fraction):
            nonlocal said, next_share
            manager.progress_update(int(100 * fraction))
            stage = job.task.stage
            if bpy.app.background and (stage != said or fraction >= next_share):
                said, next_share = stage, fraction + PRINTED_SHARE
                print(f"{self.doing}: {stage} ({fraction:.0%})", flush=True)

        try:
            job.task.run(show)
        finally:
            manager.progress_end()
        return self.finished(job)

    def invoke(self, context, event):
        """Work while Blender stays responsive, where it has a window."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        return self.guarded(lambda: self._start(context))

    def modal(self, context, event):
        """Watch the thread; ESC ends the operator without waiting for it."""
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            return self.cancelled()
        if event.type == "TIMER":
            if self._running.task.wait(0):
                self._end_modal(context)
                return self.guarded(lambda: self.ended(context, watched=True))
            self._show_progress(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context):
        """Blender ends the operator, for instance because another file is opened."""
        self._running.task.abandon()
        self._end_modal(context)

    def ended(self, context, watched: bool) -> set[str]:
        """The work has ended in a window; `watched` says whether events reach the operator already."""
        return self.finished(self._running)

    def _start(self, context) -> set[str]:
        self._running = self.job(context)
        self._running.task.start()
        if self._running.task.wait(PATIENCE_SECONDS):
            return self.ended(context, watched=False)
        manager = context.window_manager
        self._timer = manager.event_timer_add(POLL_SECONDS, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        self._show_progress(context)
        return {"RUNNING_MODAL"}

    def _show_progress(self, context) -> None:
        task = self._running.task
        context.window_manager.progress_update(int(100 * task.fraction))
        context.workspace.status_text_set(f"{self.doing}: {task.stage} ({task.fraction:.0%})    ESC: cancel")

    def _end_modal(self, context) -> None:
        manager = context.window_manager
        manager.event_timer_remove(self._timer)
        manager.progress_end()
        context.workspace.status_text_set(None)
