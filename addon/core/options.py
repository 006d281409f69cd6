# SPDX-License-Identifier: GPL-3.0-or-later
"""Options of a command, as its operator defines them, and whether given values fit them."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .errors import InputError, listed

KINDS = {
    "BOOLEAN": "true or false",
    "INT": "a whole number",
    "FLOAT": "a number",
    "STRING": "a text",
    "ENUM": "one of its names",
}


@dataclass(frozen=True)
class Option:
    """One property of an operator: `kind` is a key of KINDS; numbers have a range, enumerations have `choices`."""

    name: str
    kind: str
    default: bool | int | float | str
    help: str = ""
    least: float = -math.inf
    most: float = math.inf
    choices: tuple[str, ...] = ()

    def check(self, value: Any, place: str) -> None:
        """Raise InputError, which starts with the place, when the value does not fit."""
        allowed: dict[str, tuple[type, ...]] = {"BOOLEAN": (bool,), "INT": (int,), "FLOAT": (int, float)}
        fits = isinstance(value, allowed.get(self.kind, (str,)))
        if not fits or (isinstance(value, bool) and self.kind != "BOOLEAN"):
            raise InputError(f"{place} must be {KINDS[self.kind]}, not {value!r}.")
        if self.kind == "ENUM" and value not in self.choices:
            raise InputError(f"{place} must be one of {listed(self.choices, 50)}, not {value!r}.")
        if self.kind in ("INT", "FLOAT"):
            # Blender keeps floats and their ranges in single precision.
            number = value if self.kind == "INT" else float(np.float32(value))
            if not self.least <= number <= self.most:
                raise InputError(f"{place} must be between {self.least:g} and {self.most:g}, not {value!r}.")


def check_options(known: Mapping[str, Option], given: Mapping[str, Any], place: str) -> dict[str, Any]:
    """The given values, with those that follow from them; InputError names the place of the first that is wrong."""
    for name, value in given.items():
        if name not in known:
            raise InputError(unknown(name, known, "option", place))
        known[name].check(value, f"{place}.{name}")
    chosen = dict(given)
    if "use_scene_range" in known and "use_scene_range" not in given:
        ends = [name for name in ("frame_start", "frame_end") if name in given]
        if len(ends) == 1:
            raise InputError(f"{place} has {listed(ends)} alone: give both, frame_start and frame_end.")
        if ends:
            chosen["use_scene_range"] = False
    return chosen


def unknown(name: str, known: Mapping[str, Any], kind: str, place: str) -> str:
    """A sentence about a name that is not known there, with the nearest one that is."""
    near = difflib.get_close_matches(name, list(known), 1)
    return f"{place} has no {kind} '{name}'" + (f": did you mean '{near[0]}'?" if near else ".")
