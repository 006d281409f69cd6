# SPDX-License-Identifier: GPL-3.0-or-later
"""Functions of a bone's local rotation that a plain Blender driver can compute.

Each is 0 at rest and stays between 0 and 1. A driver reads the rotation as Blender hands it to drivers
in Local Space: swing and twist about the bone's Y axis, or a quaternion. The expressions are simple ones,
which Blender evaluates itself, with automatic running of scripts switched off too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .character import Floats

Axis = Literal["X", "Y", "Z"]
AXES: tuple[Axis, ...] = ("X", "Y", "Z")
# Bend about the bone's X, twist about the bone, bend about its Z.
MEANING: dict[Axis, str] = {"X": "bend X", "Y": "twist", "Z": "bend Z"}


@dataclass(frozen=True)
class DriverVariable:
    """A variable of a driver: a channel of the bone's rotation in a rotation mode of Blender's drivers."""

    name: str
    channel: str
    mode: str


@dataclass(frozen=True)
class Ramp:
    """Goes from 0 to 1 while one angle of a bone goes from `start` to `end` (radians), and stays there.

    Bend and twist are separate angles, and so are the two directions of each.
    """

    bone: str
    axis: Axis
    start: float
    end: float

    def values(self, rotations: Floats) -> Floats:
        """Values (P,) at local rotations (P,4)."""
        angle = swing_twist(rotations)[:, AXES.index(self.axis)]
        return np.asarray(np.clip((angle - self.start) / (self.end - self.start), 0.0, 1.0), np.float64)

    @property
    def variables(self) -> tuple[DriverVariable, ...]:
        """What the expression reads."""
        return (DriverVariable("angle", f"ROT_{self.axis}", "SWING_TWIST_Y"),)

    @property
    def expression(self) -> str:
        """The driver's expression."""
        return f"clamp((angle-{_number(self.start)})/{_number(self.end - self.start)},0,1)"

    @property
    def label(self) -> str:
        """Name for people."""
        start, end = (_degrees(angle) for angle in (self.start, self.end))
        return f"{self.bone} {MEANING[self.axis]} {start} to {end}"


@dataclass(frozen=True)
class Cone:
    """1 at one local rotation (4,) of a bone, falling evenly to 0 at the angle `reach` from it."""

    bone: str
    centre: tuple[float, float, float, float]
    reach: float

    def values(self, rotations: Floats) -> Floats:
        """Values (P,) at local rotations (P,4)."""
        angle = angles_between(rotations, np.array(self.centre))
        return np.asarray(np.clip(1.0 - angle / self.reach, 0.0, 1.0), np.float64)

    @property
    def variables(self) -> tuple[DriverVariable, ...]:
        """What the expression reads."""
        return tuple(DriverVariable(name, f"ROT_{name.upper()}", "QUATERNION") for name in "wxyz")

    @property
    def expression(self) -> str:
        """The driver's expression."""
        terms = "+".join(f"{_number(value)}*{name}" for name, value in zip("wxyz", self.centre, strict=True))
        return f"clamp(1-2*acos(min(1,abs({terms})))/{_number(self.reach)},0,1)"

    @property
    def label(self) -> str:
        """Name for people."""
        bent = ", ".join(_degrees(angle) for angle in swing_twist(np.array([self.centre]))[0])
        return f"{self.bone} at {bent}"


PoseReader = Ramp | Cone


def swing_twist(rotations: Floats) -> Floats:
    """Angles (P,3) of local rotations (P,4) as Blender's drivers see them: bend X, twist about Y, bend Z."""
    q = np.where(rotations[:, :1] < 0, -rotations, rotations)
    half = np.arctan2(q[:, 2], q[:, 0])
    cosine, sine = np.cos(half), np.sin(half)
    # The swing is the rotation times the inverse of its twist.
    x = q[:, 1] * cosine + q[:, 3] * sine
    z = q[:, 3] * cosine - q[:, 1] * sine
    angles = [2.0 * np.arcsin(np.clip(x, -1, 1)), 2.0 * half, 2.0 * np.arcsin(np.clip(z, -1, 1))]
    return np.stack(angles, axis=1)


def angles_between(rotations: Floats, other: Floats) -> Floats:
    """Angles (P,) between rotations (P,4) and another one (4,)."""
    return np.asarray(2.0 * np.arccos(np.clip(np.abs(rotations @ other), 0.0, 1.0)), np.float64)


def rotation_matrices(rotations: Floats) -> Floats:
    """Matrices (P,3,3) of quaternions (P,4)."""
    w, x, y, z = rotations.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def spread_out(rotations: Floats, count: int, least: float) -> list[int]:
    """Indices of up to `count` rotations (P,4) that lie at least `least` from rest and from each other.

    Each next one is the farthest from rest and from those before.
    """
    distance = angles_between(rotations, np.array([1.0, 0.0, 0.0, 0.0]))
    chosen: list[int] = []
    while len(chosen) < count and len(rotations):
        index = int(np.argmax(distance))
        if distance[index] < least:
            break
        chosen.append(index)
        distance = np.minimum(distance, angles_between(rotations, rotations[index]))
    return chosen


def readers_of(
    bone: str, rotations: Floats, *, least: float = 0.09, steps: int = 4, cones: int = 8
) -> list[PoseReader]:
    """What could drive the corrections of a joint that takes the local rotations (P,4).

    Ramps over each part of each angle that it reaches, both ways; cones around spread-out rotations where
    it turns about more than one axis. Angles below `least` (radians) count as rest.
    """
    angles = swing_twist(rotations)
    found: list[PoseReader] = []
    reached = 0
    for column, axis in enumerate(AXES):
        ends = [extreme for extreme in (angles[:, column].max(), angles[:, column].min()) if abs(extreme) >= least]
        reached += bool(ends)
        for extreme in ends:
            # The last ramp first: among equals the widest is chosen.
            knots = [float(extreme) * step / steps for step in range(steps + 1)]
            found += [Ramp(bone, axis, a, b) for a in knots for b in reversed(knots) if abs(b) > abs(a)]
    if reached > 1:
        rest = np.array([1.0, 0.0, 0.0, 0.0])
        for index in spread_out(rotations, cones, 2 * least):
            q = rotations[index] if rotations[index][0] >= 0 else -rotations[index]
            reach = float(angles_between(q[None], rest)[0])
            found.append(Cone(bone, (float(q[0]), float(q[1]), float(q[2]), float(q[3])), reach))
    return found


def _degrees(angle: float) -> str:
    return str(round(float(np.degrees(angle))))


def _number(value: float) -> str:
    return f"{value:.9g}" if value >= 0 else f"({value:.9g})"
