# SPDX-License-Identifier: GPL-3.0-or-later
"""Text in the sidebar, which may be narrow."""

import textwrap


def draw_text(layout, text, context, icon="NONE"):
    """Text over as many lines as the sidebar's width needs; Blender has no scale without a window."""
    width = context.region.width if context.region is not None else 300
    characters = max(20, int(width / (7 * (context.preferences.system.ui_scale or 1.0))))
    for number, line in enumerate(textwrap.wrap(text, characters)):
        layout.label(text=line, icon="NONE" if number else icon)
