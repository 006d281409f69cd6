# SPDX-License-Identifier: GPL-3.0-or-later
"""Point caches: what they play is the live skin, and the way back leaves no trace."""

import os
import struct
import subprocess
import sys
from pathlib import Path

import bakes as b
import bpy
import characters as c
import numpy as np
import pytest
import skins as s
from mathutils import Matrix
from scratch_profile import MODULE
from test_skin_frames import pixels, render, studio

TOLERANCE = 1e-5 * s.HEIGHT
PLACES = [(frame, part) for frame in range(1, 13) for part in (0.0, 0.25, 0.5, 0.75)] + [(13, 0.0)]


@pytest.mark.parametrize("kind", ["PC2", "MDD"])
def test_cache_shows_the_live_skin(tmp_path, kind):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    live = {place: b.at(ob, *place) for place in PLACES}
    plain = {place: s.plain(ob) for place in PLACES[-1:]}
    assert np.abs(live[13, 0.0] - plain[13, 0.0]).max() > 0.005
    bpy.context.scene.frame_set(4)
    assert b.bake(rig, file_format=kind, samples_per_frame=4) == {"FINISHED"}
    assert bpy.context.scene.frame_current == 4
    assert [m.name for m in ob.modifiers] == ["Armature", "Dermis Cache"]
    assert ob.data.shape_keys.key_blocks["Dermis"].mute
    assert s.state(ob) is None
    for place in reversed(PLACES):
        np.testing.assert_allclose(b.at(ob, *place), live[place], atol=TOLERANCE, err_msg=str(place))
    path = tmp_path / f"shot_Limb.{kind.lower()}"
    assert [p for p in os.listdir(tmp_path) if not p.startswith("shot.blend")] == [path.name]
    assert ob.modifiers["Dermis Cache"].filepath == f"//{path.name}"
    head = 32 if kind == "PC2" else 8 + 4 * len(PLACES)
    assert path.stat().st_size == head + 12 * len(PLACES) * len(ob.data.vertices)


def test_pc2_head(tmp_path):
    ob, _ = b.animated_limb()
    b.saved(tmp_path)
    assert b.bake(ob, use_scene_range=False, frame_start=-2, frame_end=3, samples_per_frame=2) == {"FINISHED"}
    head = struct.unpack("<12siiffi", (tmp_path / "shot_Limb.pc2").read_bytes()[:32])
    assert head == (b"POINTCACHE2\0", 1, len(ob.data.vertices), -2.0, 0.5, 11)


def test_everything_that_a_live_skin_depends_on(tmp_path):
    """Other shape keys, influence and masks, places, stretched time, modifiers behind."""
    ob, rig = s.limb()
    s.animate(rig, b.FRAMES)
    ob.shape_key_add(name="Basis")
    flex = ob.shape_key_add(name="Flex")
    for point in flex.points:
        point.co.x *= 1.2
    for frame, value in ((1, 0.0), (13, 0.9)):
        flex.value = value
        flex.keyframe_insert("value", frame=frame)
    half = ob.vertex_groups.new(name="Half")
    half.add([v.index for v in ob.data.vertices if v.co.x > 0], 0.6, "REPLACE")
    ob.modifiers["Armature"].vertex_group = "Half"
    ob.dermis_skin.mask_group = "Half"
    rig.matrix_world = Matrix.Rotation(0.5, 4, (1, 2, 3)) @ Matrix.Diagonal((0.5, 0.5, 0.5, 1))
    smooth = ob.modifiers.new("Smooth", "SMOOTH")
    smooth.factor = 0.3
    ob.modifiers.new("Subdivision", "SUBSURF").levels = 1
    s.enable(rig)
    ob.data.shape_keys.key_blocks["Dermis"].value = 0.8
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 13
    scene.render.frame_map_old, scene.render.frame_map_new = 100, 80
    b.saved(tmp_path)
    live = {frame: b.at(ob, frame) for frame in range(1, 14)}
    assert b.bake(ob) == {"FINISHED"}
    assert [m.name for m in ob.modifiers] == ["Armature", "Dermis Cache", "Smooth", "Subdivision"]
    for frame, wanted in live.items():
        np.testing.assert_allclose(b.at(ob, frame), wanted, atol=TOLERANCE, err_msg=str(frame))


def test_back_to_live_restores_everything(tmp_path):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    live = b.at(ob, 7, 0.5).tobytes()
    before = b.everything(ob)
    assert b.bake(rig) == {"FINISHED"}
    assert b.everything(ob) != before
    with pytest.raises(RuntimeError, match="baked already"):
        b.bake(rig)
    for operator in ("skin_enable", "skin_disable"):
        with pytest.raises(RuntimeError, match="Back to Live"):
            b.bake(rig, operator=operator)
    assert b.bake(rig, operator="bake_remove") == {"FINISHED"}
    assert b.everything(ob) == before
    assert s.shown(ob).tobytes() == live
    assert (tmp_path / "shot_Limb.pc2").exists()
    assert b.bake(rig) == {"FINISHED"}
    assert b.bake(rig, operator="bake_remove", delete_files=True) == {"FINISHED"}
    assert not (tmp_path / "shot_Limb.pc2").exists()
    assert b.at(ob, 7, 0.5).tobytes() == live
    with pytest.raises(RuntimeError, match="No mesh here is baked"):
        b.bake(rig, operator="bake_remove")


def test_a_cache_that_another_object_plays_is_kept(tmp_path):
    ob, _ = b.animated_limb()
    b.saved(tmp_path)
    b.bake(ob)
    other = c.mesh_object("Other", *c.tube(16, 25))
    other.modifiers.new("Mine", "MESH_CACHE").filepath = str(tmp_path / "shot_Limb.pc2")
    assert b.bake(ob, operator="bake_remove", delete_files=True) == {"FINISHED"}
    assert (tmp_path / "shot_Limb.pc2").exists()


def test_blender_without_dermis_shows_it(tmp_path):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    b.bake(rig, samples_per_frame=2)
    frames = [1.0, 4.5, 7.0, 12.5]
    expected = [b.at(ob, int(frame), frame % 1) for frame in frames]
    bpy.ops.wm.save_mainfile()
    profile = tmp_path / "profile"
    profile.mkdir()
    script = Path(__file__).with_name("plain_process.py")
    result = tmp_path / "frames.npy"
    command = [sys.executable, script, profile, tmp_path / "shot.blend", ob.name, result, *frames]
    subprocess.run([str(word) for word in command], check=True, timeout=60, capture_output=True)
    np.testing.assert_array_equal(np.load(result), expected)


def test_renders_the_same_without_dermis(tmp_path):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    studio("CYCLES")
    live = render(tmp_path, "live", 9)
    b.bake(rig)
    baked = render(tmp_path, "baked", 9)
    bpy.ops.wm.save_mainfile()
    (tmp_path / "profile").mkdir()
    script, picture = Path(__file__).with_name("plain_process.py"), tmp_path / "alone.png"
    command = [sys.executable, script, tmp_path / "profile", tmp_path / "shot.blend", ob.name, picture, "render", 9]
    subprocess.run([str(word) for word in command], check=True, timeout=120, capture_output=True)
    np.testing.assert_array_equal(pixels(picture), baked)
    # The last bits of the vertices may differ from the live skin's, and turn a sample here and there.
    assert np.abs(baked - live).mean() < 1e-3
    ob.modifiers["Dermis Cache"].show_render = False
    assert np.abs(render(tmp_path, "plain", 9) - live).mean() > 5e-3


def test_back_after_the_file_was_opened_again(tmp_path):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    live = b.at(ob, 7).tobytes()
    b.bake(rig)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    ob = bpy.data.objects["Limb"]
    assert s.state(ob) is None
    assert b.bake(ob, operator="bake_remove") == {"FINISHED"}
    assert b.at(ob, 7).tobytes() == live


def test_the_cache_goes_right_behind_the_armature(tmp_path):
    """Modifiers may be pinned to the end, and another may have the name."""
    ob, _ = b.animated_limb()
    ob.modifiers.new("Dermis Cache", "SMOOTH")
    ob.modifiers.new("Last", "SUBSURF").use_pin_to_last = True
    b.saved(tmp_path)
    with pytest.raises(RuntimeError, match="rename"):
        b.bake(ob)
    ob.modifiers["Dermis Cache"].name = "Mine"
    b.bake(ob)
    assert [m.name for m in ob.modifiers] == ["Armature", "Dermis Cache", "Mine", "Last"]


def test_parts_out_of_order_give_the_same_bytes(tmp_path):
    ob, _ = b.animated_limb()
    b.saved(tmp_path)
    b.bake(ob, directory=str(tmp_path / "whole"))
    b.bake(ob, operator="bake_remove")
    before = b.everything(ob)
    parts = []
    for start, end in ((9, 13), (1, 4), (5, 8)):
        folder = tmp_path / f"part{start}"
        options = {"use_scene_range": False, "frame_start": start, "frame_end": end, "play": False}
        assert b.bake(ob, directory=str(folder), **options) == {"FINISHED"}
        parts.append(folder / "shot_Limb.pc2")
    assert b.everything(ob) == before
    join = sys.modules[f"{MODULE}.core.point_cache"].join_caches
    join(parts, tmp_path / "joined.pc2")
    whole = (tmp_path / "whole" / "shot_Limb.pc2").read_bytes()
    assert (tmp_path / "joined.pc2").read_bytes() == whole
    b.bake(ob, directory=str(tmp_path / "again"))
    assert (tmp_path / "again" / "shot_Limb.pc2").read_bytes() == whole


@pytest.mark.parametrize("kind", ["PC2", "MDD"])
def test_playing_parts(tmp_path, kind):
    ob, _ = b.animated_limb()
    b.saved(tmp_path)
    live = {place: b.at(ob, *place) for place in ((3, 0.5), (6, 0.0), (11, 0.5))}
    before = b.everything(ob)
    parts = tmp_path / "parts"
    for start, end in ((6, 13), (1, 6)):
        b.bake(
            ob, directory=str(parts / str(start)), file_format=kind, samples_per_frame=2,
            use_scene_range=False, frame_start=start, frame_end=end, play=False,
        )  # fmt: skip
        (parts / str(start) / f"shot_Limb.{kind.lower()}").rename(parts / f"{start}.cache")
    c.activate(ob)
    with pytest.raises(RuntimeError, match="Select the files"):
        bpy.ops.dermis.bake_join(directory=str(parts))
    with pytest.raises(RuntimeError, match="No such file"):
        bpy.ops.dermis.bake_join(directory=str(parts), files=[{"name": "none"}])
    (parts / "bad").write_text("no cache at all")
    with pytest.raises(RuntimeError, match="'bad' is neither"):
        bpy.ops.dermis.bake_join(directory=str(parts), files=[{"name": "1.cache"}, {"name": "bad"}])
    assert not [path for path in tmp_path.iterdir() if "Limb" in path.name]
    bpy.context.scene.frame_set(1)
    files = [{"name": "6.cache"}, {"name": "1.cache"}]
    assert bpy.ops.dermis.bake_join(directory=str(parts), files=files) == {"FINISHED"}
    for place, wanted in live.items():
        np.testing.assert_allclose(b.at(ob, *place), wanted, atol=TOLERANCE)
    assert b.bake(ob, operator="bake_remove") == {"FINISHED"}
    bpy.context.scene.frame_set(int(before[-1][0]))
    assert b.everything(ob)[:-1] == before[:-1]


def test_several_objects_at_once(tmp_path):
    ob, rig = b.animated_limb()
    other = c.mesh_object("Lim:b", *c.tube(12, 19))
    c.paint(other, rig)
    c.deform(other, rig)
    third = c.mesh_object("lim?b", *c.tube(12, 19))
    c.paint(third, rig)
    c.deform(third, rig)
    s.enable(rig)
    b.saved(tmp_path)
    live = {mesh.name: b.at(mesh, 7) for mesh in (ob, other, third)}
    assert b.bake(rig, directory="//caches") == {"FINISHED"}
    assert sorted(os.listdir(tmp_path / "caches")) == ["shot_Lim_b.pc2", "shot_Limb.pc2", "shot_lim_b_2.pc2"]
    for mesh in (ob, other, third):
        np.testing.assert_allclose(b.at(mesh, 7), live[mesh.name], atol=TOLERANCE)


def test_unkeyed_pose_survives(tmp_path):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    bpy.context.scene.frame_set(3)
    s.bend(rig, 33)
    live = s.shown(ob).tobytes()
    b.bake(rig, play=False)
    assert np.degrees(rig.pose.bones["middle"].rotation_euler.x) == pytest.approx(33)
    assert s.shown(ob).tobytes() == live


@pytest.mark.parametrize("operator", ["bake", "bake_driven_keys", "bake_weights", "bake_shape_key"])
def test_undo_of_a_bake_and_of_the_way_back(tmp_path, operator):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    live = b.at(ob, 7).tobytes()
    options = {"bake_weights": {"least": 0.0}, "bake_shape_key": {"switch_off": True}}.get(operator, {})
    bpy.ops.ed.undo_push(message="before")
    c.activate(rig)
    assert getattr(bpy.ops.dermis, operator)("EXEC_DEFAULT", True, **options) == {"FINISHED"}
    ob = bpy.data.objects["Limb"]
    assert ob.dermis_skin.baked
    baked = b.at(ob, 7).tobytes()
    assert bpy.ops.dermis.bake_remove("EXEC_DEFAULT", True) == {"FINISHED"}
    assert b.at(bpy.data.objects["Limb"], 7).tobytes() == live
    bpy.ops.ed.undo()
    assert b.at(bpy.data.objects["Limb"], 7).tobytes() == baked
    bpy.ops.ed.undo()
    ob = bpy.data.objects["Limb"]
    assert [m.name for m in ob.modifiers] == ["Armature"]
    assert [key.name for key in ob.data.shape_keys.key_blocks] == ["Basis", "Dermis"]
    assert ob.dermis_skin.baked == ""
    assert b.at(ob, 7).tobytes() == live
