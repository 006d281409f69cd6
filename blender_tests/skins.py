# SPDX-License-Identifier: GPL-3.0-or-later
"""Bending characters for the tests of the PBD skin, and what Blender shows of them."""

import sys

import bpy
import characters as c
import numpy as np
from scratch_profile import MODULE

HEIGHT = 3.0


def limb(name="Limb", segments=16, rings=25):
    """A tube with smooth weights on three bones, and its armature, at the origin."""
    rig = c.armature(f"{name}Rig", c.tube_bones(HEIGHT))
    for bone in rig.pose.bones:
        bone.rotation_mode = "XYZ"
    ob = c.mesh_object(name, *c.tube(segments, rings, HEIGHT))
    c.paint(ob, rig, falloff=4.0)
    c.deform(ob, rig)
    bpy.context.view_layer.update()
    return ob, rig


def enable(*objects):
    c.activate(*objects)
    assert bpy.ops.dermis.skin_enable() == {"FINISHED"}
    bpy.context.view_layer.update()


def disable(*objects):
    c.activate(*objects)
    assert bpy.ops.dermis.skin_disable() == {"FINISHED"}
    bpy.context.view_layer.update()


def bend(rig, degrees=90.0, bone="middle", axis=0):
    rig.pose.bones[bone].rotation_euler[axis] = np.radians(degrees)
    bpy.context.view_layer.update()


def animate(rig, frames=((1, 0.0), (13, 100.0), (25, 20.0)), bone="middle", axis=0):
    """Keyframes (frame, degrees)."""
    pose_bone = rig.pose.bones[bone]
    for frame, degrees in frames:
        pose_bone.rotation_euler[axis] = np.radians(degrees)
        pose_bone.keyframe_insert("rotation_euler", index=axis, frame=frame)
    bpy.context.scene.frame_set(1)


def shown(ob):
    """Evaluated vertices (V,3) in the object's space."""
    mesh = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    flat = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3)


def in_world(ob, points):
    matrix = np.array(ob.matrix_world)
    return points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def plain(ob):
    """What the Armature modifier makes without the skin."""
    key = ob.data.shape_keys.key_blocks["Dermis"]
    key.mute = True
    bpy.context.view_layer.update()
    result = shown(ob)
    key.mute = False
    bpy.context.view_layer.update()
    return result


def correction(ob):
    """The shape key's offsets (V,3)."""
    keys = ob.data.shape_keys
    points = []
    for block in (keys.key_blocks["Dermis"], keys.reference_key):
        flat = np.empty(len(ob.data.vertices) * 3, np.float32)
        block.points.foreach_get("co", flat)
        points.append(flat.reshape(-1, 3))
    return points[0] - points[1]


def state(ob):
    return sys.modules[f"{MODULE}.blender.skin_state"].registry.find(ob)


def solved(ob, rig, *, vertices=None, **settings):
    """The skin in world space by a solver of its own: (V,3), for objects whose origin is the world's."""
    import dermis_native as native

    bones = [bone for bone in rig.data.bones if bone.use_deform]
    world = np.array(rig.matrix_world)
    ends = [[rig.matrix_world @ getattr(bone, end) for bone in bones] for end in ("head_local", "tail_local")]
    names = [bone.name for bone in bones]
    parents = [-1 if bone.parent is None else names.index(bone.parent.name) for bone in bones]
    mesh = ob.data
    rest = in_world(ob, np.array([v.co for v in mesh.vertices]))
    polygons = [list(p.vertices) for p in mesh.polygons]
    if np.linalg.det(np.array(ob.matrix_world)[:3, :3]) < 0:
        polygons = [corners[::-1] for corners in polygons]
    skin = native.PbdSkin(
        native.TriangleMesh.from_polygons(
            rest, np.array([len(p) for p in polygons]), np.array([v for p in polygons for v in p])
        ),
        native.Skeleton(np.array(ends[0]), np.array(ends[1]), np.array(parents), names),
        native.SkinWeights.from_dense(c.dense(ob, names)),
        rest=np.array([rig.matrix_world @ bone.matrix_local for bone in bones]),
        **settings,
    )
    pose = [rig.pose.bones[name].matrix @ rig.data.bones[name].matrix_local.inverted() for name in names]
    transforms = world @ np.array(pose) @ np.linalg.inv(world)
    return skin.solve(transforms, None if vertices is None else in_world(ob, vertices))
