# SPDX-License-Identifier: GPL-3.0-or-later
"""The one line that tells what was done."""

from __future__ import annotations

from collections import Counter

import numpy as np

from .bones import HOW, BoneMapping
from .character import Source
from .errors import counted, listed
from .parts import told
from .retarget import TargetWeights

# Bones that are named before the rest is counted.
SHOWN = 8

# What is said of the shape in which the source was read.
SHAPES = {
    "evaluated": "The source was taken as it is shown, with pose, shape keys and modifiers.",
    "pose ignored": "The source was taken at rest, its pose left aside.",
}


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
        *_extras(values),
        *_mapped(values),
        f"{seconds:.2f} s",
    ]
    return f"Weights of '{source.name}' given to {to}: {', '.join(parts)}."


def retarget_notes(
    source: Source, results: dict[str, TargetWeights], copied: bool = False, kept: bool = False
) -> list[str]:
    """Sentences on what was left out, empty when nothing was; `copied` when groups without a bone
    went along, `kept` when bones of a target alone kept their weights.
    """
    notes = []
    if source.shape in SHAPES:
        notes.append(SHAPES[source.shape])
    if source.boneless_groups and not copied:
        groups = counted(len(source.boneless_groups), "group")
        notes.append(f"{groups} without a bone ignored: {listed(source.boneless_groups)}.")
    for name, value in results.items():
        if set(value.mapping.counts()) == {"structure"}:
            pairs = [f"'{pair.source}' to '{pair.target}'" for pair in value.mapping.rows() if pair.target]
            notes.append(f"No bone names in common with '{name}', check the bones: {_shown(pairs)}.")
        alone = value.mapping.only_in_target
        carrying = {value.mapping.target[bone] for bone in value.groups}
        shared = [bone for bone in alone if bone in carrying]
        empty = [bone for bone in alone if bone not in carrying]
        if shared:
            notes.append(f"'{name}' has bones that the source lacks, weighted by their place: {listed(shared)}.")
        if empty:
            left = "which kept their weights" if kept else "left without weights"
            notes.append(f"'{name}' has bones that the source lacks, {left}: {listed(empty)}.")
        weighted = {source.bones.names[bone] for bone in np.unique(source.weights.bone[source.weights.value > 0])}
        heirs = [f"'{bone}' to '{heir}'" for bone, heir in value.mapping.heirs() if bone in weighted]
        if heirs:
            notes.append(f"Bones without a counterpart for '{name}' gave their weight on: {_shown(heirs)}.")
    return notes


def mapping_line(source: str, target: str, mapping: BoneMapping) -> str:
    """How many bones of one armature were mapped to another's, in which way."""
    counts = [f"{number:,} {HOW[way]}" for way, number in mapping.counts().items()]
    alone = len(mapping.heirs())
    if alone:
        counts.append(f"{alone:,} without a counterpart")
    return f"Bones of '{source}' mapped to '{target}': {', '.join(counts)}."


def _shown(pairs: list[str]) -> str:
    """The first pairs, and how many more there are."""
    return ", ".join(pairs[:SHOWN]) + (f" and {len(pairs) - SHOWN} more" if len(pairs) > SHOWN else "")


def _extras(values: list[TargetWeights]) -> list[str]:
    """Counts that are told only where there is something to count."""
    limited, seams = sum(value.limited for value in values), sum(value.seams for value in values)
    kept = sum(len(value.status) - len(value.replaced) for value in values)
    part = sum(value.part for value in values)
    parts: Counter[str] = Counter()
    for value in values:
        parts.update(value.parts)
    extras = [
        (part, "of a loose part", "of loose parts"),
        (limited, "vertex limited", "vertices limited"),
        (seams, "seam vertex", "seam vertices"),
    ]
    extras.append((kept, "vertex left as it was", "vertices left as they were"))
    return [*(counted(*extra) for extra in extras if extra[0]), *told(parts)]


def _mapped(values: list[TargetWeights]) -> list[str]:
    """How many bones were mapped in which way, the most of any target."""
    counts = [value.mapping.counts() for value in values]
    most = {way: max(count.get(way, 0) for count in counts) for way in HOW}
    return [f"{number:,} mapped {HOW[way]}" for way, number in most.items() if number]
