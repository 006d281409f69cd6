# SPDX-License-Identifier: GPL-3.0-or-later
"""The one way in which operators fail."""

import logging
from collections.abc import Callable

from dermis_native import Cancelled

from ..batch.reports import hear
from ..core.errors import InputError, sentence

log = logging.getLogger(__name__)

NOTHING_CHANGED = "Nothing was changed."


class DermisOperator:
    """Mixin for operators: `run` does the work, and an exception leaves it as one report."""

    @classmethod
    def missing(cls, context) -> str:  # noqa: ARG003  (for those that ask)
        """What the user has to do before it can start; empty when nothing is missing."""
        return ""

    @classmethod
    def poll(cls, context):
        """Whether nothing is missing; otherwise the tooltip says what."""
        reason = cls.missing(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def tell(self, levels: set[str], text: str) -> None:
        """Report to the user, and to a command that called the operator; Blender allows no other `report`."""
        hear(levels, text)
        self.report(levels, text)

    def execute(self, context):
        """Run straight through."""
        return self.guarded(lambda: self.run(context))

    def guarded(self, step: Callable[[], set[str]]) -> set[str]:
        """Take a step; turn what it raises into a report and CANCELLED."""
        try:
            return step()
        except Cancelled:
            return self.cancelled()
        except InputError as error:
            self.tell({"ERROR"}, f"{sentence(str(error))} {NOTHING_CHANGED}")
        except Exception as error:
            log.exception("%s failed", self.bl_idname)
            self.tell(
                {"ERROR"},
                f"Unexpected {type(error).__name__}: {sentence(str(error))} {NOTHING_CHANGED} The console has details.",
            )
        return {"CANCELLED"}

    def cancelled(self) -> set[str]:
        """Tell that the user stopped it."""
        self.tell({"WARNING"}, f"Cancelled. {NOTHING_CHANGED}")
        return {"CANCELLED"}
