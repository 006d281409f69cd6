# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that removes all landmark pairs of a target."""

import bpy

from .landmark_operator import LandmarkOperator


class DERMIS_OT_landmark_clear(LandmarkOperator, bpy.types.Operator):
    """Empties the only target's landmarks."""

    bl_idname = "dermis.landmark_clear"
    bl_label = "Clear Landmarks"
    bl_description = "Remove all landmark pairs of the target"
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context):
        """Remove all pairs."""
        kept, _ = self.chosen(context)
        kept.landmarks.clear()
        kept.active_landmark = 0
        kept.landmark_source = None
        return {"FINISHED"}
