# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that removes a landmark pair."""

import bpy

from .landmark_operator import LandmarkOperator


class DERMIS_OT_landmark_remove(LandmarkOperator, bpy.types.Operator):
    """Removes one of the only target's landmarks."""

    bl_idname = "dermis.landmark_remove"
    bl_label = "Remove Landmark"
    bl_description = "Remove the chosen landmark pair from the list"
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context):
        """Remove the chosen pair and choose the next."""
        kept, index = self.chosen(context)
        kept.landmarks.remove(index)
        kept.active_landmark = max(0, min(index, len(kept.landmarks) - 1))
        return {"FINISHED"}
