# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender without Dermis: opens a file and keeps what frames show.

Arguments: an empty profile, file, object, result, frames; or "render" and one frame for a picture in the place of the
result. Run by the tests.
"""

import os
import sys

profile, path, name, result, *frames = sys.argv[1:]
os.environ["BLENDER_USER_RESOURCES"] = profile

import bpy  # noqa: E402  (bpy makes its own modules findable)
import numpy as np  # noqa: E402

bpy.ops.wm.open_mainfile(filepath=path, use_scripts=False)
assert not hasattr(bpy.types, "DERMIS_OT_bake")
assert not any(module.startswith("dermis_native") for module in sys.modules)
if frames[0] == "render":
    bpy.context.scene.frame_set(int(frames[1]))
    bpy.context.scene.render.filepath = result
    bpy.ops.render.render(write_still=True)
    frames = []
shown = []
for frame in map(float, frames):
    bpy.context.scene.frame_set(int(frame), subframe=frame - int(frame))
    mesh = bpy.data.objects[name].evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    flat = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", flat)
    shown.append(flat.reshape(-1, 3))
if shown:
    np.save(result, np.array(shown))
sys.stdout.flush()
os._exit(0)
