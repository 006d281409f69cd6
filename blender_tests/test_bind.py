# SPDX-License-Identifier: GPL-3.0-or-later
"""Binding meshes to an armature through the operator: what it gives, what stays, what it refuses."""

import itertools
import sys

import bpy
import characters as c
import makehuman
import numpy as np
import pytest
from mathutils import Euler, Matrix
from scratch_profile import MODULE
from windows import Context, event, held, in_window, stand_in_for, until_ended

NAMES = ("lower", "middle", "upper")


def bare_tube(name="Tube", **options):
    """A tube without weights, and an armature that does not deform it."""
    return c.mesh_object(name, *c.tube(12, 13, **options)), c.armature(f"{name}Rig", c.tube_bones())


def bind(rig, *meshes, **options):
    c.activate(rig, *meshes)
    return bpy.ops.dermis.bind_weights(**options)


def states():
    return {ob.name: c.state(ob) for ob in bpy.data.objects if ob.type == "MESH"}


def refused(rig, *meshes, match, **options):
    """The operator fails with the message and leaves all objects as they were."""
    bpy.context.view_layer.update()
    before = states()
    with pytest.raises(RuntimeError, match=match) as caught:
        bind(rig, *meshes, **options)
    assert states() == before
    return str(caught.value)


def failed(rig, *meshes, match, **options):
    assert refused(rig, *meshes, match=match, **options).rstrip().endswith("Nothing was changed.")


def assert_bound(ob, rig, names=NAMES):
    """Totals of 1 and an Armature modifier; returns the weights."""
    weights = c.dense(ob, names)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert [m.object for m in ob.modifiers if m.type == "ARMATURE"] == [rig]
    return weights


@pytest.mark.parametrize("method", ["VOLUMETRIC", "PAPER"])
def test_a_tube_follows_its_bones(method):
    ob, rig = bare_tube()
    assert bind(rig, ob, method=method) == {"FINISHED"}
    assert ob.parent == rig
    weights = assert_bound(ob, rig)
    heights = np.array([v.co.z for v in ob.data.vertices])
    for bone, middle in enumerate((0.5, 1.5, 2.5)):
        assert (weights[np.abs(heights - middle) < 0.3].argmax(axis=1) == bone).all()
    assert 0.3 < weights[np.abs(heights - 1.0) < 0.01][:, 0].mean() < 0.7


def test_a_body_keeps_left_and_right_apart():
    ob, rig = c.biped("Body", seed=4)
    assert bind(rig, ob) == {"FINISHED"}
    names = c.bone_names(rig)
    weights = assert_bound(ob, rig, names)
    x = np.array([v.co.x for v in ob.data.vertices])
    left, right = (np.array([name.endswith(side) for name in names]) for side in (".L", ".R"))
    other = weights[x > 0.02][:, right].sum() + weights[x < -0.02][:, left].sum()
    assert other / len(x) <= 0.001
    assert (weights.max(axis=0) > 0.8).all()


def test_moves_with_the_pose():
    ob, rig = bare_tube()
    bind(rig, ob)
    rig.pose.bones["upper"].location = (0, 1, 0)
    bpy.context.view_layer.update()
    shown = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert shown.vertices[-1].co.z == pytest.approx(4.0, abs=1e-4)
    assert shown.vertices[-2].co.z == pytest.approx(0.0, abs=1e-4)


def test_what_is_on_the_body_follows_it():
    ob, rig = bare_tube()
    button = c.mesh_object("Button", [(0.55, 0, 2.5), (0.6, 0.02, 2.5), (0.6, 0, 2.52)], [(0, 1, 2)])
    # A collar around the joint, which alone would not know where the body is.
    collar = c.mesh_object("Collar", *c.tube(12, 5, height=0.6, radius=0.52))
    collar.location.z = 1.7
    bpy.context.view_layer.update()
    assert bind(rig, ob, button, collar) == {"FINISHED"}
    body, on_body, around = (assert_bound(each, rig) for each in (ob, button, collar))
    assert (on_body == on_body[0]).all()
    assert on_body[0, 2] > 0.9
    heights = np.array([v.co.z for v in ob.data.vertices])
    ring = np.array([(collar.matrix_world @ v.co).z for v in collar.data.vertices])
    at_joint = [weights[np.abs(z - 2.0) < 0.01].mean(axis=0) for weights, z in ((body, heights), (around, ring))]
    assert np.abs(at_joint[0] - at_joint[1]).sum() < 0.1
    assert around[ring < 1.75, 1].mean() > 0.5 > around[ring > 2.25, 1].mean()
    assert bind(rig, ob, button, collar, use_together=False) == {"FINISHED"}
    for each in (ob, button, collar):
        assert_bound(each, rig)


def test_the_place_of_the_objects_does_not_matter():
    ob, rig = c.biped("Body", seed=1)
    names = c.bone_names(rig)
    bind(rig, ob)
    weights = c.dense(ob, names)
    place = Matrix.LocRotScale((3, 2, 1), Euler((0.4, 0.7, -1.1)), (7, 7, 7))
    ob.parent = None
    ob.matrix_world = rig.matrix_world = place
    bpy.context.view_layer.update()
    bind(rig, ob)
    np.testing.assert_allclose(np.array(ob.matrix_world), np.array(place), atol=1e-5)
    assert np.abs(c.dense(ob, names) - weights).sum(axis=1).mean() < 0.01


def test_locked_groups_and_groups_without_a_bone_stay():
    ob, rig = bare_tube()
    ob.vertex_groups.new(name="Mask").add([2, 4], 0.25, "REPLACE")
    ob.vertex_groups.new(name="upper").add([1, 3, 4], 0.75, "REPLACE")
    ob.vertex_groups["upper"].lock_weight = True
    bind(rig, ob)
    weights = c.dense(ob, (*NAMES, "Mask"))
    assert set(np.flatnonzero(weights[:, 2])) == {1, 3, 4}
    assert set(np.flatnonzero(weights[:, 3])) == {2, 4}
    np.testing.assert_allclose(weights[:, :3].sum(axis=1), 1, atol=1e-6)


def test_only_selected_vertices_bones_and_bare_vertices():
    ob, rig = bare_tube()
    c.paint(ob, rig, falloff=1.5)
    before = c.dense(ob, NAMES)
    chosen = np.zeros(len(before), bool)
    chosen[30:60] = True
    ob.data.vertices.foreach_set("select", chosen)
    bind(rig, ob, only_selected=True)
    after = c.dense(ob, NAMES)
    assert (after[~chosen] == before[~chosen]).all()
    assert (after[chosen] != before[chosen]).any()

    for bone in rig.data.bones:
        bone.select = bone.name == "upper"
    before = c.dense(ob, NAMES)
    bind(rig, ob, subset="SELECTED")
    after = c.dense(ob, NAMES)
    assert (after[:, :2] == before[:, :2]).all()
    bind(rig, ob, subset="SELECTED", other_groups="SCALE")
    np.testing.assert_allclose(assert_bound(ob, rig).sum(axis=1), 1, atol=1e-6)

    for name in NAMES:
        ob.vertex_groups[name].remove([5, 6])
    before = c.dense(ob, NAMES)
    bind(rig, ob, replace=False)
    after = c.dense(ob, NAMES)
    bare = before.sum(axis=1) == 0
    assert bare.sum() == 2
    assert (after[~bare] == before[~bare]).all()
    np.testing.assert_allclose(after[bare].sum(axis=1), 1, atol=1e-6)


def test_limit_of_influences():
    ob, rig = c.biped("Body")
    for limit in (1, 2):
        bind(rig, ob, max_influences=limit)
        weights = assert_bound(ob, rig, c.bone_names(rig))
        assert np.count_nonzero(weights, axis=1).max() == limit


def test_the_pose_does_not_matter_unless_asked_for():
    ob, rig = bare_tube()
    bind(rig, ob)
    weights = c.dense(ob, NAMES)
    rig.pose.bones["upper"].rotation_mode = "XYZ"
    rig.pose.bones["upper"].rotation_euler = (1.2, 0, 0)
    bpy.context.view_layer.update()
    bind(rig, ob)
    assert (c.dense(ob, NAMES) == weights).all()
    bind(rig, ob, geometry="EVALUATED")
    posed = assert_bound(ob, rig)
    assert 0 < np.abs(posed - weights).sum(axis=1).mean() < 0.5


def test_undo_and_redo():
    ob, rig = bare_tube()
    c.activate(rig, ob)
    bpy.ops.ed.undo_push(message="Before")
    assert bpy.ops.dermis.bind_weights("EXEC_DEFAULT", True) == {"FINISHED"}
    after = c.dense(bpy.data.objects["Tube"], NAMES)
    bpy.ops.ed.undo()
    ob = bpy.data.objects["Tube"]
    assert (len(ob.vertex_groups), len(ob.modifiers), ob.parent) == (0, 0, None)
    bpy.ops.ed.redo()
    assert (c.dense(bpy.data.objects["Tube"], NAMES) == after).all()


def test_from_the_mesh_that_is_active():
    ob, rig = bare_tube()
    c.deform(ob, rig)
    c.activate(ob)
    assert bpy.ops.dermis.bind_weights() == {"FINISHED"}
    assert_bound(ob, rig)


def test_a_failed_write_leaves_everything_as_it_was(monkeypatch):
    ob, rig = bare_tube()
    second, _ = bare_tube("Second")
    module = sys.modules[f"{MODULE}.blender.bind_job"]
    original = module.attach_armature

    def fails_at_the_last(which, armature):
        original(which, armature)
        if which == ob:
            raise OSError("disk on fire")

    monkeypatch.setattr(module, "attach_armature", fails_at_the_last)
    refused(rig, ob, second, match="Disk on fire. Nothing was changed.")


def test_refusals():
    ob, rig = bare_tube()
    refused(rig, match="Select the meshes too")
    refused(ob, match="so that the armature is active")
    c.activate(rig, ob)
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Leave Edit Mode first"):
        bpy.ops.dermis.bind_weights()
    bpy.ops.object.mode_set(mode="OBJECT")

    other = c.mesh_object("Other", *c.tube(5, 4))
    c.deform(other, c.armature("Foreign", c.tube_bones()))
    failed(rig, ob, other, match="'Other' follows the armature 'Foreign', not 'TubeRig'")
    points = c.mesh_object("Points", [(0, 0, 0), (1, 0, 0)], [])
    failed(rig, ob, points, match="'Points' has 2 vertices and no faces")
    broken = c.mesh_object("Broken", [(0, 0, 0), (1, 0, 0), (0, float("nan"), 0)], [(0, 1, 2)])
    failed(rig, ob, broken, match="'Broken' has coordinates that are not finite at 1 vertex, the first is vertex 2")
    for bone in rig.data.bones:
        bone.use_deform = False
    failed(rig, ob, match="Armature 'TubeRig' has no deforming bone")
    for bone in rig.data.bones:
        bone.use_deform = True
        bone.select = False
    rig.data.bones.active = None
    failed(rig, ob, subset="SELECTED", match="No deforming bone of 'TubeRig' is selected")
    failed(rig, ob, subset="UNLOCKED", match="'Tube' has no unlocked group")
    ob.data.vertices.foreach_set("select", np.zeros(len(ob.data.vertices), bool))
    failed(rig, ob, only_selected=True, match="No vertex of 'Tube' is selected")
    for name in NAMES:
        ob.vertex_groups.new(name=name).lock_weight = True
    failed(rig, ob, match="All bone groups of 'Tube' are locked")
    shared = bpy.data.objects.new("Shared", other.data)
    bpy.context.collection.objects.link(shared)
    failed(rig, shared, match="is used by")


def test_where_bone_heat_fails():
    """Blender's own bind leaves bones without weights on a tube in pieces beside its bones; this one does not."""
    vertices, faces = c.tube(12, 13)
    vertices = np.array(vertices)
    pieces = [[tuple(vertices[i]) for i in face] for face in faces]
    corners = [point for piece in pieces for point in piece]
    starts = np.cumsum([0] + [len(piece) for piece in pieces])
    ob = c.mesh_object("Pieces", corners, [tuple(range(a, b)) for a, b in itertools.pairwise(starts)])
    rig = c.armature("Rig", c.tube_bones())
    rig.location.x = 0.7
    bpy.context.view_layer.update()
    assert bind(rig, ob) == {"FINISHED"}
    weights = assert_bound(ob, rig)
    assert (weights.max(axis=0) > 0.9).all()
    place = {}
    for corner, row in zip(corners, weights, strict=True):
        np.testing.assert_allclose(place.setdefault(tuple(np.round(corner, 5)), row), row, atol=1e-6)


@pytest.mark.parametrize("name", ["YOUNG_MALE", "CHILD", "HEAVY", "OLD_WOMAN"])
def test_nearer_to_the_artist_than_blenders_bone_heat(name):
    body = makehuman.decimated(makehuman.body(name, **getattr(makehuman, name)), 8000)
    errors = []
    for own in (True, False):
        ob = c.mesh_object(f"{name} {own}", body.vertices, body.triangles.tolist())
        parents = [None if parent < 0 else body.bone_names[parent] for parent in body.parents]
        rig = c.armature("Rig", zip(body.bone_names, parents, body.heads, body.tails, strict=True))
        rig.data.bones["Root"].use_deform = False
        c.activate(rig, ob)
        done = bpy.ops.dermis.bind_weights() if own else bpy.ops.object.parent_set(type="ARMATURE_AUTO")
        assert done == {"FINISHED"}
        weights = c.dense(ob, body.bone_names)
        errors.append(np.abs(weights - body.weights).sum(axis=1).mean())
    assert errors[0] <= 0.42
    assert errors[0] < errors[1]


@pytest.fixture
def gate(monkeypatch):
    """A bind that waits until it is let through or cancelled."""
    in_window(monkeypatch)
    yield from held(monkeypatch, "bind", "bind_weights")


def test_in_a_window(gate):
    operator, context = stand_in_for("bind_weights"), Context()
    ob, rig = bare_tube()
    c.activate(rig, ob)
    bpy.context.view_layer.update()
    before = c.state(ob)
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    assert operator.modal(context, event("TIMER")) == {"RUNNING_MODAL"}
    assert "Binding" in context.status
    assert operator.modal(context, event("ESC", "PRESS")) == {"CANCELLED"}
    assert c.state(ob) == before
    assert context.status is None
    operator = stand_in_for("bind_weights")
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    gate.set()
    assert until_ended(operator, context) == {"FINISHED"}
    assert_bound(ob, rig)
    assert [kind for kind, _ in operator.reports] == ["INFO"]
