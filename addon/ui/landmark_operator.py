# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators on existing landmark pairs have in common."""

from ..core.errors import InputError
from .operator_base import DermisOperator
from .selection import missing_selection, single_target


class LandmarkOperator(DermisOperator):
    """Works on the landmarks of the only target."""

    @classmethod
    def poll(cls, context):
        """A source and exactly one target with landmarks are needed."""
        reason = missing_selection(context)
        if not reason:
            target = single_target(context)
            if target is None:
                reason = "Select one target only: each target has landmarks of its own."
            elif not target.dermis_retarget.landmarks:
                reason = f"'{target.name}' has no landmarks."
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def chosen(self, context):
        """The target's properties and the index of the chosen pair."""
        kept = single_target(context).dermis_retarget
        if not 0 <= kept.active_landmark < len(kept.landmarks):
            raise InputError("No landmark is chosen in the list.")
        return kept, kept.active_landmark
