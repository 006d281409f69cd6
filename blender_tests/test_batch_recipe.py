# SPDX-License-Identifier: GPL-3.0-or-later
"""Recipes: one body, several garments and avatars; and ranges baked in parts."""

import json
import re
from pathlib import Path

import bakes as b
import bpy
import characters as c
import commands as k
import numpy as np
import pytest
import skins as s

AVATARS = {"anna": 0.5, "bert": 0.6}
GARMENTS = {"shirt": (10, 14), "coat": (9, 16)}


@pytest.fixture
def folder(tmp_path):
    """A painted body, avatars with a skeleton each, and bare garments, each in its own file."""
    c.source_tube("Body")
    k.save(tmp_path / "body.blend")
    for name, radius in AVATARS.items():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        c.armature("AvatarRig", c.tube_bones())
        c.mesh_object("Avatar", *c.tube(12, 13, radius=radius))
        k.save(tmp_path / f"{name}.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for name, (segments, rings) in GARMENTS.items():
        c.mesh_object(name, *c.tube(segments, rings, radius=0.65))
    k.save(tmp_path / "garments.blend")
    return tmp_path


def recipe(folder, **changes):
    data = {
        "version": 1,
        "for_each": {"avatar": list(AVATARS), "garment": list(GARMENTS)},
        "open": "{avatar}.blend",
        "append": [
            {"file": "body.blend", "objects": ["Body"], "rename": {"Body": "Painted"}},
            {"file": "garments.blend", "objects": ["{garment}"]},
        ],
        "steps": [
            {"command": "bind", "armature": "AvatarRig", "meshes": ["Avatar"]},
            {"command": "retarget", "source": "Painted", "targets": ["{garment}"], "options": {"max_influences": 3}},
            {"command": "check", "meshes": ["{garment}"], "options": {"stretch": 10.0}},
        ],
        "output": "out/{avatar}_{garment}.blend",
        **changes,
    }
    path = folder / "recipe.json"
    path.write_text(json.dumps(data))
    return path


def test_every_garment_on_every_avatar(folder):
    k.run_alone("run", recipe(folder), "--report", folder / "report.json")
    expected = {}
    for avatar in AVATARS:
        for garment in GARMENTS:
            k.opened(folder / f"{avatar}.blend")
            for path, name in ((folder / "body.blend", "Body"), (folder / "garments.blend", garment)):
                bpy.ops.wm.append(directory=f"{path}/Object/", filename=name)
            objects = bpy.data.objects
            c.activate(objects["AvatarRig"], objects["Avatar"])
            bpy.ops.dermis.bind_weights()
            c.retarget(objects["Body"], objects[garment], max_influences=3)
            expected[avatar, garment] = (k.groups(objects["Avatar"]), k.groups(objects[garment]))
    for (avatar, garment), wanted in expected.items():
        objects = k.opened(folder / "out" / f"{avatar}_{garment}.blend")
        assert {"Painted", "BodyRig", "Avatar", "AvatarRig", garment} == set(objects.keys())
        assert (k.groups(objects["Avatar"]), k.groups(objects[garment])) == wanted
        assert k.rig_of(objects[garment])[0] == [("Armature", "ARMATURE", "BodyRig")]
    report = k.report(folder / "report.json")
    assert [job["name"] for job in report["jobs"]] == [f"avatar={a},garment={g}" for a in AVATARS for g in GARMENTS]
    for job in report["jobs"]:
        assert [step["command"] for step in job["steps"]] == ["bind", "retarget", "check"]
        assert job["status"] == "done"
        assert all(step["seconds"] >= 0 and step["reports"] for step in job["steps"])


def test_one_job_alone_and_a_job_that_fails(folder):
    path = recipe(folder)
    names = k.run("run", path, "--list").split("\n")
    assert names[:4] == [f"avatar={a},garment={g}" for a in AVATARS for g in GARMENTS]
    k.run("run", path, "--job", names[2])
    assert [file.name for file in (folder / "out").iterdir()] == ["bert_shirt.blend"]
    assert "no job 'x'" in k.run("run", path, "--job", "x", code=2)
    (folder / "anna.blend").unlink()
    k.run("run", path, "--job", names[0], "--job", names[3], "--report", folder / "report.json", code=1)
    assert sorted(file.name for file in (folder / "out").iterdir()) == ["bert_coat.blend", "bert_shirt.blend"]
    states = [(job["name"], job["status"]) for job in k.report(folder / "report.json")["jobs"]]
    assert states == [(names[0], "failed"), (names[3], "done")]


def test_discarding_and_names_that_are_taken(folder):
    whole = {"for_each": {}, "open": "anna.blend", "output": "out.blend"}
    body = {"file": "body.blend", "objects": ["Body"]}
    steps = [{"command": "retarget", "source": "Body", "targets": ["Avatar"]}]
    output = k.run("run", recipe(folder, **whole, append=[body], steps=steps, discard=["Body", "BodyRig"]), code=1)
    assert "'BodyRig' cannot be discarded: 'Avatar' needs it" in output
    assert not (folder / "out.blend").exists()
    k.run("run", recipe(folder, **whole, append=[body], steps=steps, discard=["Body"]))
    objects = k.opened(folder / "out.blend")
    assert set(objects.keys()) == {"Avatar", "AvatarRig", "BodyRig"}
    assert len(bpy.data.meshes) == 1
    taken = [{"file": "anna.blend", "objects": ["Avatar"]}]
    assert "'Avatar' would be there twice" in k.run("run", recipe(folder, **whole, append=taken, steps=steps), code=1)
    none = [{"file": "body.blend", "objects": ["Bdy"]}]
    assert "has no object 'Bdy'" in k.run("run", recipe(folder, **whole, append=none, steps=steps), code=1)


def test_wrong_recipes_run_nothing(folder):
    assert "did you mean 'options'" in k.run(
        "run", recipe(folder, steps=[{"command": "bind", "armature": "A", "meshes": "B", "option": {}}]), code=2
    )
    assert not (folder / "out").exists()


def test_the_documented_recipe_is_one():
    text = (Path(__file__).parents[1] / "docs" / "batch.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```json\n(.*?)```", text, re.DOTALL)
    known = k.module("batch.operator_options").command_options()
    jobs = k.module("core.recipe").read_recipe(example, Path(__file__).parent, known)
    assert len({job.output for job in jobs}) == 6


def test_parts_of_a_range_in_three_processes(tmp_path):
    """Out of order and at once; then as one: the same bytes, also after joining."""
    ob, _ = b.animated_limb()
    b.saved(tmp_path)
    assert b.bake(ob, directory="//button", play=False) == {"FINISHED"}
    common = ["bake", "--file", tmp_path / "shot.blend", "--objects", "LimbRig", "--no-play"]
    parts = [
        k.start(*common, "-s", first, "-e", last, "--directory", f"//parts/{first}")
        for first, last in ((9, 13), (1, 4), (5, 8))
    ]
    assert [k.end(process)[0] for process in parts] == [0, 0, 0]
    k.run_alone(*common, "--directory", "//whole")
    files = [tmp_path / "parts" / first / "shot_Limb.pc2" for first in ("5", "9", "1")]
    (tmp_path / "out").mkdir()
    k.run(
        "bake-join", "--file", tmp_path / "shot.blend", "--output", tmp_path / "out" / "played.blend",
        "--mesh", "Limb", "--parts", *files, "--target", "//joined",
    )  # fmt: skip
    whole = (tmp_path / "button" / "shot_Limb.pc2").read_bytes()
    assert (tmp_path / "whole" / "shot_Limb.pc2").read_bytes() == whole
    assert (tmp_path / "joined" / "shot_Limb.pc2").read_bytes() == whole
    ob = k.opened(tmp_path / "shot.blend")["Limb"]
    live = b.at(ob, 7)
    ob = k.opened(tmp_path / "out" / "played.blend")["Limb"]
    assert ob.modifiers["Dermis Cache"].filepath == "//../joined/shot_Limb.pc2"
    assert ob.data.shape_keys.key_blocks["Dermis"].mute
    np.testing.assert_allclose(b.at(ob, 7), live, atol=1e-5 * s.HEIGHT)
