# SPDX-License-Identifier: GPL-3.0-or-later
"""An empty profile for Blender, which reads the variable when it starts: import this before bpy.

DERMIS_PROFILE names a folder to be used instead, one that other processes use too.
"""

import os
import tempfile

MODULE = "bl_ext.user_default.dermis"
PROFILE = os.environ.get("DERMIS_PROFILE") or tempfile.mkdtemp(prefix="dermis-profile-")
os.environ["BLENDER_USER_RESOURCES"] = PROFILE
