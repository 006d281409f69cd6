# SPDX-License-Identifier: GPL-3.0-or-later
"""Retargeting in a thread of its own: one source, one or several targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dermis_native import Cancelled

from .character import Source, Target
from .mirror import left_shares, mirrored_source
from .native_task import NativeTask
from .parts import check_part_vertices
from .retarget import (
    FoundWeights,
    RetargetSettings,
    TargetWeights,
    check_source,
    check_target,
    find_weights,
    fit_weights,
    two_halves,
)
from .seams import close_seams


class RetargetTask(NativeTask[list[TargetWeights]]):
    """Retargets one source to several targets, one after the other.

    Bad input raises at once, in the constructor. The thread touches nothing but its arrays.
    """

    def __init__(self, source: Source, targets: Sequence[Target], settings: RetargetSettings) -> None:
        check_source(source)
        check_part_vertices(settings.parts, targets)
        for target in targets:
            check_target(source, target)
            if settings.runs == 2:
                left_shares(target)
        self._source = source
        self._mirrored = source if settings.mirror == "none" else mirrored_source(source)
        self._targets = tuple(targets)
        self.settings = settings
        super().__init__("dermis-retarget", len(self._targets) * settings.runs)

    @property
    def stage(self) -> str:
        """What is being done now."""
        current = min(self._current, len(self._progress) - 1)
        target = self._targets[current // self.settings.runs]
        prefix = f"{target.name}: " if len(self._targets) > 1 else ""
        return prefix + super().stage

    def work(self) -> list[TargetWeights]:
        """One result for each target."""
        return self._fitted([self._found(target) for target in self._targets])

    def _found(self, target: Target) -> FoundWeights:
        """The weights of one target, from one run or, for two halves, from two."""
        mirror = self.settings.mirror
        first = self._mirrored if mirror == "flip" else self._source
        plain = self._run(first, target)
        if self.settings.runs == 1:
            return plain
        # The user's pairs hold for the source as it is, not for its mirror image.
        mirrored = self._run(self._mirrored, replace(target, landmarks=None))
        return two_halves(target, plain, mirrored, mirror)

    def _run(self, source: Source, target: Target) -> FoundWeights:
        progress = self._progress[self._current]
        if progress.cancelled:
            raise Cancelled("cancelled")
        found = find_weights(source, target, self.settings, progress)
        self._current += 1
        return found

    def _fitted(self, found: Sequence[FoundWeights]) -> list[TargetWeights]:
        weights = [each.weights for each in found]
        seams = [0] * len(found)
        if self.settings.close_seams:
            surfaces = [target.surface for target in self._targets]
            weights, seams = close_seams(surfaces, weights, [target.bones.names for target in self._targets])
        return [
            fit_weights(target, replace(each, weights=own), self.settings, count)
            for target, each, own, count in zip(self._targets, found, weights, seams, strict=True)
        ]
