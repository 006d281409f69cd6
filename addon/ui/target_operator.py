# SPDX-License-Identifier: GPL-3.0-or-later
"""What operators on the lists of a single target have in common."""

from ..core.errors import InputError
from .operator_base import DermisOperator
from .selection import missing_selection, single_target


class TargetOperator(DermisOperator):
    """Works on a list of the only target, named `rows`, whose active row is `active_row`."""

    rows = ""
    active_row = ""
    needs_rows = True
    # What the poll and the errors say: `several` targets selected, `nothing` in the list, no row chosen.
    several = ""
    nothing = ""
    none_chosen = ""

    @classmethod
    def missing(cls, context) -> str:
        """A source and exactly one target are needed, with a list where `needs_rows`."""
        reason = missing_selection(context)
        if not reason:
            target = single_target(context)
            if target is None:
                reason = cls.several
            elif cls.needs_rows and not getattr(target.dermis_retarget, cls.rows):
                reason = cls.nothing.format(target.name)
        return reason

    def chosen(self, context):
        """The target's properties and the index of the chosen row."""
        kept = single_target(context).dermis_retarget
        index = getattr(kept, self.active_row)
        if not 0 <= index < len(getattr(kept, self.rows)):
            raise InputError(self.none_chosen)
        return kept, index
