# SPDX-License-Identifier: GPL-3.0-or-later
"""Fitting an armature into meshes through the operator: what moves, what stays, what is refused."""

import math
import sys
import threading
from types import SimpleNamespace

import bpy
import characters as c
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector
from scratch_profile import MODULE
from test_modal import Context, event, stand_in_for, until_ended


def template(name="Rig"):
    """A biped's bones with other proportions than the body: connected limbs, rolls, a control bone."""
    bones = [(bone, parent, head, tail) for bone, parent, head, tail in c.biped_bones(arm=0.7, leg=0.8)]
    bones.append(("control", None, (0, 0.5, 0), (0, 0.9, 0)))
    rig = c.armature(name, bones)
    with in_edit_mode(rig) as edit:
        for i, bone in enumerate(edit):
            bone.roll = 0.3 * i - 1.0
            bone.use_deform = bone.name != "control"
        for bone in edit:
            if bone.name.split(".")[0] in ("hand", "shin", "chest"):
                bone.use_connect = True
    return rig


class in_edit_mode:  # noqa: N801  (reads like a function)
    def __init__(self, rig):
        self.rig = rig

    def __enter__(self):
        c.activate(self.rig)
        bpy.ops.object.mode_set(mode="EDIT")
        return self.rig.data.edit_bones

    def __exit__(self, *_):
        bpy.ops.object.mode_set(mode="OBJECT")


@pytest.fixture(scope="module")
def body_shape(addon):
    """Vertices and faces of a body, grown once."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    ob, _ = c.biped("Grown", voxel=0.04)
    return [tuple(v.co) for v in ob.data.vertices], [tuple(p.vertices) for p in ob.data.polygons]


@pytest.fixture
def body(body_shape, empty_scene):
    return c.mesh_object("Body", *body_shape)


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


def test_the_bones_go_where_the_body_has_its_joints(body):
    rig = template()
    names = c.bone_names(rig)
    assert fit(rig, body) == {"FINISHED"}
    truth = {name: np.array([head, tail]) for name, _, head, tail in c.biped_bones()}
    fitted = joints(rig)
    errors = {name: np.linalg.norm(fitted[name] - truth[name], axis=1) for name in names}
    assert np.mean([errors[name][0] for name in names]) < 0.09  # of 1.9 m
    assert max(error[0] for error in errors.values()) < 0.2
    for name in names:
        side = {"L": 1, "R": -1}.get(name.split(".")[-1], 0)
        assert (fitted[name][:, 0] * side >= 0).all()
    for bone in rig.data.bones:
        if bone.use_connect:
            assert bone.head_local == bone.parent.tail_local


def test_everything_else_stays(body):
    rig = template()
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
    kept, before, other = settings(rig), rest(rig), rest(bystander)
    mesh = c.state(body)
    assert bpy.ops.dermis.fit_skeleton() == {"FINISHED"}
    assert settings(rig) == kept
    assert rest(bystander) == other
    assert c.state(body) == mesh
    after = rest(rig)
    assert all(after[name] != before[name] for name in ("arm.L", "shin.R", "chest"))


def test_the_roll_goes_along(body):
    rig = template()
    before = {bone.name: bone.matrix_local.to_3x3() for bone in rig.data.bones}
    fit(rig, body)
    for bone in rig.data.bones:
        after = bone.matrix_local.to_3x3()
        turn = before[bone.name].col[1].rotation_difference(after.col[1])
        expected = turn @ before[bone.name].col[2]
        assert expected.angle(after.col[2]) < 1e-3, bone.name


def test_the_place_of_the_objects_does_not_matter(body):
    rig = template()
    fit(rig, body)
    wanted = joints(rig)
    rig = template("Second")
    # The mesh is made in a space of its own; the armature is turned and scaled unevenly.
    own = Matrix.LocRotScale((3, 2, 1), Euler((0.4, 0.7, -1.1)), (0.01, 0.02, 0.03))
    body.data.transform(own.inverted())
    body.matrix_world = own
    place = Matrix.LocRotScale((0.3, -2, 0.5), Euler((0.2, 0.1, 0.3)), (2, 3, -4))
    with in_edit_mode(rig) as edit:
        for bone in edit:
            bone.use_connect = False
        for bone in edit:
            bone.head, bone.tail = place.inverted() @ bone.head, place.inverted() @ bone.tail
    rig.matrix_world = place
    bpy.context.view_layer.update()
    assert fit(rig, body) == {"FINISHED"}
    found = joints(rig)
    np.testing.assert_allclose(
        np.array([found[name] for name in wanted]), np.array([wanted[name] for name in wanted]), atol=2e-3
    )
    assert body.matrix_world.translation == Vector((3, 2, 1))


@pytest.mark.parametrize("mode", ["OBJECT", "POSE", "EDIT"])
def test_the_mode_stays(body, mode):
    rig = template()
    partner = c.armature("Partner", c.tube_bones())
    c.activate(rig, body, partner)
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode=mode)
    modes = {ob.name: ob.mode for ob in bpy.data.objects}
    before = rest(rig)
    assert bpy.ops.dermis.fit_skeleton() == {"FINISHED"}
    assert {ob.name: ob.mode for ob in bpy.data.objects} == modes
    assert sorted(ob.name for ob in bpy.context.selected_objects) == ["Body", "Partner", "Rig"]
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    assert rest(rig)["arm.L"] != before["arm.L"]


@pytest.mark.parametrize("mode", ["POSE", "EDIT"])
def test_selected_bones_stay(body, mode):
    rig = template()
    c.activate(rig, body)
    bpy.ops.object.mode_set(mode=mode)
    if mode == "EDIT":
        for bone in rig.data.edit_bones:
            bone.select = bone.select_head = bone.select_tail = bone.name == "arm.L"
    else:
        for bone in rig.data.bones:
            bone.select = bone.name == "arm.L"
    arm, thigh = place(rig, "arm.L"), place(rig, "thigh.L")
    roll = rig.data.bones["arm.L"].matrix_local.copy()
    assert bpy.ops.dermis.fit_skeleton(keep_selected=True) == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    assert place(rig, "arm.L") == arm
    assert place(rig, "thigh.L") != thigh
    np.testing.assert_allclose(rig.data.bones["arm.L"].matrix_local, roll, atol=1e-6)
    assert rig.data.bones["hand.L"].head_local == rig.data.bones["arm.L"].tail_local


def test_locked_bones_stay(body):
    rig = template()
    with in_edit_mode(rig) as edit:
        edit["thigh.R"].lock = True
    thigh, arm = place(rig, "thigh.R"), place(rig, "arm.R")
    fit(rig, body)
    assert place(rig, "thigh.R") == thigh
    assert place(rig, "arm.R") != arm
    with in_edit_mode(rig) as edit:
        assert [bone.name for bone in edit if bone.lock] == ["thigh.R"]


def test_several_meshes_are_one_body(body):
    whole, parts = template("Whole"), template("Parts")
    fit(whole, body)
    low = [v.co.z < 1.0 for v in body.data.vertices]
    shape = [tuple(v.co) for v in body.data.vertices]
    faces = [tuple(p.vertices) for p in body.data.polygons]
    split = [all(low[i] for i in face) for face in faces]
    legs = c.mesh_object("Legs", shape, [face for face, below in zip(faces, split, strict=True) if below])
    rest_of = c.mesh_object("Rest", shape, [face for face, below in zip(faces, split, strict=True) if not below])
    assert fit(parts, legs, rest_of) == {"FINISHED"}
    first, second = joints(whole), joints(parts)
    for name in ("arm.L", "shin.L", "chest"):
        np.testing.assert_allclose(first[name], second[name], atol=0.1)


def test_the_body_as_it_is_shown(body):
    whole = template("Whole")
    fit(whole, body)
    half = c.mesh_object("Half", [], [])
    keep = [i for i, v in enumerate(body.data.vertices) if v.co.x > -0.005]
    place = {old: new for new, old in enumerate(keep)}
    faces = [tuple(p.vertices) for p in body.data.polygons if all(i in place for i in p.vertices)]
    half.data.from_pydata(
        [tuple(body.data.vertices[i].co) for i in keep], [], [tuple(place[i] for i in face) for face in faces]
    )
    half.modifiers.new("Mirror", "MIRROR")
    rig = template()
    assert fit(rig, half) == {"FINISHED"}
    for name in ("arm.L", "arm.R", "shin.R"):
        np.testing.assert_allclose(joints(rig)[name], joints(whole)[name], atol=0.1)


def test_the_pose_of_the_body_does_not_matter(body):
    free = template("Free")
    fit(free, body)
    wanted = joints(free)
    c.activate(free, body)
    bpy.ops.dermis.bind_weights()
    free.pose.bones["arm.L"].rotation_mode = "XYZ"
    free.pose.bones["arm.L"].rotation_euler = (1.0, 0.3, 0)
    free.pose.bones["hips"].location = (0, 0.4, 0)
    bpy.context.view_layer.update()
    rig = template()
    assert fit(rig, body) == {"FINISHED"}
    assert free.data.pose_position == "POSE"
    for name, points in joints(rig).items():
        np.testing.assert_allclose(points, wanted[name], atol=1e-4)


def test_options_reach_the_core(body, monkeypatch):
    module = sys.modules[f"{MODULE}.core.fit"]
    original, calls = module.fit_skeleton, []

    def spy(mesh, skeleton, **options):
        calls.append((skeleton.names, options))
        return original(mesh, skeleton, **options)

    monkeypatch.setattr(module, "fit_skeleton", spy)
    rig = template()
    for options, deforming, symmetric in (
        ({}, False, None),
        ({"deform_only": False, "symmetry": "OFF"}, True, False),
        ({"symmetry": "ON"}, False, True),
    ):
        fit(rig, body, **options)
        names, given = calls.pop()
        assert dict(zip(names, given["deform"], strict=True))["control"] is deforming
        assert given["symmetric"] is symmetric
        assert not any(given["fixed"])


def test_undo_and_redo(body):
    rig = template()
    c.activate(rig, body)
    before = rest(rig)
    bpy.ops.ed.undo_push(message="Before")
    assert bpy.ops.dermis.fit_skeleton("EXEC_DEFAULT", True) == {"FINISHED"}
    after = rest(bpy.data.objects["Rig"])
    assert after != before
    bpy.ops.ed.undo()
    assert rest(bpy.data.objects["Rig"]) == before
    bpy.ops.ed.redo()
    assert rest(bpy.data.objects["Rig"]) == after


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
    rig = template()
    c.activate(rig, body)
    assert operator.execute(bpy.context) == {"FINISHED"}
    ((kind, text),) = reports
    assert kind == "WARNING"
    assert text.startswith("'Rig' fitted into 'Body': 0 bones placed by the shape, 12 carried along, score 0.21, ")
    assert "The template looks like another species. The skeleton fits badly" in text


def test_a_failed_write_leaves_everything_as_it_was(body, monkeypatch):
    module = sys.modules[f"{MODULE}.blender.rest_bones"]

    def fails(_):
        raise OSError("disk on fire")

    original = module.Vector
    made = []

    def vector(values):
        made.append(values)
        return original(values) if len(made) < 9 else fails(values)

    monkeypatch.setattr(module, "Vector", vector)
    rig = template()
    c.activate(rig, body)
    before = everything()
    with pytest.raises(RuntimeError, match="Disk on fire. Nothing was changed."):
        bpy.ops.dermis.fit_skeleton()
    assert len(made) == 9
    assert everything() == before


def test_bones_that_blender_would_remove(body, monkeypatch):
    module = sys.modules[f"{MODULE}.core.fit"]
    original = module.fit_skeleton

    def collapsed(*arguments, **options):
        fitted = original(*arguments, **options)
        skeleton = fitted.skeleton
        tails = skeleton.tails.copy()
        place = skeleton.names.index("head")
        tails[place] = skeleton.heads[place]
        return SimpleNamespace(
            skeleton=SimpleNamespace(heads=skeleton.heads, tails=tails),
            **{name: getattr(fitted, name) for name in ("method", "score", "message", "found", "symmetric")},
        )

    monkeypatch.setattr(module, "fit_skeleton", collapsed)
    failed(template(), body, match="Bones of 'Rig' would be too short for Blender: 'head'")


def test_refusals(body):
    rig = template()
    with pytest.raises(RuntimeError, match="Select the meshes too"):
        fit(rig)
    with pytest.raises(RuntimeError, match="Make the armature active: click 'Rig' last"):
        fit(body, rig)
    with pytest.raises(RuntimeError, match="so that the armature is active"):
        fit(body)
    c.activate(rig)
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = None
    with pytest.raises(RuntimeError, match="so that the armature is active"):
        bpy.ops.dermis.fit_skeleton()

    points = c.mesh_object("Points", [(0, 0, 0), (1, 0, 0)], [])
    failed(rig, body, points, match="'Points' has 2 vertices and no faces")
    broken = c.mesh_object("Broken", [(0, 0, 0), (1, 0, 0), (0, math.nan, 0)], [(0, 1, 2)])
    failed(rig, broken, match="'Broken' has coordinates that are not finite at 1 vertex, the first is vertex 2")
    flattened = c.mesh_object("Flattened", *c.tube(5, 4))
    flattened.scale.y = 0
    failed(rig, flattened, match="'Flattened' is scaled to zero along some axis")
    carried = c.mesh_object("Carried", *c.tube(5, 4))
    carried.parent, carried.parent_type, carried.parent_bone = rig, "BONE", "head"
    failed(rig, body, carried, match="'Carried' is parented to the bone 'head' of 'Rig'")
    for bone in rig.data.bones:
        bone.select = False
    failed(rig, body, keep_selected=True, match="No bone of 'Rig' is selected")
    for bone in rig.data.bones:
        bone.select = True
    failed(rig, body, keep_selected=True, match="All bones of 'Rig' are kept where they are")
    for bone in rig.data.bones:
        bone.use_deform = bone.name == "head"
    failed(rig, body, match="Armature 'Rig' has one bone to fit, 'head'")
    rig.data.bones["head"].use_deform = False
    failed(rig, body, match="Armature 'Rig' has no deforming bone")
    failed(c.armature("Empty", []), body, match="Armature 'Empty' has no deforming bone")
    shared = template("Shared")
    twin = bpy.data.objects.new("Twin", shared.data)
    bpy.context.collection.objects.link(twin)
    failed(shared, body, match="The armature data 'Shared' is used by 'Shared', 'Twin', which would all change")
    shrunk = template("Shrunk")
    shrunk.scale.x = 0
    failed(shrunk, body, match="'Shrunk' is scaled to zero along some axis")


def test_a_linked_armature(body, tmp_path):
    template("Linked")
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {bpy.data.objects["Linked"]}, fake_user=True)
    bpy.data.objects.remove(bpy.data.objects["Linked"])
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["Linked"]
    rig = wanted.objects[0]
    bpy.context.collection.objects.link(rig)
    failed(rig, body, match="The object 'Linked' is linked from .* and cannot be changed")
    override = rig.override_create(remap_local_usages=True)
    failed(override, body, match="is linked from|is a library override")


# Bodies in which no skeleton can be found: each gives an error that changes nothing, or the scaled
# template with a warning.
def flat_sheet():
    return [(x, 0, z) for z in range(5) for x in range(5)], [
        (5 * z + x, 5 * z + x + 1, 5 * z + x + 6, 5 * z + x + 5) for z in range(4) for x in range(4)
    ]


def far_apart():
    vertices, faces = c.tube(8, 6)
    count = len(vertices)
    moved = [(x + 500, y, z) for x, y, z in vertices]
    return vertices + moved, faces + [tuple(i + count for i in face) for face in faces]


ODD_BODIES = {
    "flat sheet": flat_sheet(),
    "pieces far apart": far_apart(),
    "no volume": ([(0, 0, 0), (0, 0, 1), (0, 0, 2)], [(0, 1, 2)]),
    "one point": ([(0, 0, 0)] * 3, [(0, 1, 2)]),
    "tube": c.tube(12, 13),
}


@pytest.mark.parametrize("name", ODD_BODIES)
def test_odd_bodies(name):
    rig = template()
    ob = c.mesh_object("Odd", *ODD_BODIES[name])
    c.activate(rig, ob)
    bpy.context.view_layer.update()
    before = everything()
    operator = stand_in_for("fit_skeleton")
    status = operator.execute(bpy.context)
    ((kind, text),) = operator.reports
    if status == {"CANCELLED"}:
        assert kind == "ERROR"
        assert text.startswith("'Rig' cannot be fitted into 'Odd': ")
        assert text.endswith("Nothing was changed.")
        assert everything() == before
    else:
        assert (status, kind) == ({"FINISHED"}, "WARNING")
        vertices = np.array([v.co for v in ob.data.vertices])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        points = np.concatenate([joints(rig)[bone] for bone in c.bone_names(rig)])
        size = np.linalg.norm(high - low)
        assert (points > low - 0.5 * size).all()
        assert (points < high + 0.5 * size).all()


def test_several_roots(body):
    bones = [*c.biped_bones(), ("hat", None, (0, 0, 1.85), (0, 0, 2.0)), ("tool", None, (1, 0, 0), (1, 0, 0.3))]
    rig = c.armature("Rig", bones)
    assert fit(rig, body) == {"FINISHED"}
    assert len(rig.data.bones) == len(bones)


@pytest.fixture
def gate(monkeypatch):
    """A fit that waits until it is let through or cancelled."""
    module = sys.modules[f"{MODULE}.core.fit"]
    original, opened = module.fit_skeleton, threading.Event()

    def waiting(*arguments, progress, **options):
        while not opened.wait(0.005):
            if progress.cancelled:
                raise module.Cancelled("cancelled")
        return original(*arguments, progress=progress, **options)

    monkeypatch.setattr(module, "fit_skeleton", waiting)
    modal = sys.modules[f"{MODULE}.ui.modal_job"]
    monkeypatch.setattr(modal, "PATIENCE_SECONDS", 0.0)
    monkeypatch.setattr(modal, "bpy", SimpleNamespace(app=SimpleNamespace(background=False)))
    yield opened
    opened.set()
    assert overlays() == []


def overlays():
    return sys.modules[f"{MODULE}.blender.bone_overlay"]._shown


@pytest.fixture
def started(body, gate):
    """The operator in a window, working; its context; the armature and how it was."""
    operator, context = stand_in_for("fit_skeleton"), Context()
    rig = template()
    c.activate(rig, body)
    bpy.context.view_layer.update()
    before = everything()
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    return operator, context, rig, before


def previewed(operator, context, gate):
    gate.set()
    operator._running.task.wait(60)
    assert operator.modal(context, event("TIMER")) == {"RUNNING_MODAL"}
    assert len(overlays()) == 1
    assert "Enter: apply, ESC: cancel" in context.status
    assert "score" in context.status
    assert context.window_manager.timers == []


def test_escape_while_it_works(started):
    operator, context, _, before = started
    assert operator.modal(context, event("TIMER")) == {"RUNNING_MODAL"}
    assert context.status.startswith("Fitting: ")
    assert operator.modal(context, event("ESC", "PRESS")) == {"RUNNING_MODAL"}
    assert until_ended(operator, context) == {"CANCELLED"}
    assert operator.reports == [("WARNING", "Cancelled. Nothing was changed.")]
    assert everything() == before
    assert context.status is None


@pytest.mark.parametrize("key", ["RET", "NUMPAD_ENTER"])
def test_enter_applies_the_preview(started, gate, key):
    operator, context, rig, before = started
    previewed(operator, context, gate)
    assert everything() == before
    assert operator.modal(context, event("MIDDLEMOUSE", "PRESS")) == {"PASS_THROUGH"}
    assert operator.modal(context, event("X", "PRESS")) == {"RUNNING_MODAL"}
    assert operator.modal(context, event(key, "RELEASE")) == {"RUNNING_MODAL"}
    wanted = operator._running.fitted().heads
    assert operator.modal(context, event(key, "PRESS")) == {"FINISHED"}
    assert overlays() == []
    assert context.status is None
    assert [kind for kind, _ in operator.reports] in (["INFO"], ["WARNING"])
    np.testing.assert_allclose([points[0] for points in joints(rig).values()], wanted, atol=1e-5)


@pytest.mark.parametrize("key", ["ESC", "RIGHTMOUSE"])
def test_the_preview_is_refused(started, gate, key):
    operator, context, _, before = started
    previewed(operator, context, gate)
    assert operator.modal(context, event(key, "PRESS")) == {"CANCELLED"}
    assert operator.reports == [("WARNING", "Cancelled. Nothing was changed.")]
    assert overlays() == []
    assert context.status is None
    assert everything() == before


def test_blender_ends_the_preview(started, gate):
    operator, context, _, before = started
    previewed(operator, context, gate)
    operator.cancel(context)
    assert overlays() == []
    assert everything() == before


def test_blender_ends_the_work(started):
    operator, context, _, _ = started
    operator.cancel(context)
    assert operator._running.task.wait(5)
    assert context.window_manager.timers == []


def test_a_short_job_shows_its_preview_too(body, gate, monkeypatch):
    monkeypatch.setattr(sys.modules[f"{MODULE}.ui.modal_job"], "PATIENCE_SECONDS", 60.0)
    gate.set()
    operator, context = stand_in_for("fit_skeleton"), Context()
    c.activate(template(), body)
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    assert context.window_manager.handlers == [operator]
    assert len(overlays()) == 1
    assert operator.modal(context, event("RET", "PRESS")) == {"FINISHED"}


def test_without_a_preview(started, gate):
    operator, context, rig, _ = started
    operator.preview = False
    before = rest(rig)
    gate.set()
    assert until_ended(operator, context) == {"FINISHED"}
    assert rest(rig) != before


def test_the_armature_changes_meanwhile(started, gate):
    operator, context, rig, _ = started
    previewed(operator, context, gate)
    with in_edit_mode(rig) as edit:
        edit["head"].tail.z += 0.1
    before = everything()
    assert operator.modal(context, event("RET", "PRESS")) == {"CANCELLED"}
    assert operator.reports == [("ERROR", "'Rig' was edited while it was being fitted. Nothing was changed.")]
    assert everything() == before
    assert overlays() == []


def test_the_armature_goes_meanwhile(started, gate):
    operator, context, rig, _ = started
    previewed(operator, context, gate)
    bpy.data.objects.remove(rig)
    assert operator.modal(context, event("RET", "PRESS")) == {"CANCELLED"}
    assert operator.reports == [("ERROR", "The armature was removed while it was being fitted. Nothing was changed.")]


def test_unregistering_ends_the_drawing(started, gate):
    operator, context, _, _ = started
    previewed(operator, context, gate)
    sys.modules[f"{MODULE}.blender.bone_overlay"].remove_overlays()
    assert overlays() == []
    assert operator.modal(context, event("ESC", "PRESS")) == {"CANCELLED"}


def test_progress_without_a_window(body, gate, monkeypatch, capsys):
    monkeypatch.setattr(sys.modules[f"{MODULE}.ui.modal_job"], "bpy", bpy)
    monkeypatch.setattr(sys.modules[f"{MODULE}.core.fit"].FitTask, "stage", "searching")
    threading.Timer(0.3, gate.set).start()
    fit(template(), body)
    assert "Fitting: searching (0%)" in capsys.readouterr().out


def test_menus():
    menus = sys.modules[f"{MODULE}.ui.menus"]
    for name in ("VIEW3D_MT_object_parent", "VIEW3D_MT_edit_armature", "VIEW3D_MT_pose"):
        assert menus.draw_fit in getattr(bpy.types, name)._dyn_ui_initialize()
