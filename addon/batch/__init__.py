# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators without a window: commands and recipes, which open files, call operators and save."""
