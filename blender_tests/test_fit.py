# SPDX-License-Identifier: GPL-3.0-or-later
"""Fitting an armature into meshes through the operator: what moves and what stays."""

import sys
from types import SimpleNamespace

import bpy
import characters as c
import fits
import numpy as np
import pytest
from layouts import draw
from mathutils import Euler, Matrix, Vector
from scratch_profile import MODULE
from windows import stand_in_for


@pytest.fixture
def body():
    return fits.bare_body()


def test_the_bones_go_where_the_body_has_its_joints(body):
    rig = fits.template()
    names = c.bone_names(rig)
    assert fits.fit(rig, body) == {"FINISHED"}
    truth = {name: np.array([head, tail]) for name, _, head, tail in c.biped_bones()}
    fitted = fits.joints(rig)
    errors = {name: np.linalg.norm(fitted[name] - truth[name], axis=1) for name in names}
    # Of a height of 1.9 m.
    assert np.mean([errors[name][0] for name in names]) < 0.05
    assert max(error[0] for error in errors.values()) < 0.12
    for name in names:
        side = {"L": 1, "R": -1}.get(name.split(".")[-1], 0)
        assert (fitted[name][:, 0] * side >= 0).all()
    for bone in rig.data.bones:
        if bone.use_connect:
            assert bone.head_local == bone.parent.tail_local


def test_everything_else_stays(body):
    rig = fits.template()
    rig.data.collections.new("Left").assign(rig.data.bones["arm.L"])
    rig.data.bones["shin.R"].hide = True
    rig.data.bones["chest"].select = False
    rig.data.bones["arm.L"].bbone_segments = 4
    pose = rig.pose.bones["shin.L"]
    pose.rotation_quaternion = (0.8, 0.6, 0, 0)
    pose.constraints.new("LIMIT_ROTATION").name = "Knee"
    rig.data.use_mirror_x = True
    bystander = c.armature("Bystander", c.tube_bones())
    c.activate(rig, body, bystander)
    bpy.context.view_layer.update()
    kept, before, other = fits.settings(rig), fits.rest(rig), fits.rest(bystander)
    mesh = c.state(body)
    assert bpy.ops.dermis.fit_skeleton() == {"FINISHED"}
    assert fits.settings(rig) == kept
    assert fits.rest(bystander) == other
    assert c.state(body) == mesh
    after = fits.rest(rig)
    assert all(after[name] != before[name] for name in ("arm.L", "shin.R", "chest"))


def test_the_roll_goes_along(body):
    rig = fits.template()
    before = {bone.name: bone.matrix_local.to_3x3() for bone in rig.data.bones}
    fits.fit(rig, body)
    for bone in rig.data.bones:
        after = bone.matrix_local.to_3x3()
        turn = before[bone.name].col[1].rotation_difference(after.col[1])
        expected = turn @ before[bone.name].col[2]
        assert expected.angle(after.col[2]) < 1e-3, bone.name


def test_the_place_of_the_objects_does_not_matter(body):
    rig = fits.template()
    fits.fit(rig, body)
    wanted = fits.joints(rig)
    rig = fits.template("Second")
    # The mesh is made in a space of its own; the armature is turned and scaled unevenly.
    own = Matrix.LocRotScale((3, 2, 1), Euler((0.4, 0.7, -1.1)), (0.01, 0.02, 0.03))
    body.data.transform(own.inverted())
    body.matrix_world = own
    place = Matrix.LocRotScale((0.3, -2, 0.5), Euler((0.2, 0.1, 0.3)), (2, 3, -4))
    with fits.in_edit_mode(rig) as edit:
        for bone in edit:
            bone.use_connect = False
        for bone in edit:
            bone.head, bone.tail = place.inverted() @ bone.head, place.inverted() @ bone.tail
    rig.matrix_world = place
    bpy.context.view_layer.update()
    assert fits.fit(rig, body) == {"FINISHED"}
    found = fits.joints(rig)
    np.testing.assert_allclose(
        np.array([found[name] for name in wanted]), np.array([wanted[name] for name in wanted]), atol=0.04
    )
    assert body.matrix_world.translation == Vector((3, 2, 1))


@pytest.mark.parametrize("mode", ["OBJECT", "POSE", "EDIT"])
def test_the_mode_stays(body, mode):
    rig = fits.template()
    partner = c.armature("Partner", c.tube_bones())
    c.activate(rig, body, partner)
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode=mode)
    modes = {ob.name: ob.mode for ob in bpy.data.objects}
    before = fits.rest(rig)
    assert bpy.ops.dermis.fit_skeleton() == {"FINISHED"}
    assert {ob.name: ob.mode for ob in bpy.data.objects} == modes
    assert sorted(ob.name for ob in bpy.context.selected_objects) == ["Body", "Partner", "Rig"]
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    assert fits.rest(rig)["arm.L"] != before["arm.L"]


@pytest.mark.parametrize("mode", ["POSE", "EDIT"])
def test_selected_bones_stay(body, mode):
    rig = fits.template()
    c.activate(rig, body)
    bpy.ops.object.mode_set(mode=mode)
    if mode == "EDIT":
        for bone in rig.data.edit_bones:
            bone.select = bone.select_head = bone.select_tail = bone.name == "arm.L"
    else:
        for bone in rig.data.bones:
            bone.select = bone.name == "arm.L"
    arm, thigh = fits.place(rig, "arm.L"), fits.place(rig, "thigh.L")
    roll = rig.data.bones["arm.L"].matrix_local.copy()
    assert bpy.ops.dermis.fit_skeleton(keep_selected=True) == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    assert fits.place(rig, "arm.L") == arm
    assert fits.place(rig, "thigh.L") != thigh
    np.testing.assert_allclose(rig.data.bones["arm.L"].matrix_local, roll, atol=1e-6)
    assert rig.data.bones["hand.L"].head_local == rig.data.bones["arm.L"].tail_local


def test_locked_bones_stay(body):
    rig = fits.template()
    with fits.in_edit_mode(rig) as edit:
        edit["thigh.R"].lock = True
    rig.data.use_mirror_x = True
    thigh, arm = fits.place(rig, "thigh.R"), fits.place(rig, "arm.R")
    fits.fit(rig, body)
    assert fits.place(rig, "thigh.R") == thigh
    assert fits.place(rig, "arm.R") != arm
    with fits.in_edit_mode(rig) as edit:
        assert [bone.name for bone in edit if bone.lock] == ["thigh.R"]


def test_several_meshes_are_one_body(body):
    whole, parts = fits.template("Whole"), fits.template("Parts")
    fits.fit(whole, body)
    low = [v.co.z < 1.0 for v in body.data.vertices]
    shape = [tuple(v.co) for v in body.data.vertices]
    faces = [tuple(p.vertices) for p in body.data.polygons]
    split = [all(low[i] for i in face) for face in faces]
    legs = c.mesh_object("Legs", shape, [face for face, below in zip(faces, split, strict=True) if below])
    rest_of = c.mesh_object("Rest", shape, [face for face, below in zip(faces, split, strict=True) if not below])
    assert fits.fit(parts, legs, rest_of) == {"FINISHED"}
    first, second = fits.joints(whole), fits.joints(parts)
    for name in ("arm.L", "shin.L", "chest"):
        np.testing.assert_allclose(first[name], second[name], atol=0.1)


def test_the_body_as_it_is_shown(body):
    whole = fits.template("Whole")
    fits.fit(whole, body)
    half = c.mesh_object("Half", [], [])
    keep = [i for i, v in enumerate(body.data.vertices) if v.co.x > -0.005]
    place = {old: new for new, old in enumerate(keep)}
    faces = [tuple(p.vertices) for p in body.data.polygons if all(i in place for i in p.vertices)]
    half.data.from_pydata(
        [tuple(body.data.vertices[i].co) for i in keep], [], [tuple(place[i] for i in face) for face in faces]
    )
    half.modifiers.new("Mirror", "MIRROR")
    rig = fits.template()
    assert fits.fit(rig, half) == {"FINISHED"}
    for name in ("arm.L", "arm.R", "shin.R"):
        np.testing.assert_allclose(fits.joints(rig)[name], fits.joints(whole)[name], atol=0.1)


def test_the_pose_of_the_body_does_not_matter(body):
    free = fits.template("Free")
    fits.fit(free, body)
    wanted = fits.joints(free)
    c.activate(free, body)
    bpy.ops.dermis.bind_weights()
    free.pose.bones["arm.L"].rotation_mode = "XYZ"
    free.pose.bones["arm.L"].rotation_euler = (1.0, 0.3, 0)
    free.pose.bones["hips"].location = (0, 0.4, 0)
    bpy.context.view_layer.update()
    rig = fits.template()
    assert fits.fit(rig, body) == {"FINISHED"}
    assert free.data.pose_position == "POSE"
    for name, points in fits.joints(rig).items():
        np.testing.assert_allclose(points, wanted[name], atol=0.03)


def test_options_reach_the_core(body, monkeypatch):
    module = sys.modules[f"{MODULE}.core.fit"]
    original, calls = module.fit_skeleton, []

    def spy(mesh, skeleton, **options):
        calls.append((skeleton.names, options))
        return original(mesh, skeleton, **options)

    monkeypatch.setattr(module, "fit_skeleton", spy)
    rig = fits.template()
    for options, deforming, symmetric in (
        ({}, False, None),
        ({"deform_only": False, "symmetry": "OFF"}, True, False),
        ({"symmetry": "ON"}, False, True),
    ):
        fits.fit(rig, body, **options)
        names, given = calls.pop()
        assert dict(zip(names, given["deform"], strict=True))["control"] is deforming
        assert given["symmetric"] is symmetric
        assert not any(given["fixed"])


def test_undo_and_redo(body):
    rig = fits.template()
    c.activate(rig, body)
    before = fits.rest(rig)
    bpy.ops.ed.undo_push(message="Before")
    assert bpy.ops.dermis.fit_skeleton("EXEC_DEFAULT", True) == {"FINISHED"}
    after = fits.rest(bpy.data.objects["Rig"])
    assert after != before
    bpy.ops.ed.undo()
    assert fits.rest(bpy.data.objects["Rig"]) == before
    bpy.ops.ed.redo()
    assert fits.rest(bpy.data.objects["Rig"]) == after


def test_undo_in_edit_mode(body):
    rig = fits.template()
    before = fits.rest(rig)
    c.activate(rig, body)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ed.undo_push(message="Before")
    assert bpy.ops.dermis.fit_skeleton("EXEC_DEFAULT", True) == {"FINISHED"}
    moved = bpy.data.objects["Rig"].data.edit_bones["arm.L"].head.copy()
    bpy.ops.ed.undo()
    rig = bpy.data.objects["Rig"]
    assert rig.mode == "EDIT"
    assert rig.data.edit_bones["arm.L"].head != moved
    bpy.ops.object.mode_set(mode="OBJECT")
    assert fits.rest(rig) == before


def test_stretch_to_is_mentioned(body):
    rig = fits.template()
    stretch = rig.pose.bones["hand.L"].constraints.new("STRETCH_TO")
    stretch.target, stretch.subtarget, stretch.rest_length = rig, "chest", 0.5
    operator = stand_in_for("fit_skeleton")
    c.activate(rig, body)
    assert operator.execute(bpy.context) == {"FINISHED"}
    assert stretch.rest_length == 0.5
    [(kind, text)] = operator.reports
    assert kind == "WARNING"
    assert text.endswith("Stretch To keeps its old length on 'hand.L': reset it there.")


def test_controls_stay_at_their_joints(body):
    rig = fits.template()
    arm = rig.pose.bones["hand.L"].constraints.new("COPY_LOCATION")
    arm.target, arm.subtarget = rig, "wrist control"
    operator = stand_in_for("fit_skeleton")
    c.activate(rig, body)
    bpy.context.view_layer.update()
    assert operator.execute(bpy.context) == {"FINISHED"}
    joints = fits.joints(rig)
    np.testing.assert_allclose(joints["wrist control"][0], joints["hand.L"][0], atol=1e-5)
    assert "Constraints" not in operator.reports[0][1]


def test_constraints_that_hold_bones_are_mentioned(body):
    rig = fits.template()
    limit = rig.pose.bones["head"].constraints.new("LIMIT_LOCATION")
    limit.use_max_z, limit.max_z = True, rig.data.bones["head"].head_local.z
    operator = stand_in_for("fit_skeleton")
    c.activate(rig, body)
    bpy.context.view_layer.update()
    assert operator.execute(bpy.context) == {"FINISHED"}
    [(kind, text)] = operator.reports
    assert kind == "WARNING"
    assert "Constraints now hold 1 deforming bone off the new rest place: 'head'. Fit the skeleton" in text


def test_a_doubtful_result_is_a_warning(body, monkeypatch):
    reports = []
    module = sys.modules[f"{MODULE}.core.fit"]
    original = module.fit_skeleton

    def doubtful(*arguments, **options):
        fitted = original(*arguments, **options)
        return SimpleNamespace(
            skeleton=fitted.skeleton,
            method="template",
            score=0.21,
            message="the template looks like another species",
            found=np.zeros(len(fitted.found), bool),
            symmetric=False,
        )

    monkeypatch.setattr(module, "fit_skeleton", doubtful)
    operator = stand_in_for("fit_skeleton")
    operator.report = lambda kind, text: reports.append((*kind, text))
    rig = fits.template()
    c.activate(rig, body)
    assert operator.execute(bpy.context) == {"FINISHED"}
    ((kind, text),) = reports
    assert kind == "WARNING"
    assert text.startswith("'Rig' fitted into 'Body': 0 bones placed by the shape, 13 carried along, score 0.21, ")
    assert text.endswith("The template looks like another species.")


def test_panel(body):
    assert "Select the meshes, then the armature" in " ".join(draw("DERMIS_PT_fit"))
    rig = fits.template()
    c.activate(rig, body)
    assert draw("DERMIS_PT_fit") == ["Rig", "Body", "dermis.fit_skeleton", "dermis.fit_skeleton"]
    bpy.ops.object.mode_set(mode="POSE")
    assert draw("DERMIS_PT_fit").count("dermis.fit_skeleton") == 3
    c.mesh_object("Shoe", *c.tube(5, 4)).select_set(True)
    assert "2 meshes" in draw("DERMIS_PT_fit")
