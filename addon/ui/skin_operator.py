# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators on skins share."""

from .operator_base import DermisOperator
from .skin_selection import missing_meshes


class SkinOperator(DermisOperator):
    """Works on all meshes of the active armature, or on the selected meshes."""

    @classmethod
    def missing(cls, context) -> str:
        """An armature or meshes are needed, outside Edit Mode."""
        reason = missing_meshes(context)
        if not reason and context.mode.startswith("EDIT"):
            reason = "Leave Edit Mode first."
        return reason
