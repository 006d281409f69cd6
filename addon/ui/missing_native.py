# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel that stands in for everything when the native module cannot be used."""

import bpy

from .text import draw_text

_lines: list[str] = []


class DERMIS_PT_missing_native(bpy.types.Panel):
    """Says what is wrong and what to do."""

    bl_label = "Dermis"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Dermis"

    def draw(self, context):
        """Draw the lines."""
        column = self.layout.column(align=True)
        for number, line in enumerate(_lines):
            draw_text(column, line, context, "NONE" if number else "ERROR")


def register(lines: list[str]) -> None:
    """Show the lines."""
    _lines[:] = lines
    bpy.utils.register_class(DERMIS_PT_missing_native)


def is_registered() -> bool:
    """Whether the panel stands in for the add-on."""
    return bool(_lines)


def unregister() -> None:
    """Take the panel away."""
    _lines.clear()
    bpy.utils.unregister_class(DERMIS_PT_missing_native)
