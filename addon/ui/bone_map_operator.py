# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators on a target's bone list have in common."""

from ..blender.armature import find_armature
from ..core.errors import InputError
from .operator_base import DermisOperator
from .selection import missing_selection, single_target


class BoneMapOperator(DermisOperator):
    """Works on the bone list of the only target; `needs_rows` when there must be one."""

    needs_rows = True

    @classmethod
    def poll(cls, context):
        """A source and exactly one target are needed."""
        reason = missing_selection(context)
        if not reason:
            target = single_target(context)
            if target is None:
                reason = "Select one target only: each target has a bone list of its own."
            elif cls.needs_rows and not target.dermis_retarget.bone_map:
                reason = f"'{target.name}' has no bone list: map the bones first."
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def chosen(self, context):
        """The target's properties and the index of the chosen row."""
        kept = single_target(context).dermis_retarget
        if not 0 <= kept.active_bone_pair < len(kept.bone_map):
            raise InputError("No bone is chosen in the list.")
        return kept, kept.active_bone_pair


def armatures(source, target):
    """Armatures of a source and a target; a target without one gets the source's. None where the source has none."""
    own = find_armature(source)
    return own, find_armature(target) or own
