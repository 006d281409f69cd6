# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks in a thread of their own, of weights that are there or of those that a retargeting would give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .background import BackgroundTask
from .character import BoneWeights, Source, Target
from .check import Checked, CheckReport, CheckSettings, check
from .check_seams import open_seams
from .report import mapping_line, retarget_notes
from .retarget import FILLED, TargetWeights
from .stepped_task import SteppedTask
from .task import RetargetTask

# Share of the work that a retargeting takes where there is one.
RETARGET_SHARE = 0.7


class CheckTask(SteppedTask[list[CheckReport]]):
    """Checks meshes one after the other."""

    def __init__(self, checked: Sequence[Checked], settings: CheckSettings) -> None:
        super().__init__("dermis-check")
        self._checked = list(checked)
        self._settings = settings

    def work(self) -> list[CheckReport]:
        """One report for each mesh."""
        reports = []
        for each in self._checked:
            each.surface.check(each.name)
        seams = open_seams(
            [each.surface for each in self._checked],
            [each.weights for each in self._checked],
            [each.bones.names for each in self._checked],
        )
        for index, each in enumerate(self._checked):
            self._stage = each.name

            def step(share: float, done: int = index) -> None:
                self._step((done + share) / len(self._checked))

            step(0.0)
            reports.append(check(replace(each, seams=seams[index]), self._settings, step))
        return reports


class RetargetCheckTask(BackgroundTask[list[CheckReport]]):
    """Retargets without writing, then checks what would be written."""

    def __init__(
        self, source: Source, targets: Sequence[Target], retargeting: RetargetTask, settings: CheckSettings
    ) -> None:
        super().__init__("dermis-check")
        self._source = source
        self._targets = tuple(targets)
        self._retargeting = retargeting
        self._settings = settings
        self._checking: CheckTask | None = None
        self._cancelled = False

    def cancel(self) -> None:
        """Ask the thread to stop soon."""
        self._cancelled = True
        self._retargeting.cancel()
        if self._checking is not None:
            self._checking.cancel()

    @property
    def fraction(self) -> float:
        """Share of the work done, 0 to 1."""
        checked = 0.0 if self._checking is None else self._checking.fraction
        return RETARGET_SHARE * self._retargeting.fraction + (1.0 - RETARGET_SHARE) * checked

    @property
    def stage(self) -> str:
        """What is being done now."""
        return self._retargeting.stage if self._checking is None else self._checking.stage

    def work(self) -> list[CheckReport]:
        """One report for each target."""
        results = self._retargeting.work()
        checked = [
            would_be(self._source, target, result, self._retargeting.settings.keep_unmapped)
            for target, result in zip(self._targets, results, strict=True)
        ]
        self._checking = CheckTask(checked, self._settings)
        if self._cancelled:
            self._checking.cancel()
        return self._checking.work()


def would_be(source: Source, target: Target, result: TargetWeights, kept: bool = False) -> Checked:
    """The target with the weights that it would have; `kept` when its own bones keep theirs."""
    return Checked(
        target.name,
        target.armature,
        target.surface,
        target.bones,
        resulting_weights(target, result),
        filled=result.status == FILLED,
        notes=(
            mapping_line(source.armature, target.armature, result.mapping),
            *retarget_notes(source, {target.name: result}, bool(target.copied_groups), kept),
        ),
    )


def resulting_weights(target: Target, result: TargetWeights) -> BoneWeights:
    """The target's weights on its bones after the result is written."""
    cleared = np.zeros(len(target.surface.vertices), np.bool_)
    cleared[result.replaced] = True
    old = target.existing
    stays = old.where(~(cleared[old.vertex] & result.written[old.bone]))
    return BoneWeights(
        np.concatenate([stays.vertex, result.weights.vertex]),
        np.concatenate([stays.bone, result.weights.bone]),
        np.concatenate([stays.value, result.weights.value]),
    )
