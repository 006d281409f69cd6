# SPDX-License-Identifier: GPL-3.0-or-later
"""Text in the sidebar, which may be narrow."""

import textwrap

# Room that an icon takes, in characters.
ICON_ROOM = " " * 4


def draw_text(layout, text, context, icon="NONE"):
    """Text over as many lines as the sidebar's width needs; Blender has no scale without a window."""
    width = context.region.width if context.region is not None else 300
    characters = max(20, int(width / (7 * (context.preferences.system.ui_scale or 1.0))))
    room = "" if icon == "NONE" else ICON_ROOM
    for number, line in enumerate(textwrap.wrap(text, characters, initial_indent=room)):
        layout.label(text=line.strip(), icon="NONE" if number else icon)


def draw_missing(layout, operator, context):
    """Why an operator's button is grey, in the panel itself."""
    reason = operator.missing(context)
    if reason:
        draw_text(layout.column(align=True), reason, context, icon="INFO")
