# SPDX-License-Identifier: GPL-3.0-or-later
"""From a bare mesh to corrected motion in three clicks, with Rigify's metarigs as templates."""

import math

import addon_utils
import bpy
import characters as c
import fits
import makehuman
import numpy as np
import pytest
from mathutils import Matrix

# A pose of each metarig: turns about the bone's own X axis in degrees.
POSES = {
    "human": {"upper_arm.L": 40, "forearm.L": 70, "forearm.R": 50, "thigh.L": -60, "shin.L": 80, "spine.003": 15},
    "basic_human": {"upper_arm.L": 40, "forearm.L": 70, "forearm.R": 50, "thigh.L": -60, "shin.L": 80},
    "basic_quadruped": {"thigh.L": -30, "shin.L": 40, "front_thigh.R": -30, "front_shin.R": 40, "spine.010": 15},
}
LIMBS = {
    "human": ("upper_arm", "forearm", "hand", "thigh", "shin", "foot"),
    "basic_human": ("upper_arm", "forearm", "hand", "thigh", "shin", "foot"),
    "basic_quadruped": ("front_thigh", "front_shin", "front_foot", "thigh", "shin", "foot"),
}


@pytest.fixture
def metarig():
    """Adds a metarig where Rigify puts it."""
    addon_utils.enable("rigify", default_set=True)

    def add(kind):
        assert getattr(bpy.ops.object, f"armature_{kind}_metarig_add")() == {"FINISHED"}
        return bpy.context.object

    yield add
    addon_utils.disable("rigify", default_set=True)


def positions(ob):
    """Vertices (V,3) of the evaluated mesh, and its edges (E,2)."""
    mesh = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points, edges = np.empty(3 * len(mesh.vertices)), np.empty(2 * len(mesh.edges), np.int32)
    mesh.vertices.foreach_get("co", points)
    mesh.edges.foreach_get("vertices", edges)
    return points.reshape(-1, 3), edges.reshape(-1, 2)


def lengths(points, edges):
    return np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)


def three_clicks(ob, rig, kind):
    """The clicks, then a pose; returns the plain and the corrected vertices, at rest and posed."""
    c.activate(rig, ob)
    assert bpy.ops.dermis.fit_skeleton() == {"FINISHED"}
    assert bpy.ops.dermis.bind_weights() == {"FINISHED"}
    assert bpy.ops.dermis.skin_enable() == {"FINISHED"}
    names = c.bone_names(rig)
    np.testing.assert_allclose(c.dense(ob, names).sum(axis=1), 1, atol=1e-5)
    rest, edges = positions(ob)
    for name, degrees in POSES[kind].items():
        bone = rig.pose.bones[name]
        bone.rotation_mode = "XYZ"
        bone.rotation_euler.x = math.radians(degrees)
    bpy.context.view_layer.update()
    corrected, _ = positions(ob)
    ob.data.shape_keys.key_blocks["Dermis"].value = 0.0
    bpy.context.view_layer.update()
    plain, _ = positions(ob)
    return rest, plain, corrected, edges


def assert_moves(rest, plain, corrected, edges):
    """Everything is finite and moves, the correction does something, and hardly an edge is torn."""
    assert np.isfinite(corrected).all()
    size = np.ptp(rest, axis=0).max()
    assert np.linalg.norm(corrected - rest, axis=1).max() > 0.02 * size
    assert 1e-4 * size < np.linalg.norm(corrected - plain, axis=1).max() < 0.2 * size
    stretch = lengths(corrected, edges) / np.maximum(lengths(rest, edges), 1e-9)
    assert (stretch > 2).mean() < 0.02


def assert_in_place(ob, rig, kind):
    """Joints of the trunk are inside the body, those of limbs too or nearly so; left ones are on the left.

    Paws and ankles are as thin as a few voxels of the fit, so a joint in them may miss the surface by a voxel.
    """
    near = {"spine": 0.0} | dict.fromkeys(LIMBS[kind], 0.02 * max(ob.dimensions))
    heads = {name: points[0] for name, points in fits.joints(rig).items()}
    stems = {name: name.split(".")[0] for name in heads}
    outside = [name for name, stem in stems.items() if stem in near and not fits.inside(ob, heads[name], near[stem])]
    assert outside == []
    for limb in LIMBS[kind]:
        assert heads[f"{limb}.L"][0] > 0 > heads[f"{limb}.R"][0], limb


@pytest.mark.parametrize("kind", ["basic_human", "human"])
@pytest.mark.parametrize("name", ["AVERAGE", "CHILD"])
def test_a_bare_body(metarig, kind, name):
    body = makehuman.permuted(makehuman.decimated(makehuman.body(name, **getattr(makehuman, name)), 6000))
    ob = c.mesh_object(name, body.vertices, body.triangles.tolist())
    rig = metarig(kind)
    assert_moves(*three_clicks(ob, rig, kind))
    assert_in_place(ob, rig, kind)


def test_the_head_reaches_the_crown(metarig):
    """And not the chin, which juts out in the plane of symmetry as a snout does."""
    body = makehuman.decimated(makehuman.body("AVERAGE", **makehuman.AVERAGE), 12000)
    body = makehuman.permuted(body, seed=2)
    ob = c.mesh_object("Average", body.vertices, body.triangles.tolist())
    rig = metarig("human")
    c.activate(rig, ob)
    assert bpy.ops.dermis.fit_skeleton() == {"FINISHED"}
    crown = (rig.matrix_world @ rig.data.bones["spine.006"].tail_local).z
    assert 0.97 < crown / body.vertices[:, 2].max() < 1.0


@pytest.mark.skipif(not fits.SHARED.is_dir(), reason="needs the test characters")
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("smpl_man", "human"),
        ("cesium_man", "basic_human"),
        ("spot", "basic_quadruped"),
        ("cat", "basic_quadruped"),
        ("quat_wolf", "basic_quadruped"),
    ],
)
def test_bodies_of_others(metarig, name, kind):
    ob = fits.shared_body(name)
    if name == "cat":  # its file faces -X, metarigs face -Y
        ob.data.transform(Matrix.Rotation(math.radians(90), 4, "Z"))
    rig = metarig(kind)
    assert_moves(*three_clicks(ob, rig, kind))
    assert_in_place(ob, rig, kind)
