# SPDX-License-Identifier: GPL-3.0-or-later
"""Left and right: by the names of bones, and the plane between the two sides."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .character import Bones, Floats, Integers

LEFT, RIGHT, MIDDLE = 1, -1, 0

_OPPOSITE = {"left": "right", "right": "left", "l": "r", "r": "l", "左": "右", "右": "左"}
# From the most to the least explicit way of naming a side; the first that fits counts.
_PATTERNS = tuple(
    re.compile(pattern)
    for pattern in (
        r"(?:^|(?<=[._\-\s:|]))(?P<side>(?i:left|right|l|r))(?=$|[._\-\s:|]|\d+$)",  # arm.L, L_Arm, Bip01 L Arm
        r"(?P<side>左|右)",
        r"(?:^|(?<=[a-z0-9._:]))(?P<side>Left|Right)(?=[A-Z0-9_]|$)",  # LeftArm, mixamorig:LeftArm, armLeft
        r"^(?P<side>left|right|LEFT|RIGHT)(?=[A-Za-z0-9_])",  # leftUpperArm
        r"^(?P<side>l|r)(?=[A-Z])",  # lShldr
        r"(?<=[a-z0-9])(?P<side>L|R)$",  # handL
    )
)  # fmt: skip


@dataclass(frozen=True)
class Plane:
    """Points with normal · x = offset; the unit normal points to the left."""

    normal: Floats
    offset: float

    def heights(self, points: Floats) -> Floats:
        """Signed distances (n,) of points (n,3), positive on the left."""
        heights: Floats = points @ self.normal - self.offset
        return heights

    def reflected(self, points: Floats) -> Floats:
        """The mirror images (n,3) of points (n,3)."""
        return points - 2.0 * self.heights(points)[:, None] * self.normal


def side_of_name(name: str) -> int:
    """LEFT, RIGHT or MIDDLE, as the name says."""
    found = _side(name)
    if found is None:
        return MIDDLE
    return LEFT if found["side"].lower() in ("l", "left", "左") else RIGHT


def mirrored_name(name: str) -> str:
    """The name of the same thing on the other side; the name itself where it has no side."""
    found = _side(name)
    if found is None:
        return name
    side = found["side"]
    other = _OPPOSITE[side.lower()]
    if side.isupper():
        other = other.upper()
    elif side[0].isupper():
        other = other.capitalize()
    return name[: found.start("side")] + other + name[found.end("side") :]


def mirror_partners(names: Sequence[str]) -> Integers:
    """Index of each name's counterpart (B,): itself where it has no side, -1 where the counterpart is missing."""
    index = {name: i for i, name in enumerate(names)}
    return np.array([index.get(mirrored_name(name), -1) for name in names], np.int32)


def bone_sides(names: Sequence[str]) -> Integers:
    """LEFT, RIGHT or MIDDLE of each bone (B,): a side counts only where the counterpart exists."""
    partners = mirror_partners(names)
    return np.array(
        [side_of_name(name) if partner >= 0 else MIDDLE for name, partner in zip(names, partners, strict=True)],
        np.int32,
    )


def symmetry_plane(bones: Bones) -> Plane | None:
    """The plane between the left and the right bones; None where no pair lies apart."""
    sides, partners = bone_sides(bones.names), mirror_partners(bones.names)
    left = np.flatnonzero(sides == LEFT)
    if not len(left):
        return None
    centres = (bones.heads + bones.tails) / 2
    across = centres[left] - centres[partners[left]]
    direction = across.sum(axis=0)
    length = float(np.linalg.norm(direction))
    if length <= 1e-9 * float(np.abs(centres).max(initial=0.0)) or length == 0.0:
        return None
    normal = direction / length
    middles = (centres[left] + centres[partners[left]]) / 2
    return Plane(normal, float(np.median(middles @ normal)))


def _side(name: str) -> re.Match[str] | None:
    return next((found for found in (pattern.search(name) for pattern in _PATTERNS) if found), None)
