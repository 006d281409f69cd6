# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrections of chosen poses as shape keys under the live Armature modifier."""

import bakes as b
import bpy
import numpy as np
import pytest
import skins as s

TOLERANCE = 1e-5 * s.HEIGHT


def test_key_of_the_current_pose():
    ob, rig = b.animated_limb()
    live = b.at(ob, 7)
    before = b.everything(ob)
    assert b.bake(rig, operator="bake_shape_key", key_name="Elbow") == {"FINISHED"}
    key = ob.data.shape_keys.key_blocks["Elbow"]
    assert (key.value, key.relative_key.name) == (0.0, "Basis")
    np.testing.assert_array_equal(s.shown(ob), live)
    assert ob.active_shape_key_index == before[4]
    ob.data.shape_keys.key_blocks["Dermis"].mute = True
    key.value = 1.0
    bpy.context.view_layer.update()
    np.testing.assert_allclose(s.shown(ob), live, atol=TOLERANCE)
    ob.shape_key_remove(key)
    ob.data.shape_keys.key_blocks["Dermis"].mute = False
    assert b.everything(ob) == before


def test_an_unkeyed_pose_is_what_is_saved():
    ob, rig = b.animated_limb()
    bpy.context.scene.frame_set(2)
    s.bend(rig, 95)
    live = s.shown(ob)
    assert b.bake(ob, operator="bake_shape_key", switch_off=True, value=1.0) == {"FINISHED"}
    bpy.context.view_layer.update()
    assert ob.dermis_skin.baked == "KEYS"
    np.testing.assert_allclose(s.shown(ob), live, atol=TOLERANCE)
    assert b.bake(ob, operator="bake_remove") == {"FINISHED"}
    assert "Correction 2" in ob.data.shape_keys.key_blocks, "a key that was saved is the user's"


def test_keys_at_markers():
    ob, rig = b.animated_limb()
    scene = bpy.context.scene
    with pytest.raises(RuntimeError, match="no marker"):
        b.bake(rig, operator="bake_shape_key", poses="MARKERS")
    for name, frame in (("Twist", 13), ("Bend", 7)):
        scene.timeline_markers.new(name, frame=frame)
    live = {frame: b.at(ob, frame) for frame in (7, 13)}
    scene.frame_set(3)
    assert b.bake(rig, operator="bake_shape_key", poses="MARKERS", switch_off=True) == {"FINISHED"}
    assert scene.frame_current == 3
    keys = ob.data.shape_keys.key_blocks
    assert [key.name for key in keys] == ["Basis", "Dermis", "Bend", "Twist"]
    for frame, name in ((7, "Bend"), (13, "Twist")):
        keys[name].value = 1.0
        np.testing.assert_allclose(b.at(ob, frame), live[frame], atol=TOLERANCE)
        keys[name].value = 0.0
