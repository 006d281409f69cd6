# SPDX-License-Identifier: GPL-3.0-or-later
"""One retargeting from the scene and back into it: read, work in a thread, write."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import bpy

from ..core.errors import InputError
from ..core.report import retarget_line, retarget_notes
from ..core.retarget import RetargetSettings
from ..core.task import RetargetTask
from .retarget import TargetChoice, read_source, read_target, write_targets
from .scope import Scope


@dataclass(frozen=True)
class GeometryChoice:
    """Whether the shape that is shown now is used instead of the rest shape."""

    source_evaluated: bool = False
    target_evaluated: bool = False


class RetargetJob:
    """Reads everything and checks it in the constructor; `finish` writes, then `results` holds what."""

    def __init__(
        self,
        source: bpy.types.Object,
        objects: Sequence[bpy.types.Object],
        choices: Sequence[TargetChoice],
        geometry: GeometryChoice,
        settings: RetargetSettings,
        depsgraph: bpy.types.Depsgraph,
        scope: Scope | None = None,
        show_match: bool = False,
    ) -> None:
        self._began = perf_counter()
        self._show_match = show_match
        self.settings = settings
        scope = scope or Scope()
        scope.check(objects)
        self._source_object = source
        self.objects = tuple(objects)
        self.source = read_source(source, depsgraph, geometry.source_evaluated)
        self.targets = [
            read_target(ob, source, depsgraph, geometry.target_evaluated, choice, scope, self.source.boneless_groups)
            for ob, choice in zip(objects, choices, strict=True)
        ]
        self.task = RetargetTask(self.source, self.targets, settings)

    def finish(self) -> tuple[str, list[str]]:
        """Write the results; the line to report and notes on what was left out."""
        results = self.task.result()
        try:
            write_targets(self._source_object, self.objects, self.targets, results, self._show_match)
        except ReferenceError as error:
            raise InputError("A mesh was removed while its weights were being retargeted.") from error
        named = {target.name: result for target, result in zip(self.targets, results, strict=True)}
        line = retarget_line(self.source, named, perf_counter() - self._began)
        self.results = tuple(results)
        copied = any(target.copied_groups for target in self.targets)
        return line, retarget_notes(self.source, named, copied, self.settings.keep_unmapped)
