# SPDX-License-Identifier: GPL-3.0-or-later
"""Templates and the operator that fits them, for the tests; everything about armatures as one comparable value."""

from contextlib import contextmanager
from functools import cache
from pathlib import Path

import bpy
import characters as c
import numpy as np
import pytest
from mathutils import Vector
from mathutils.bvhtree import BVHTree

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


@cache
def grown():
    """Vertices and faces of a body, grown once."""
    ob, rig = c.biped("Grown", voxel=0.04)
    shape = [tuple(v.co) for v in ob.data.vertices], [tuple(p.vertices) for p in ob.data.polygons]
    for each in (ob, rig):
        bpy.data.objects.remove(each)
    bpy.context.view_layer.update()
    return shape


def bare_body():
    """A body without bones, whose joints are those of `characters.biped_bones()`."""
    return c.mesh_object("Body", *grown())


def template(name="Rig"):
    """A biped's bones with other proportions than the body: connected limbs, rolls, two controls."""
    bones = [(bone, parent, head, tail) for bone, parent, head, tail in c.biped_bones(arm=0.7, leg=0.8)]
    bones.append(("control", None, (0, 0.5, 0), (0, 0.9, 0)))
    wrist = next(head for bone, _, head, _ in bones if bone == "hand.L")
    bones.append(("wrist control", "control", wrist, (wrist[0], 0, wrist[2] + 0.2)))
    rig = c.armature(name, bones)
    with in_edit_mode(rig) as edit:
        for i, bone in enumerate(edit):
            bone.roll = 0.3 * i - 1.0
            bone.use_deform = "control" not in bone.name
        for bone in edit:
            if bone.name.split(".")[0] in ("hand", "shin", "chest"):
                bone.use_connect = True
    return rig


@contextmanager
def in_edit_mode(rig):
    """The armature's edit bones."""
    c.activate(rig)
    bpy.ops.object.mode_set(mode="EDIT")
    yield rig.data.edit_bones
    bpy.ops.object.mode_set(mode="OBJECT")


def fit(rig, *meshes, **options):
    c.activate(rig, *meshes)
    return bpy.ops.dermis.fit_skeleton(**options)


def joints(rig):
    """World positions of every bone's head and tail."""
    return {
        bone.name: np.array([rig.matrix_world @ bone.head_local, rig.matrix_world @ bone.tail_local])
        for bone in rig.data.bones
    }


def settings(rig):
    """Everything of an armature but where its bones are."""
    return {
        "bones": {
            bone.name: (
                bone.parent and bone.parent.name,
                bone.use_connect,
                bone.use_deform,
                bone.hide,
                bone.select,
                bone.inherit_scale,
                bone.bbone_segments,
                bone.envelope_distance,
                [collection.name for collection in bone.collections],
            )
            for bone in rig.data.bones
        },
        "pose": {
            bone.name: (
                tuple(bone.location),
                tuple(bone.rotation_quaternion),
                tuple(bone.scale),
                [(constraint.name, constraint.type, constraint.influence) for constraint in bone.constraints],
                bone.custom_shape,
            )
            for bone in rig.pose.bones
        },
        "object": (rig.mode, rig.parent, [tuple(row) for row in rig.matrix_world], rig.data.users),
        "flags": (rig.data.use_mirror_x, rig.data.pose_position, rig.data.display_type),
        "selected": sorted(ob.name for ob in bpy.context.selected_objects),
        "active": bpy.context.view_layer.objects.active.name,
        "modes": {ob.name: ob.mode for ob in bpy.data.objects},
    }


def rest(rig):
    return {
        bone.name: (tuple(bone.head_local), tuple(bone.tail_local), [tuple(row) for row in bone.matrix_local])
        for bone in rig.data.bones
    }


def place(rig, name):
    """Exact joints of a bone; its matrix may change in the last digits when its parent moves."""
    return rest(rig)[name][:2]


def everything():
    """All armatures and meshes, exactly."""
    rigs = [ob for ob in bpy.data.objects if ob.type == "ARMATURE"]
    meshes = [ob for ob in bpy.data.objects if ob.type == "MESH"]
    return {ob.name: (rest(ob), settings(ob)) for ob in rigs} | {ob.name: c.state(ob) for ob in meshes}


def failed(rig, *meshes, match, **options):
    """The operator fails with the message and leaves all objects as they were."""
    c.activate(rig, *meshes)
    bpy.context.view_layer.update()
    before = everything()
    with pytest.raises(RuntimeError, match=match) as caught:
        bpy.ops.dermis.fit_skeleton(**options)
    assert everything() == before
    assert str(caught.value).rstrip().endswith("Nothing was changed.")


def shared_body(name):
    """A test character's surface, without its bones."""
    data = np.load(SHARED / f"{name}.npz")
    ends = np.cumsum(data["loop_counts"])
    faces = [tuple(corners.tolist()) for corners in np.split(data["loop_indices"], ends[:-1])]
    return c.mesh_object(name, data["verts"], faces)


def inside(ob, point, near=0.0):
    """Whether a point of the world is inside a closed mesh at the origin, or as near to it: most of a few rays leave
    it an odd number of times.
    """
    tree = BVHTree.FromPolygons([v.co for v in ob.data.vertices], [p.vertices for p in ob.data.polygons])
    if tree.find_nearest(Vector(point))[3] <= near:
        return True
    odd = 0
    for direction in ((1, 0.01, 0.02), (-0.02, 1, 0.01), (0.01, 0.02, -1)):
        origin, crossings = Vector(point), 0
        while True:
            hit, _, _, _ = tree.ray_cast(origin, Vector(direction))
            if hit is None:
                break
            crossings += 1
            origin = hit + 1e-5 * Vector(direction)
        odd += crossings % 2
    return odd >= 2
