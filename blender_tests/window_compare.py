# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether two files have the same weights: a program that Blender runs, not a test module.

blender --background --python-exit-code 1 --python window_compare.py -- MESH FIRST.blend SECOND.blend
"""

import sys

import bpy

mesh, first, second = sys.argv[sys.argv.index("--") + 1 :]


def weights(path):
    bpy.ops.wm.open_mainfile(filepath=path)
    ob = bpy.data.objects[mesh]
    names = [group.name for group in ob.vertex_groups]
    return names, [[(entry.group, entry.weight) for entry in vertex.groups] for vertex in ob.data.vertices]


one, other = weights(first), weights(second)
if not any(one[1]):
    raise SystemExit(f"{first} has no weights")
if one != other:
    raise SystemExit("the weights differ")
