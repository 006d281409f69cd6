# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks at the weights of a mesh and tells what a rigger should look at; changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .character import Bones, BoneWeights, Flags, Integers, Surface
from .check_fingers import bleeding_fingers
from .check_parts import LooseParts, loose_parts
from .check_sides import wrong_sides
from .check_stretch import Stretch, range_of_motion
from .check_weights import too_many, unweighted, wrong_totals
from .errors import counted, listed

# Categories of vertices, with what is said of each, in the order of the report.
CATEGORIES = {
    "unweighted": "without weights",
    "totals": "with a total other than 1",
    "sides": "on one side with weight of the other",
    "fingers": "with weight of another finger",
    "stretch": "at edges that stretch too far",
    "seams": "at a seam with unequal weights",
    "influences": "with too many influences",
    "filled": "filled in, not matched",
    "parts": "in loose parts",
}
# What is told, but is no fault in itself.
NOTED = frozenset({"filled", "parts"})


@dataclass(frozen=True)
class CheckSettings:
    """max_influences that a vertex should have (None: any number); a joint turns by `degrees` both
    ways, and an edge may stretch `stretch` times.
    """

    max_influences: int | None = 4
    degrees: float = 45.0
    stretch: float = 2.0


@dataclass(frozen=True)
class Checked:
    """What is looked at. Columns of `weights` are `bones`; `boneless_groups` are vertex groups that no bone
    has; `filled` (V,) and `notes` come from a retargeting, `seams` (V,) from a look at all meshes together.
    """

    name: str
    armature: str
    surface: Surface
    bones: Bones
    weights: BoneWeights
    filled: Flags | None = None
    seams: Flags | None = None
    boneless_groups: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class CheckReport:
    """Vertices of each category that has any, and sentences on the rest."""

    name: str
    armature: str
    vertex_count: int
    vertices: dict[str, Integers]
    notes: tuple[str, ...]

    @property
    def faults(self) -> int:
        """How many vertices are in some category that is a fault."""
        found = [indices for category, indices in self.vertices.items() if category not in NOTED]
        return len(np.unique(np.concatenate(found))) if found else 0

    def lines(self) -> list[str]:
        """The report, line by line."""
        total = counted(self.vertex_count, "vertex", "vertices")
        suspicious = f"{self.faults:,} to look at" if self.faults else "nothing to look at"
        lines = [f"'{self.name}' with '{self.armature}': {total}, {suspicious}."]
        for category, words in CATEGORIES.items():
            if category in self.vertices:
                lines.append(f"{counted(len(self.vertices[category]), 'vertex', 'vertices')} {words}.")
        return lines + list(self.notes)

    def as_dict(self) -> dict[str, Any]:
        """The report for JSON: counts, vertices by category, notes."""
        return {
            "mesh": self.name,
            "armature": self.armature,
            "vertices": self.vertex_count,
            "to_look_at": self.faults,
            "categories": {category: indices.tolist() for category, indices in self.vertices.items()},
            "notes": list(self.notes),
        }


def check(checked: Checked, settings: CheckSettings, step: Callable[[float], None] = lambda _: None) -> CheckReport:
    """Look at the weights. `step` hears the share of the work done and may raise to end it.

    Raises InputError when the surface or the bones cannot be used.
    """
    checked.surface.check(checked.name)
    checked.bones.check(checked.armature)
    points, bones, weights = checked.surface.vertices, checked.bones, checked.weights
    count = len(points)
    marked: dict[str, Flags] = {
        "unweighted": unweighted(weights, count),
        "totals": wrong_totals(weights, count),
    }
    notes = _bone_notes(checked)
    sides = wrong_sides(points, bones, weights)
    if sides is None:
        notes.append(f"'{checked.armature}' has no bones named left and right: sides were not looked at.")
    else:
        marked["sides"] = sides
    step(0.1)
    marked["fingers"] = bleeding_fingers(points, bones, weights)
    if settings.max_influences is not None:
        marked["influences"] = too_many(weights, count, settings.max_influences)
    if checked.seams is not None:
        marked["seams"] = checked.seams
    if checked.filled is not None:
        marked["filled"] = checked.filled
    parts = loose_parts(checked.name, checked.surface, weights)
    marked["parts"] = parts.part > 0
    notes += _part_notes(parts)
    step(0.2)
    stretch = range_of_motion(checked.surface, bones, weights, settings.degrees, lambda share: step(0.2 + 0.8 * share))
    over = stretch.ratio > settings.stretch
    marked["stretch"] = np.isin(np.arange(count), stretch.edges[over])
    notes += _stretch_notes(stretch, bones, settings)
    step(1.0)
    found = {category: np.flatnonzero(flags).astype(np.int32) for category, flags in marked.items() if flags.any()}
    return CheckReport(
        checked.name,
        checked.armature,
        count,
        {category: found[category] for category in CATEGORIES if category in found},
        (*notes, *checked.notes),
    )


def summary(reports: list[CheckReport]) -> str:
    """One line for all."""
    meshes = f"'{reports[0].name}'" if len(reports) == 1 else counted(len(reports), "mesh", "meshes")
    faults = sum(report.faults for report in reports)
    if not faults:
        return f"Checked {meshes}: nothing to look at."
    parts = []
    for category, words in CATEGORIES.items():
        number = sum(len(report.vertices.get(category, ())) for report in reports)
        if number and category not in NOTED:
            parts.append(f"{number:,} {words}")
    return f"Checked {meshes}: {counted(faults, 'vertex', 'vertices')} to look at: {', '.join(parts)}."


def _bone_notes(checked: Checked) -> list[str]:
    weighted = set(np.unique(checked.weights.bone[checked.weights.value > 0]).tolist())
    alone = [name for bone, name in enumerate(checked.bones.names) if bone not in weighted]
    notes = []
    if alone:
        notes.append(f"{counted(len(alone), 'bone')} without any weight: {listed(alone)}.")
    if checked.boneless_groups:
        groups = counted(len(checked.boneless_groups), "group")
        notes.append(f"{groups} without a deforming bone: {listed(checked.boneless_groups)}.")
    return notes


def _part_notes(parts: LooseParts) -> list[str]:
    if len(parts.sizes) < 2:
        return []
    rigid, loose = int(np.count_nonzero(parts.rigid[1:])), len(parts.sizes) - 1
    sizes = ", ".join(f"{size:,}" for size in parts.sizes[1:6])
    more = ", ..." if loose > 5 else ""
    return [
        f"{counted(loose, 'loose part')} beside the largest ({sizes}{more} vertices): "
        f"{rigid:,} moving as one, {loose - rigid:,} bending."
    ]


def _stretch_notes(stretch: Stretch, bones: Bones, settings: CheckSettings) -> list[str]:
    over = np.flatnonzero(stretch.ratio > settings.stretch)
    if not len(over):
        return []
    joints, counts = np.unique(stretch.joint[over], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    worst = int(over[stretch.ratio[over].argmax()])
    names = [bones.names[joint] for joint in joints[order]]
    return [
        f"{counted(len(over), 'edge')} stretch over {settings.stretch:g} times when a joint turns by "
        f"{settings.degrees:g}\N{DEGREE SIGN}, most {stretch.ratio[worst]:.1f} times with "
        f"'{bones.names[stretch.joint[worst]]}'. Joints: {listed(names)}."
    ]
