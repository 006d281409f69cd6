# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights refitted to the live skin."""

import re

import bakes as b
import bpy
import characters as c
import numpy as np
import pytest
import skins as s
from mathutils import Matrix


def motion(ob, shared=range(1, 14)):
    return [b.at(ob, frame) for frame in shared]


def test_weights_come_nearer_and_the_way_back_is_exact():
    ob, rig = b.animated_limb()
    live = motion(ob)
    plain = []
    for frame in range(1, 14):
        bpy.context.scene.frame_set(frame)
        plain.append(s.plain(ob))
    bpy.context.scene.frame_set(4)
    before = b.everything(ob)
    assert b.bake(rig, operator="bake_weights", least=0.1) == {"FINISHED"}
    assert bpy.context.scene.frame_current == 4
    assert ob.dermis_skin.baked == "WEIGHTS"
    weights = c.dense(ob, c.bone_names(rig))
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-6)
    assert ((weights > 0).sum(axis=1) <= 4).all()
    assert b.kept_share(live, plain, motion(ob)) > 0.1
    bpy.context.scene.frame_set(4)
    assert b.bake(rig, operator="bake_remove") == {"FINISHED"}
    assert b.everything(ob) == before
    np.testing.assert_array_equal(motion(ob), live)
    assert s.state(ob).notice == ""


def test_the_report_is_what_blender_shows(capfd):
    """In an object with other axes than the world's, with another key acting and half of it masked."""
    ob, rig = s.limb()
    rig.matrix_world = Matrix.Rotation(0.7, 4, (1, 2, 3)) @ Matrix.Diagonal((0.2, 0.2, 0.2, 1))
    flex = [ob.shape_key_add(name=name) for name in ("Basis", "Flex")][1]
    for point in flex.points:
        point.co.x *= 1.1
    flex.value = 0.5
    half = ob.vertex_groups.new(name="Half")
    half.add([v.index for v in ob.data.vertices if v.co.x > 0], 0.6, "REPLACE")
    ob.modifiers["Armature"].vertex_group = "Half"
    s.animate(rig, b.FRAMES)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 13
    s.enable(rig)
    live, plain = motion(ob), []
    for frame in range(1, 14):
        bpy.context.scene.frame_set(frame)
        plain.append(s.plain(ob))
    capfd.readouterr()
    assert b.bake(rig, operator="bake_weights", least=0.0, influences="8") == {"FINISHED"}
    told = int(re.search(r"keep (\d+)% of the correction", capfd.readouterr().out)[1])
    assert told == pytest.approx(100 * b.kept_share(live, plain, motion(ob)), abs=0.6)


def test_weights_that_keep_too_little_are_not_written():
    ob, rig = b.animated_limb()
    before = b.everything(ob)
    with pytest.raises(RuntimeError, match=r"plain weights keep \d+% of the correction.*less than the 90% asked for"):
        b.bake(rig, operator="bake_weights", least=0.9)
    assert b.everything(ob) == before


def test_locked_groups_stay():
    ob, rig = b.animated_limb()
    ob.vertex_groups["upper"].lock_weight = True
    before = c.dense(ob, c.bone_names(rig))
    assert b.bake(rig, operator="bake_weights", least=0.0, influences="8") == {"FINISHED"}
    after = c.dense(ob, c.bone_names(rig))
    np.testing.assert_array_equal(after[:, 2], before[:, 2])
    assert np.abs(after - before).max() > 0.01
    np.testing.assert_allclose(after.sum(axis=1), 1.0, atol=1e-6)


def refuses(rig, ob, message):
    before = b.everything(ob)
    with pytest.raises(RuntimeError, match=message):
        b.bake(rig, operator="bake_weights", least=0.1)
    assert b.everything(ob) == before


def test_what_has_no_plain_weights():
    ob, rig = b.animated_limb()
    ob.modifiers["Armature"].use_deform_preserve_volume = True
    refuses(rig, ob, "Preserve Volume")
    ob.modifiers["Armature"].use_deform_preserve_volume = False
    rig.data.bones["middle"].bbone_segments = 3
    refuses(rig, ob, "B-Bones")


def test_a_mesh_that_was_edited_cannot_go_back():
    ob, rig = b.animated_limb()
    b.bake(rig, operator="bake_weights", least=0.1)
    ob.data.vertices.add(1)
    before = b.everything(ob)
    with pytest.raises(RuntimeError, match="had 402 vertices"):
        b.bake(rig, operator="bake_remove")
    assert b.everything(ob) == before


def test_file_keeps_the_old_weights(tmp_path):
    ob, rig = b.animated_limb()
    live = motion(ob)
    b.bake(rig, operator="bake_weights", least=0.1)
    b.saved(tmp_path)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    ob = bpy.data.objects["Limb"]
    b.bake(ob, operator="bake_remove")
    np.testing.assert_array_equal(motion(ob), live)
