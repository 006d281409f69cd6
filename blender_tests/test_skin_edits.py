# SPDX-License-Identifier: GPL-3.0-or-later
"""A skin survives what happens to a file: undo, duplicates, renaming, edits, loading, appending."""

import bpy
import characters as c
import numpy as np
import pytest
import skins as s
from scratch_profile import MODULE

TOLERANCE = 1e-5 * s.HEIGHT


@pytest.fixture
def bent():
    ob, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 90)
    return ob, rig


def objects():
    return bpy.data.objects["Limb"], bpy.data.objects["LimbRig"]


def is_right(ob, rig):
    assert s.state(ob).error == ""
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig), atol=TOLERANCE)
    assert s.correction(ob).any()


def test_undo_and_redo_of_a_pose(bent):
    ob, rig = bent
    bpy.ops.ed.undo_push(message="first")
    first = s.shown(ob).tobytes()
    s.bend(rig, 40)
    bpy.ops.ed.undo_push(message="second")
    second = s.shown(ob).tobytes()
    bpy.ops.ed.undo()
    bpy.context.view_layer.update()
    ob, rig = objects()
    assert s.shown(ob).tobytes() == first
    is_right(ob, rig)
    bpy.ops.ed.redo()
    bpy.context.view_layer.update()
    ob, rig = objects()
    assert s.shown(ob).tobytes() == second
    s.bend(rig, 70)
    is_right(ob, rig)


def test_undo_and_redo_of_the_switch():
    ob, rig = s.limb()
    s.bend(rig, 90)
    bpy.ops.ed.undo_push(message="before")
    s.enable(rig)
    bpy.ops.ed.undo_push(message="enabled")
    shown = s.shown(ob).tobytes()
    bpy.ops.ed.undo()
    bpy.context.view_layer.update()
    ob, rig = objects()
    assert ob.data.shape_keys is None
    assert not ob.dermis_skin.enabled
    s.bend(rig, 80)
    bpy.ops.ed.redo()
    bpy.context.view_layer.update()
    ob, rig = objects()
    s.bend(rig, 90)
    assert s.shown(ob).tobytes() == shown
    s.disable(rig)
    bpy.ops.ed.undo_push(message="disabled")
    bpy.ops.ed.undo()
    bpy.context.view_layer.update()
    ob, rig = objects()
    s.bend(rig, 50)
    is_right(ob, rig)


def test_duplicate(bent):
    ob, rig = bent
    c.activate(rig, ob)
    bpy.ops.object.duplicate()
    twin, twin_rig = bpy.data.objects["Limb.001"], bpy.data.objects["LimbRig.001"]
    assert twin.modifiers["Armature"].object == twin_rig
    s.bend(twin_rig, 30)
    is_right(ob, rig)
    is_right(twin, twin_rig)
    assert s.state(twin).skin is s.state(ob).skin, "equal input, one skin"
    bpy.data.objects.remove(ob)
    s.bend(twin_rig, 60)
    is_right(twin, twin_rig)


def test_rename_everything(bent):
    ob, rig = bent
    ob.name, rig.name, ob.data.name = "Leg", "LegRig", "LegMesh"
    s.bend(rig, 60)
    is_right(ob, rig)
    rig.data.bones["middle"].name = "knee"
    bpy.context.view_layer.update()
    assert "knee" in ob.vertex_groups
    s.bend(rig, 75, "knee")
    is_right(ob, rig)


def test_edited_mesh_is_bound_again_with_a_notice(bent):
    ob, rig = bent
    assert s.state(ob).notice == ""
    c.activate(ob)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide(number_cuts=1)
    s.bend(rig, 70)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    assert "rebuilt" in s.state(ob).notice
    assert len(ob.data.vertices) > 1000
    is_right(ob, rig)


def test_edited_basis_weights_and_bones(bent):
    ob, rig = bent
    for point in ob.data.shape_keys.reference_key.data:
        point.co.x *= 1.2
    for vertex in ob.data.vertices:
        vertex.co.x *= 1.2
    bpy.context.view_layer.update()
    assert "rebuilt" in s.state(ob).notice
    is_right(ob, rig)
    skin = s.state(ob).skin
    ob.vertex_groups["middle"].add(range(100, 180), 0.3, "ADD")
    bpy.context.view_layer.update()
    assert s.state(ob).skin is not skin
    is_right(ob, rig)
    c.activate(rig)
    bpy.ops.object.mode_set(mode="EDIT")
    rig.data.edit_bones["middle"].head.z += 0.1
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    is_right(ob, rig)
    rig.data.bones["upper"].use_deform = False
    bpy.context.view_layer.update()
    is_right(ob, rig)


def test_painting_weights_shows_the_plain_skin_until_it_ends(bent):
    ob, rig = bent
    c.activate(ob)
    bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    bpy.context.view_layer.update()
    s.bend(rig, 80)
    assert "plain skin" in s.state(ob).notice
    assert not s.correction(ob).any()
    ob.vertex_groups["middle"].add(range(100, 180), 0.3, "ADD")
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    is_right(ob, rig)


def test_sculpting_is_left_alone(bent):
    ob, rig = bent
    before = s.correction(ob).tobytes()
    c.activate(ob)
    bpy.ops.object.mode_set(mode="SCULPT")
    s.bend(rig, 20)
    assert s.correction(ob).tobytes() == before
    bpy.ops.object.mode_set(mode="OBJECT")
    s.bend(rig, 30)
    is_right(ob, rig)


def test_save_and_load(bent, tmp_path):
    ob, rig = bent
    shown = s.shown(ob).tobytes()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert not bpy.data.objects
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    ob, rig = objects()
    assert s.shown(ob).tobytes() == shown
    s.bend(rig, 45)
    is_right(ob, rig)
    assert s.state(ob).notice == ""


@pytest.mark.usefixtures("bent")
def test_append(tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "a.blend")) as (_, wanted):
        wanted.objects = ["Limb", "LimbRig"]
    for ob in wanted.objects:
        bpy.context.collection.objects.link(ob)
    ob, rig = objects()
    bpy.context.view_layer.update()
    s.bend(rig, 45)
    is_right(ob, rig)


def test_switching_the_extension_off_and_on(bent):
    ob, rig = bent
    bpy.ops.preferences.addon_disable(module=MODULE)
    s.bend(rig, 40)
    stale = s.correction(ob).tobytes()
    bpy.ops.preferences.addon_enable(module=MODULE)
    s.bend(rig, 41)
    assert s.correction(ob).tobytes() != stale
    is_right(ob, rig)


def test_a_driver_on_the_influence(bent):
    ob, rig = bent
    full, none = s.shown(ob), s.plain(ob)
    key = ob.data.shape_keys.key_blocks["Dermis"]
    driver = key.driver_add("value").driver
    variable = driver.variables.new()
    variable.type = "SINGLE_PROP"
    variable.targets[0].id = rig
    variable.targets[0].data_path = "location.x"
    driver.expression = variable.name
    for value in (0.0, 0.5, 1.0):
        rig.location.x = value
        bpy.context.view_layer.update()
        np.testing.assert_allclose(s.shown(ob), none + value * (full - none), atol=TOLERANCE)
