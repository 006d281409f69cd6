# SPDX-License-Identifier: GPL-3.0-or-later
"""A check of weights from the scene: read, look in a thread, keep the reports."""

import json
from collections.abc import Sequence

import bpy

from ..core.check import Checked, CheckReport, CheckSettings
from ..core.check_task import CheckTask, RetargetCheckTask
from ..core.errors import InputError
from ..core.retarget import FILLED
from .armature import find_armature, read_bones
from .check_reports import keep_report
from .match_display import kept_status
from .mesh import read_surface
from .retarget_job import RetargetJob
from .vertex_groups import read_groups

TEXT = "Dermis Check"


class CheckJob:
    """Reads what is there in the constructor; changes nothing."""

    def __init__(
        self, objects: Sequence[bpy.types.Object], settings: CheckSettings, depsgraph: bpy.types.Depsgraph
    ) -> None:
        self.objects = tuple(objects)
        self.task: CheckTask | RetargetCheckTask = CheckTask([_read(ob, depsgraph) for ob in objects], settings)

    @classmethod
    def of_retargeting(cls, retargeting: RetargetJob, settings: CheckSettings) -> "CheckJob":
        """A check of what a retargeting would write."""
        job = cls.__new__(cls)
        job.objects = retargeting.objects
        job.task = RetargetCheckTask(retargeting.source, retargeting.targets, retargeting.task, settings)
        return job

    def finish(self) -> list[CheckReport]:
        """Keep the reports for the panel and for selecting."""
        reports = self.task.result()
        try:
            for ob, report in zip(self.objects, reports, strict=True):
                keep_report(ob, report)
        except ReferenceError as error:
            raise InputError("A mesh was removed while it was being checked.") from error
        return reports


def write_text(reports: Sequence[CheckReport], as_json: bool) -> bpy.types.Text:
    """The reports as a text of the file, in the place of those of an earlier check."""
    name = f"{TEXT}.json" if as_json else TEXT
    text = bpy.data.texts.get(name) or bpy.data.texts.new(name)
    if as_json:
        content = json.dumps([report.as_dict() for report in reports], indent=1)
    else:
        content = "\n\n".join("\n".join(report.lines()) for report in reports) + "\n"
    text.from_string(content)
    return text


def _read(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Checked:
    armature = find_armature(ob)
    if armature is None:
        raise InputError(f"'{ob.name}' has no armature: there are no bones to check its weights by.")
    if ob.mode == "EDIT":
        ob.update_from_editmode()
    bones = read_bones(armature)
    groups = read_groups(ob)
    status = kept_status(ob)
    return Checked(
        name=ob.name,
        armature=armature.name,
        surface=read_surface(ob, depsgraph, False),
        bones=bones,
        weights=groups.of_bones(bones.names),
        boneless_groups=tuple(name for name in groups.names if name not in set(bones.names)),
        filled=None if status is None else status == FILLED,
    )
