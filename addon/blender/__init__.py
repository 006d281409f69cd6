# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays from the scene and back: the only layer that reads and writes Blender's data."""
