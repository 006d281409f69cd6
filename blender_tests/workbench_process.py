# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders one small picture with Workbench: ends with 0 where that works."""

import os
import sys
import tempfile
from pathlib import Path

import bpy

scene = bpy.context.scene
scene.render.engine = "BLENDER_WORKBENCH"
scene.render.resolution_x = scene.render.resolution_y = 16
with tempfile.TemporaryDirectory() as folder:
    scene.render.filepath = str(Path(folder) / "picture.png")
    bpy.ops.render.render(write_still=True)
    rendered = Path(scene.render.filepath).is_file()
sys.stdout.flush()
os._exit(0 if rendered else 1)
