# SPDX-License-Identifier: GPL-3.0-or-later
"""Pose-driven shape keys in the place of the live skin."""

import re
import subprocess
import sys
from pathlib import Path

import bakes as b
import bpy
import numpy as np
import pytest
import skins as s
from mathutils import Matrix


def motion(ob, rig=None):
    shown, plain = [], []
    for frame in range(1, 14):
        shown.append(b.at(ob, frame))
        if rig is not None:
            plain.append(s.plain(ob))
    return (shown, plain) if rig is not None else shown


def driven(ob):
    return [key for key in ob.data.shape_keys.key_blocks if key.name in ob.dermis_skin.baked_keys.split("\n")]


@pytest.mark.parametrize("output", ["DRIVERS", "KEYFRAMES"])
def test_keys_keep_the_wanted_share(output):
    ob, rig = b.animated_limb()
    live, plain = motion(ob, rig)
    bpy.context.scene.frame_set(4)
    before = b.everything(ob)
    assert b.bake(rig, operator="bake_driven_keys", kept=0.9, output=output) == {"FINISHED"}
    assert bpy.context.scene.frame_current == 4
    keys = driven(ob)
    assert 1 < len(keys) < 20
    baked = motion(ob)
    assert b.kept_share(live, plain, baked) > 0.88
    bpy.context.scene.frame_set(1)
    assert {round(key.value, 6) for key in keys} == {0.0}, "no key acts at rest"
    bpy.context.scene.frame_set(4)
    assert b.bake(rig, operator="bake_remove") == {"FINISHED"}
    assert b.everything(ob) == before
    assert ob.data.shape_keys.animation_data is None
    np.testing.assert_array_equal(motion(ob), live)


@pytest.mark.parametrize("preserve", [False, True])
@pytest.mark.parametrize("segments", [1, 3])
def test_places_modifiers_and_segments(preserve, segments):
    ob, rig = s.limb()
    rig.data.bones["middle"].bbone_segments = segments
    rig.matrix_world = Matrix.Rotation(0.7, 4, (1, 2, 3)) @ Matrix.Diagonal((0.1, 0.1, 0.1, 1))
    ob.modifiers["Armature"].use_deform_preserve_volume = preserve
    flex = [ob.shape_key_add(name=name) for name in ("Basis", "Flex")][1]
    for point in flex.points:
        point.co.x *= 1.1
    flex.value = 0.5
    s.animate(rig, b.FRAMES)
    s.animate(rig, ((1, 0.0), (13, -50.0)), "upper", 2)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 13
    s.enable(rig)
    live, plain = motion(ob, rig)
    assert b.bake(rig, operator="bake_driven_keys", kept=0.9) == {"FINISHED"}
    assert b.kept_share(live, plain, motion(ob)) > 0.88


def test_keyframes_in_a_stretched_scene():
    ob, rig = b.animated_limb()
    render = bpy.context.scene.render
    render.frame_map_old, render.frame_map_new = 100, 150
    live, plain = motion(ob, rig)
    assert b.bake(rig, operator="bake_driven_keys", kept=0.9, output="KEYFRAMES") == {"FINISHED"}
    assert b.kept_share(live, plain, motion(ob)) > 0.88


def test_drivers_are_plain_ones():
    ob, rig = b.animated_limb()
    b.bake(rig, operator="bake_driven_keys")
    drivers = [curve.driver for curve in ob.data.shape_keys.animation_data.drivers]
    assert len(drivers) == len(driven(ob))
    for driver in drivers:
        assert driver.is_simple_expression
        assert driver.is_valid
        assert len(driver.expression) < 256
        for variable in driver.variables:
            assert variable.type == "TRANSFORMS"
            assert variable.targets[0].transform_space == "LOCAL_SPACE"
            assert variable.targets[0].id == rig


def test_bend_and_twist_have_keys_of_their_own_and_a_new_pose_adds_them_up():
    ob, rig = b.animated_limb()
    b.bake(rig, operator="bake_driven_keys", kept=0.95)
    names = " ".join(key.name for key in driven(ob))
    assert re.search("middle bend X", names)
    assert re.search("upper twist", names)
    for frame in range(1, 14):
        bpy.context.scene.frame_set(frame)
        assert all(0.0 <= key.value <= 1.0 for key in driven(ob))


def test_more_keys_keep_more():
    ob, rig = b.animated_limb()
    live, plain = motion(ob, rig)
    shares = []
    for kept in (0.6, 0.97):
        b.bake(rig, operator="bake_driven_keys", kept=kept)
        shares.append((len(driven(ob)), b.kept_share(live, plain, motion(ob))))
        b.bake(rig, operator="bake_remove")
    assert shares[0][0] < shares[1][0]
    assert 0.58 < shares[0][1] < shares[1][1]
    assert shares[1][1] > 0.94


def test_range_of_motion_serves_poses_that_no_frame_has():
    ob, rig = s.limb()
    s.enable(rig)
    poses = [("middle", 0, 75.0), ("upper", 2, -60.0), ("middle", 1, 35.0)]
    live, plain = [], []
    for bone, axis, degrees in poses:
        s.bend(rig, degrees, bone, axis)
        live.append(s.shown(ob))
        plain.append(s.plain(ob))
        s.bend(rig, 0.0, bone, axis)
    assert b.bake(rig, operator="bake_driven_keys", poses="MOTION", kept=0.93, angle=np.radians(80)) == {"FINISHED"}
    baked = []
    for bone, axis, degrees in poses:
        s.bend(rig, degrees, bone, axis)
        baked.append(s.shown(ob))
        s.bend(rig, 0.0, bone, axis)
    assert b.kept_share(live, plain, baked) > 0.8
    with pytest.raises(RuntimeError, match="Back to Live"):
        b.bake(rig, operator="bake_driven_keys")


def test_nothing_that_turns():
    ob, rig = s.limb()
    s.enable(rig)
    before = b.everything(ob)
    with pytest.raises(RuntimeError, match="No joint of 'Limb' turns"):
        b.bake(rig, operator="bake_driven_keys", use_scene_range=False, frame_start=1, frame_end=4)
    with pytest.raises(RuntimeError, match="choose Drivers"):
        b.bake(rig, operator="bake_driven_keys", poses="MOTION", output="KEYFRAMES")
    assert b.everything(ob) == before


def test_other_animation_of_shape_keys_survives():
    ob, rig = b.animated_limb()
    flex = ob.shape_key_add(name="Flex")
    for frame, value in ((1, 0.0), (13, 0.5)):
        flex.value = value
        flex.keyframe_insert("value", frame=frame)
    b.bake(rig, operator="bake_driven_keys", output="KEYFRAMES")
    b.bake(rig, operator="bake_remove")
    bpy.context.scene.frame_set(13)
    assert ob.data.shape_keys.key_blocks["Flex"].value == pytest.approx(0.5)
    assert [key.name for key in ob.data.shape_keys.key_blocks] == ["Basis", "Dermis", "Flex"]


def test_blender_without_dermis_shows_it(tmp_path):
    """With scripts of the file forbidden too."""
    ob, rig = b.animated_limb()
    b.bake(rig, operator="bake_driven_keys")
    frames = [1.0, 4.5, 7.0, 13.0]
    expected = [b.at(ob, int(frame), frame % 1) for frame in frames]
    b.saved(tmp_path)
    (tmp_path / "profile").mkdir()
    script, result = Path(__file__).with_name("plain_process.py"), tmp_path / "frames.npy"
    command = [sys.executable, script, tmp_path / "profile", tmp_path / "shot.blend", ob.name, result, *frames]
    subprocess.run([str(word) for word in command], check=True, timeout=60, capture_output=True)
    np.testing.assert_array_equal(np.load(result), expected)
