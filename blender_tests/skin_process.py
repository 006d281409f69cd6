# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender of its own: opens a file in the tests' profile and keeps what one frame shows.

Arguments: profile, file, object, frame, result. Run by the tests.
"""

import os
import sys

profile, path, name, frame, result = sys.argv[1:]
os.environ["BLENDER_USER_RESOURCES"] = profile

import bpy  # noqa: E402, I001  (bpy makes its own modules findable)
import addon_utils  # noqa: E402
import numpy as np  # noqa: E402

addon_utils.enable("bl_ext.user_default.dermis", persistent=True)
bpy.ops.wm.open_mainfile(filepath=path)
bpy.context.scene.frame_set(int(frame))
mesh = bpy.data.objects[name].evaluated_get(bpy.context.evaluated_depsgraph_get()).data
flat = np.empty(len(mesh.vertices) * 3, np.float32)
mesh.vertices.foreach_get("co", flat)
np.save(result, flat.reshape(-1, 3))
sys.stdout.flush()
# Blender as a module hangs at exit while handlers are registered.
os._exit(0)
