# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators on a target's bone list have in common."""

from ..blender.armature import find_armature
from .target_operator import TargetOperator


class BoneMapOperator(TargetOperator):
    """Works on the bone list of the only target."""

    rows, active_row = "bone_map", "active_bone_pair"
    several = "Select one target only: each target has a bone list of its own."
    nothing = "'{}' has no bone list: map the bones first."
    none_chosen = "No bone is chosen in the list."


def armatures(source, target):
    """Armatures of a source and a target; a target without one gets the source's. None where the source has none."""
    own = find_armature(source)
    return own, find_armature(target) or own
