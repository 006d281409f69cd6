# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators on existing landmark pairs have in common."""

from .target_operator import TargetOperator


class LandmarkOperator(TargetOperator):
    """Works on the landmarks of the only target."""

    rows, active_row = "landmarks", "active_landmark"
    several = "Select one target only: each target has landmarks of its own."
    nothing = "'{}' has no landmarks."
    none_chosen = "No landmark is chosen in the list."
