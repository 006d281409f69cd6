# SPDX-License-Identifier: GPL-3.0-or-later
"""The same frame shows the same bits: in any order, in any process, in every render."""

import subprocess
import sys
from pathlib import Path

import bpy
import characters as c
import numpy as np
import pytest
import skins as s
from scratch_profile import MODULE, PROFILE


@pytest.fixture
def animated():
    ob, rig = s.limb()
    s.animate(rig)
    s.enable(rig)
    return ob, rig


def at(ob, frame, subframe=0.0):
    bpy.context.scene.frame_set(frame, subframe=subframe)
    return s.shown(ob).tobytes()


def test_order_of_frames_does_not_matter(animated):
    ob, _ = animated
    forwards = {frame: at(ob, frame) for frame in range(1, 26)}
    assert len(set(forwards.values())) > 20
    backwards = {frame: at(ob, frame) for frame in range(25, 0, -1)}
    assert backwards == forwards
    for frame in np.random.default_rng(0).integers(1, 26, 20).tolist():
        assert at(ob, frame) == forwards[frame]
    between = at(ob, 7, 0.25)
    at(ob, 20)
    assert at(ob, 7, 0.25) == between != forwards[7]


def test_playing_250_frames_twice(animated):
    ob, rig = animated
    s.animate(rig, tuple((frame, 90.0 * ((frame // 10) % 2)) for frame in range(1, 252, 10)))
    first = [at(ob, frame) for frame in range(1, 251)]
    assert [at(ob, frame) for frame in range(1, 251)] == first
    assert s.state(ob).error == ""


def test_every_frame_is_the_solvers(animated):
    ob, rig = animated
    for frame in (5, 13, 21):
        at(ob, frame)
        np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig), atol=1e-5 * s.HEIGHT)


def test_a_new_process_shows_the_same_bits(animated, tmp_path):
    ob, _ = animated
    expected = at(ob, 13)
    at(ob, 4)
    path, result = tmp_path / "walk.blend", tmp_path / "frame.npy"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    script = Path(__file__).with_name("skin_process.py")
    command = [sys.executable, str(script), PROFILE, str(path), ob.name, "13", str(result)]
    subprocess.run(command, check=True, timeout=60, capture_output=True)
    assert np.load(result).tobytes() == expected


def test_nothing_is_written_while_nothing_moves(animated, monkeypatch):
    ob, rig = animated
    at(ob, 13)
    writes = []
    module = sys.modules[f"{MODULE}.blender.skin_update"]
    original = module.write_offsets
    monkeypatch.setattr(module, "write_offsets", lambda *args: (writes.append(args), original(*args)))
    for _ in range(3):
        at(ob, 13)
    rig.location.x = 2.0
    bpy.context.view_layer.update()
    assert writes == []
    at(ob, 14)
    assert len(writes) == 1


def studio(engine):
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    for item in (camera, light):
        scene.collection.objects.link(item)
    camera.location, camera.rotation_euler = (7, 0, 1.5), (np.pi / 2, 0, np.pi / 2)
    light.rotation_euler = (0.9, 0.4, 0.0)
    scene.camera = camera
    scene.render.engine = engine
    scene.render.resolution_x, scene.render.resolution_y = 96, 72
    scene.cycles.samples = 4
    scene.cycles.use_denoising = False
    scene.cycles.seed = 1


def pixels(path):
    image = bpy.data.images.load(str(path), check_existing=False)
    values = np.array(image.pixels[:], np.float32)
    bpy.data.images.remove(image)
    return values


def render(tmp_path, name, frame):
    bpy.context.scene.frame_set(frame)
    bpy.context.scene.render.filepath = str(tmp_path / f"{name}{frame}.png")
    bpy.ops.render.render(write_still=True)
    return pixels(bpy.context.scene.render.filepath)


def software_gl():
    """Why Workbench cannot render here, empty when it can: a test picture in a process of its own.

    Where there is no GL, Blender may end the process.
    """
    script = Path(__file__).with_name("workbench_process.py")
    try:
        run = subprocess.run([sys.executable, str(script)], timeout=120, capture_output=True, text=True, check=False)
    except subprocess.TimeoutExpired:
        return "Workbench does not finish a picture"
    return "" if run.returncode == 0 else f"Workbench cannot render without GL: {run.stderr.strip()[-200:]}"


def test_workbench_shows_the_skin(animated, tmp_path):
    """Three frames as the viewport draws them, with and without the skin."""
    problem = software_gl()
    if problem:
        pytest.skip(problem)
    ob, _ = animated
    studio("BLENDER_WORKBENCH")
    stills = {frame: render(tmp_path, "still", frame) for frame in (13, 4, 9)}
    key = ob.data.shape_keys.key_blocks["Dermis"]
    key.mute = True
    for frame, picture in stills.items():
        assert np.abs(picture - render(tmp_path, "plain", frame)).max() > 0.05, "the skin shows in the picture"
    key.mute = False
    for frame, picture in reversed(stills.items()):
        np.testing.assert_array_equal(render(tmp_path, "again", frame), picture)


@pytest.mark.parametrize("persistent", [False, True])
def test_renders_show_the_skin(animated, tmp_path, persistent):
    """Three frames, rendered one by one, as an animation, and without the skin."""
    bpy.context.scene.render.use_persistent_data = persistent
    ob, _ = animated
    studio("CYCLES")
    bpy.context.scene.frame_set(25)
    stills = {frame: render(tmp_path, "still", frame) for frame in (13, 4, 9)}
    key = ob.data.shape_keys.key_blocks["Dermis"]
    key.mute = True
    without = {frame: render(tmp_path, "plain", frame) for frame in stills}
    key.mute = False
    for frame, picture in stills.items():
        assert np.abs(picture - without[frame]).max() > 0.05, "the skin shows in the picture"
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 4, 13
    scene.frame_step = 9
    scene.render.filepath = str(tmp_path / "anim")
    scene.frame_set(2)
    before = s.shown(ob).tobytes()
    bpy.ops.render.render(animation=True)
    for frame in (4, 13):
        np.testing.assert_array_equal(pixels(tmp_path / f"anim{frame:04d}.png"), stills[frame])
    scene.frame_set(2)
    assert s.shown(ob).tobytes() == before


def test_a_render_of_a_modifier_that_only_renders_show(animated, tmp_path):
    ob, _ = animated
    studio("CYCLES")
    expected = render(tmp_path, "shown", 13)
    ob.modifiers["Armature"].show_viewport = False
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(s.shown(ob), np.array([v.co for v in ob.data.vertices], np.float32))
    np.testing.assert_array_equal(render(tmp_path, "hidden", 13), expected)


def test_motion_blur(animated, tmp_path):
    """Subframes, which Blender visits backwards too, have their own correction."""
    ob, _ = animated
    studio("CYCLES")
    scene = bpy.context.scene
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = 1.0
    first = render(tmp_path, "blur", 7)
    seen = []

    def watch(scene, depsgraph):
        seen.append((depsgraph.mode, scene.frame_current_final, s.correction(ob).tobytes()))

    bpy.app.handlers.frame_change_post.append(watch)
    second = render(tmp_path, "again", 7)
    bpy.app.handlers.frame_change_post.remove(watch)
    np.testing.assert_array_equal(first, second)
    during = {(frame, bits) for mode, frame, bits in seen if mode == "RENDER"}
    frames = [frame for frame, _ in during]
    assert len(frames) == len(set(frames)) >= 3, "one correction for each subframe"
    for frame, bits in during:
        scene.frame_set(int(frame), subframe=frame % 1)
        assert s.correction(ob).tobytes() == bits


def test_two_scenes_and_hidden_objects(animated):
    """A skin outside of the scene that changes is left alone."""
    ob, _ = animated
    shown = at(ob, 13)
    kept = s.correction(ob).tobytes()
    other = bpy.data.scenes.new("Other")
    other.frame_set(20)
    assert s.correction(ob).tobytes() == kept
    ob.hide_viewport = True
    bpy.context.scene.frame_set(20)
    ob.hide_viewport = False
    bpy.context.scene.frame_set(13)
    assert s.shown(ob).tobytes() == shown
    assert c.bone_names(ob.parent) == ["lower", "middle", "upper"]
