# SPDX-License-Identifier: GPL-3.0-or-later
"""The one line that tells what was done."""

from __future__ import annotations

from .character import Source
from .errors import counted, listed
from .retarget import TargetWeights


def retarget_line(source: Source, results: dict[str, TargetWeights], seconds: float) -> str:
    """What the targets, by name, got from the source."""
    values = list(results.values())
    to = f"'{next(iter(results))}'" if len(results) == 1 else counted(len(results), "mesh", "meshes")
    vertices = sum(len(value.replaced) for value in values)
    parts = [
        counted(vertices, "vertex", "vertices"),
        counted(max(len(value.groups) for value in values), "bone"),
        f"at most {counted(max(value.influences for value in values), 'influence')}",
        counted(sum(value.landmarks for value in values), "landmark"),
        f"{sum(value.matched for value in values):,} matched",
        f"{sum(value.filled for value in values):,} filled",
        f"{seconds:.2f} s",
    ]
    return f"Weights of '{source.name}' given to {to}: {', '.join(parts)}."


def retarget_notes(source: Source, results: dict[str, TargetWeights]) -> list[str]:
    """Sentences on what was left out, empty when nothing was."""
    notes = []
    if source.ignored_groups:
        groups = counted(len(source.ignored_groups), "group")
        notes.append(f"{groups} without a bone ignored: {listed(source.ignored_groups)}.")
    for name, value in results.items():
        if value.only_in_target:
            notes.append(
                f"'{name}' has bones that the source lacks, left without weights: {listed(value.only_in_target)}."
            )
    return notes
