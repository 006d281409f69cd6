# SPDX-License-Identifier: GPL-3.0-or-later
"""The half of the add-on that knows nothing of Blender: arrays in, arrays out."""
