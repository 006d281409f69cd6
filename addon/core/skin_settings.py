# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the skin; names and meaning are those of `dermis_native.PbdSkin`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from dermis_native import pbd_preset

Preset = Literal["default", "paper", "rumman_fratarcangeli"]
Start = Literal["auto", "linear", "dual_quaternion"]

PRESETS: tuple[Preset, ...] = ("default", "paper", "rumman_fratarcangeli")

# The settings that a preset fills and a user can change afterwards.
ADJUSTABLE = (
    "iterations",
    "start",
    "stretch",
    "volume",
    "bind",
    "energy",
    "stiffness",
    "self_collision",
    "smoothing",
)


@dataclass(frozen=True)
class SkinSettings:
    """How a skin is solved. What is None comes from the preset.

    stretch, volume, bind and energy are strengths from 0 to 1; cell_size is in metres, None lets
    the thickness at each joint decide.
    """

    preset: Preset = "default"
    iterations: int | None = None
    start: Start | None = None
    stretch: float | None = None
    volume: float | None = None
    bind: float | None = None
    energy: float | None = None
    stiffness: float | None = None
    self_collision: bool | None = None
    smoothing: float | None = None
    cell_size: float | None = None

    def native_arguments(self) -> dict[str, Any]:
        """Keyword arguments of `dermis_native.PbdSkin`."""
        return asdict(self)


def preset_values(preset: Preset) -> dict[str, Any]:
    """What a preset fills in: the values of `ADJUSTABLE`."""
    values = pbd_preset(preset)
    return {name: values[name] for name in ADJUSTABLE}
