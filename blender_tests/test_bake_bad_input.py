# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes that cannot be, that are cancelled or that fail: nothing is changed and nothing is left behind."""

import os
import sys

import bakes as b
import bpy
import characters as c
import pytest
import skins as s
from scratch_profile import MODULE
from windows import Context, event, in_window, stand_in_for, until_ended


def refuses(rig, ob, message, **options):
    before = b.everything(ob)
    with pytest.raises(RuntimeError, match=message):
        b.bake(rig, **options)
    assert b.everything(ob) == before


def test_unsaved_file():
    ob, rig = b.animated_limb()
    refuses(rig, ob, "Save the file first, or choose an absolute folder")


def test_unsaved_file_with_an_absolute_folder(tmp_path):
    _, rig = b.animated_limb()
    assert b.bake(rig, directory=str(tmp_path)) == {"FINISHED"}
    assert os.listdir(tmp_path) == ["Limb.pc2"]


def test_bad_options(tmp_path):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    refuses(rig, ob, "The last frame, 3, lies before", use_scene_range=False, frame_start=5, frame_end=3)
    refuses(rig, ob, "Choose a folder", directory=" ")
    (tmp_path / "taken").write_text("a file")
    refuses(rig, ob, "taken", directory=str(tmp_path / "taken"))
    (tmp_path / "folder" / "shot_Limb.pc2").mkdir(parents=True)
    refuses(rig, ob, "is a folder", directory="//folder")
    assert os.listdir(tmp_path / "folder") == ["shot_Limb.pc2"]


def test_objects_that_cannot_be_baked(tmp_path):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    bare, _ = s.limb("Bare")
    with pytest.raises(RuntimeError, match="No mesh here has a PBD skin: enable it first"):
        b.bake(bare)
    ob.hide_viewport = True
    bpy.context.view_layer.update()
    refuses(rig, ob, "not evaluated in this view layer: show it first")
    ob.hide_viewport = False
    ob.modifiers["Armature"].use_bone_envelopes = True
    refuses(rig, ob, "switch Bone Envelopes off")
    c.activate(rig)
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Leave Edit Mode first"):
        bpy.ops.dermis.bake()
    bpy.ops.object.mode_set(mode="OBJECT")
    c.activate(c.armature("Alone", c.tube_bones()))
    with pytest.raises(RuntimeError, match="No mesh here has a PBD skin"):
        bpy.ops.dermis.bake()


def test_a_failure_half_way_leaves_the_old_cache(tmp_path, monkeypatch):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    b.bake(rig)
    old = (tmp_path / "shot_Limb.pc2").read_bytes()
    b.bake(rig, operator="bake_remove")
    listing = sorted(os.listdir(tmp_path))
    frames = sys.modules[f"{MODULE}.core.skin_frames"].SkinFrames
    original, calls = frames.positions, []

    def failing(self, sample):
        calls.append(sample)
        if len(calls) == 5:
            raise OSError(28, "No space left on device")
        return original(self, sample)

    monkeypatch.setattr(frames, "positions", failing)
    refuses(rig, ob, "No space left on device")
    assert (tmp_path / "shot_Limb.pc2").read_bytes() == old
    refuses_folder = tmp_path / "new"
    calls.clear()
    refuses(rig, ob, "No space left", directory=str(refuses_folder / "deep"))
    assert sorted(os.listdir(tmp_path)) == listing


@pytest.fixture
def windowed(monkeypatch, tmp_path):
    in_window(monkeypatch)
    monkeypatch.setattr(sys.modules[f"{MODULE}.ui.bake_operator"], "fill_from_scene", lambda *_: None)
    monkeypatch.setattr(sys.modules[f"{MODULE}.blender.sampled_task"], "POLL_SECONDS", 0.0)
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    bpy.context.scene.frame_set(5)
    c.activate(rig)
    return ob, stand_in_for("bake")


def test_modal_bake(windowed, tmp_path):
    ob, operator = windowed
    context = Context()
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    assert context.status.startswith("Baking: reading poses")
    assert until_ended(operator, context) == {"FINISHED"}
    assert ob.dermis_skin.baked == "CACHE"
    assert bpy.context.scene.frame_current == 5
    assert (tmp_path / "shot_Limb.pc2").exists()
    assert context.window_manager.timers == []


@pytest.mark.parametrize("steps", [0, 3, 40])
def test_escape_leaves_nothing(windowed, tmp_path, steps):
    """While poses are read, and while frames are solved."""
    ob, operator = windowed
    context = Context()
    listing, before, live = sorted(os.listdir(tmp_path)), b.everything(ob), s.shown(ob).tobytes()
    if steps == 40:
        # The thread waits here until it is cancelled.
        task = sys.modules[f"{MODULE}.core.bake_task"].CacheTask
        original = task._write

        def held(self, *arguments):
            original(self, *arguments)
            while not self._cancelled:
                pass

        task._write = held
    try:
        assert operator.invoke(context, None) == {"RUNNING_MODAL"}
        for _ in range(steps):
            assert operator.modal(context, event("TIMER")) == {"RUNNING_MODAL"}
        assert (operator._running.task._task is not None) == (steps == 40)
        assert operator.modal(context, event("ESC", "PRESS")) == {"CANCELLED"}
    finally:
        sys.modules[f"{MODULE}.core.background"].end_all()
        if steps == 40:
            task._write = original
    assert operator.reports == [("WARNING", "Cancelled. Nothing was changed.")]
    assert b.everything(ob) == before
    assert sorted(os.listdir(tmp_path)) == listing
    assert s.shown(ob).tobytes() == live
    assert context.window_manager.timers == []


@pytest.mark.parametrize("name", ["bake_driven_keys", "bake_weights", "bake_shape_key"])
@pytest.mark.parametrize("steps", [2, 14])
def test_escape_of_the_other_bakes(windowed, name, steps):
    """While poses are read; and right after, while keys are chosen or weights are fitted."""
    ob, _ = windowed
    bpy.context.scene.timeline_markers.new("One", frame=2)
    bpy.context.scene.timeline_markers.new("Two", frame=9)
    bpy.context.scene.frame_set(5)
    operator, context = stand_in_for(name), Context()
    operator.poses = "MARKERS" if name == "bake_shape_key" else "BOTH"
    before, live = b.everything(ob), s.shown(ob).tobytes()
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    for _ in range(0 if name == "bake_shape_key" else steps):
        operator.modal(context, event("TIMER"))
    assert operator.modal(context, event("ESC", "PRESS")) == {"CANCELLED"}
    sys.modules[f"{MODULE}.core.background"].end_all()
    assert operator.reports == [("WARNING", "Cancelled. Nothing was changed.")]
    assert b.everything(ob) == before
    assert s.shown(ob).tobytes() == live


def test_mesh_removed_meanwhile(windowed):
    ob, operator = windowed
    context = Context()
    operator.invoke(context, None)
    bpy.data.objects.remove(ob)
    assert until_ended(operator, context) == {"CANCELLED"}
    assert operator.reports[0][0] == "ERROR"
    assert "removed" in operator.reports[0][1]
