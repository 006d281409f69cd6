# SPDX-License-Identifier: GPL-3.0-or-later
"""The last check of each mesh, for the panel and for selecting, kept outside the file."""

import bpy
import numpy as np

from ..core.check import CheckReport
from ..core.retarget import FILLED
from .match_display import kept_status
from .selected_vertices import vertex_count

# By the session's id of an object: it outlives undo, and is never used again for another object.
_reports: dict[int, CheckReport] = {}


def keep_report(ob: bpy.types.Object, report: CheckReport) -> None:
    """Remember the last report of an object."""
    _reports[ob.session_uid] = report


def kept_report(ob: bpy.types.Object) -> CheckReport | None:
    """The last report of an object, None without one or where the mesh has other vertices now."""
    report = _reports.get(ob.session_uid)
    return report if report is not None and report.vertex_count == vertex_count(ob) else None


def forget_reports() -> None:
    """Forget all, when the add-on ends."""
    _reports.clear()


def problem_vertices(ob: bpy.types.Object, category: str) -> np.ndarray | None:
    """Vertices of a category of the last check, None where these vertices were not checked.

    Those that were filled in are known from the last retargeting too.
    """
    report = kept_report(ob)
    if report is not None and (category in report.vertices or category != "filled"):
        return report.vertices.get(category, np.empty(0, np.int32))
    status = kept_status(ob) if category == "filled" else None
    return None if status is None else np.flatnonzero(status == FILLED)
