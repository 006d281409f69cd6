# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands: what they write is what the buttons write, and what goes wrong writes nothing."""

import os
import subprocess
import sys
from pathlib import Path

import bpy
import characters as c
import commands as k
import fits
import pytest
import skins as s


@pytest.fixture
def scene(tmp_path):
    """A painted tube, two bare ones and an armature for them, saved."""
    c.source_tube()
    c.target_tube()
    c.target_tube("Second", 10, 11, 0.55)
    c.armature("Rig", c.tube_bones())
    return k.save(tmp_path / "in.blend")


def test_retarget_is_the_operator(scene, tmp_path):
    options = {"max_influences": 2, "mix_factor": 0.75, "subset": "ALL", "close_seams": False}
    objects = k.opened(scene)
    assert c.retarget(objects["Source"], objects["Target"], objects["Second"], **options) == {"FINISHED"}
    expected = {name: (k.groups(objects[name]), k.rig_of(objects[name])) for name in ("Target", "Second", "Source")}
    line = objects["Target"].dermis_retarget.result
    output = k.run_alone(
        "retarget", "--file", scene, "--output", tmp_path / "out.blend", "--source", "Source",
        "--targets", "Target", "Second", "--max-influences", 2, "--mix-factor", 0.75, "--subset", "ALL",
        "--no-close-seams", "--report", tmp_path / "report.json",
    )  # fmt: skip
    assert "retarget done" in output
    before = k.groups(k.opened(scene)["Target"])
    objects = k.opened(tmp_path / "out.blend")
    assert {name: (k.groups(objects[name]), k.rig_of(objects[name])) for name in expected} == expected
    assert before != expected["Target"][0]
    report = k.report(tmp_path / "report.json")
    assert report["exit_code"] == 0
    (job,) = report["jobs"]
    (step,) = job["steps"]
    assert (job["status"], job["output"]) == ("done", str(tmp_path / "out.blend"))
    assert step["objects"] == {"source": ["Source"], "targets": ["Target", "Second"]}
    assert {mesh["name"]: mesh["vertex_groups"] for mesh in step["counts"]} == {"Source": 3, "Target": 3, "Second": 3}
    # All but the seconds at the end of the line.
    assert step["reports"][0]["level"] == "INFO"
    assert step["reports"][0]["text"].split(" matched")[0] == line.split(" matched")[0]


def test_bind_is_the_operator_and_may_replace_its_file(scene):
    objects = k.opened(scene)
    c.activate(objects["Rig"], objects["Target"], objects["Second"])
    assert bpy.ops.dermis.bind_weights(max_influences=1) == {"FINISHED"}
    expected = [(k.groups(objects[name]), k.rig_of(objects[name])) for name in ("Target", "Second")]
    k.run(
        "bind", "--file", scene, "--output", scene, "--armature", "Rig", "--meshes", "Second", "Target",
        "--max-influences", 1,
    )  # fmt: skip
    objects = k.opened(scene)
    assert [(k.groups(objects[name]), k.rig_of(objects[name])) for name in ("Target", "Second")] == expected
    assert os.listdir(scene.parent) == ["in.blend"]


def test_fit_is_the_operator_and_leaves_the_selection(tmp_path):
    body, rig = fits.bare_body(), fits.template()
    c.activate(body)
    names = body.name, rig.name
    path = k.save(tmp_path / "in.blend")
    before = fits.joints(rig)
    assert fits.fit(rig, body, symmetry="OFF") == {"FINISHED"}
    expected = fits.joints(rig)
    k.run(
        "fit", "--file", path, "--output", tmp_path / "out.blend", "--armature", names[1], "--meshes", names[0],
        "--symmetry", "OFF",
    )  # fmt: skip
    objects = k.opened(tmp_path / "out.blend")
    fitted = fits.joints(objects[names[1]])
    assert all((fitted[name] == expected[name]).all() for name in expected)
    assert any((before[name] != expected[name]).any() for name in expected)
    assert bpy.context.view_layer.objects.active.name == names[0]
    assert [ob.name for ob in bpy.context.selected_objects] == [names[0]]


def test_skin_takes_its_settings(tmp_path):
    ob, rig = s.limb()
    s.bend(rig, 80)
    path = k.save(tmp_path / "in.blend")
    ob.dermis_skin.preset = "PAPER"
    ob.dermis_skin.iterations = 7
    s.enable(rig)
    expected = s.correction(ob).tobytes()
    k.run(
        "skin", "--file", path, "--output", tmp_path / "out.blend", "--objects", "LimbRig",
        "--iterations", 7, "--preset", "PAPER", "--report", tmp_path / "report.json",
    )  # fmt: skip
    (step,) = k.report(tmp_path / "report.json")["jobs"][0]["steps"]
    assert step["options"] == {"iterations": 7, "preset": "PAPER"}
    assert step["counts"] == [{"name": "Limb", "vertices": 402, "vertex_groups": 3}]
    ob = k.opened(tmp_path / "out.blend")["Limb"]
    assert (ob.dermis_skin.preset, ob.dermis_skin.iterations, ob.dermis_skin.enabled) == ("PAPER", 7, True)
    assert s.correction(ob).tobytes() == expected


def test_check_ends_with_its_own_code(tmp_path):
    ob, _ = c.source_tube()
    clean = k.save(tmp_path / "clean.blend")
    ob.vertex_groups["upper"].remove([40])
    for group in ob.vertex_groups:
        group.remove([40])
    bad = k.save(tmp_path / "bad.blend")
    assert "nothing to look at" in k.run("check", "--file", clean, "--meshes", "Source")
    k.run_alone("check", "--file", bad, "--meshes", "Source", "--report", tmp_path / "report.json", code=3)
    (job,) = k.report(tmp_path / "report.json")["jobs"]
    (check,) = job["steps"][0]["checks"]
    assert job["status"] == "problems"
    assert check["categories"]["unweighted"] == 1
    assert check["to_look_at"] >= 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--source", "Source", "--targets", "Trget"], "'Trget' is not in the file"),
        (["--source", "Target", "--targets", "Second"], "'Target' has no armature"),
        (["--source", "Source", "--targets", "Hidden"], "'Hidden' is hidden"),
    ],
)
def test_what_fails_writes_nothing(scene, tmp_path, arguments, message):
    objects = k.opened(scene)
    objects["Second"].copy().name = "Elsewhere"
    hidden = objects["Second"].copy()
    hidden.name = "Hidden"
    bpy.context.collection.objects.link(hidden)
    hidden.hide_set(True)
    bpy.ops.wm.save_mainfile()
    there = tmp_path / "out.blend"
    there.write_text("mine")
    output = k.run(
        "retarget", "--file", scene, "--output", there, *arguments, "--report", tmp_path / "r.json", code=1
    )  # fmt: skip
    assert message in output
    assert there.read_text() == "mine"
    (job,) = k.report(tmp_path / "r.json")["jobs"]
    assert (job["status"], job["output"]) == ("failed", "")
    assert message in job["steps"][0]["reports"][-1]["text"]
    assert sorted(path.name for path in tmp_path.iterdir() if not path.name.endswith("1")) == [
        "in.blend", "out.blend", "r.json"
    ]  # fmt: skip


def test_an_output_that_cannot_be_written(scene, tmp_path):
    (tmp_path / "folder").write_text("a file")
    given = ["--file", scene, "--source", "Source", "--targets", "Target"]
    for place, reason in ((tmp_path / "folder" / "out.blend", "could not be written"), (tmp_path, "is a folder")):
        assert reason in k.run("retarget", *given, "--output", place, code=1)
    assert "report was not written" in k.run(
        "check", "--file", scene, "--meshes", "Source", "--report", tmp_path, code=1
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "in.blend"]


def test_a_file_that_is_none(tmp_path):
    (tmp_path / "in.blend").write_text("no file of Blender's")
    common = ["--meshes", "A", "--report", tmp_path / "r.json"]
    assert "cannot be opened" in k.run("check", "--file", tmp_path / "in.blend", *common, code=1)
    assert "There is no file" in k.run("check", "--file", tmp_path / "none.blend", *common, code=1)


def test_wrong_usage(scene):
    """In this process: argparse and the operators' ranges decide before a file is opened."""
    main = k.module("batch.command").main
    given = ["retarget", "--file", str(scene), "--source", "Source", "--targets", "Target"]
    for arguments in (
        [],
        ["paint"],
        given,
        [*given, "--output", "x.blend", "--max-influences", "65"],
        [*given, "--output", "x.blend", "--max-influences", "few"],
        [*given, "--output", "x.blend", "--subset", "SOME"],
        [*given, "--output", "x.blend", "--max-influence", "4"],
        ["bake", "--file", str(scene), "--objects", "Rig"],
        ["bake", "--file", str(scene), "--objects", "Rig", "--no-play", "-s", "3"],
        ["run", str(scene)],
        ["run", "none.json"],
    ):
        assert main(arguments) == 2, arguments
    assert main(["--help"]) == 0


def test_as_a_module_with_the_native_module_that_blender_unpacked():
    script = Path(__file__).with_name("module_process.py")
    command = [sys.executable, script, k.FOLDER.parent, "check", "--help"]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.startswith("usage: python -m dermis check")


def test_every_option_is_the_operators_own():
    known = k.module("batch.operator_options").command_options()
    commands = k.module("core.commands").COMMANDS
    assert set(known) == set(commands)
    for name, command in commands.items():
        operator = getattr(bpy.ops.dermis, command.operator).get_rna_type()
        assert operator.identifier.startswith("DERMIS_OT_")
        rna = bpy.types.Object.bl_rna.properties["dermis_skin"].fixed_type if command.settings else operator
        for option in known[name].values():
            item = rna.properties[option.name]
            assert option.default == item.default
            assert option.help.startswith(item.description)
            option.check(option.default, name)
    assert {"max_influences", "subset", "mix_factor"} <= set(known["retarget"])
    assert set(known["bake"]) == {
        "directory", "file_format", "use_scene_range", "frame_start", "frame_end", "samples_per_frame", "play", "dask"
    }  # fmt: skip
    assert not {"enabled", "baked", "object_matrix"} & set(known["skin"])


def test_the_command_is_registered_with_blender(monkeypatch):
    offered = {}
    command = k.module("batch.command")
    monkeypatch.setattr(bpy.utils, "register_cli_command", lambda name, run: offered.setdefault(name, run))
    monkeypatch.setattr(bpy.utils, "unregister_cli_command", lambda _: offered.clear())
    with monkeypatch.context() as patch:
        patch.setattr(command, "_undo", type(command._undo)())
        command.register()
        assert offered == {"dermis": command.main}
        command.unregister()
        assert not offered
