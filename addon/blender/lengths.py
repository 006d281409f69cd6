# SPDX-License-Identifier: GPL-3.0-or-later
"""Lengths in the scene's own units."""

import bpy


def length_text(value: float, scene: bpy.types.Scene) -> str:
    """A length of Blender units as the scene shows it."""
    units = scene.unit_settings
    if units.system == "NONE":
        return f"{value:.3g}"
    return bpy.utils.units.to_string(units.system, "LENGTH", value * units.scale_length, precision=3)
