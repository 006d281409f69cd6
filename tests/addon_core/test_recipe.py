# SPDX-License-Identifier: GPL-3.0-or-later
"""Recipes: every combination once, and every mistake told with its place before anything runs."""

import json
from pathlib import Path
from typing import Any

import pytest

from addon.core.commands import COMMANDS
from addon.core.errors import InputError
from addon.core.options import Option
from addon.core.recipe import Job, read_recipe

KNOWN: dict[str, dict[str, Option]] = {name: {} for name in COMMANDS}
KNOWN["retarget"] = {
    "max_influences": Option("max_influences", "INT", 0, least=0, most=64),
    "mix_factor": Option("mix_factor", "FLOAT", 1.0, least=0.0, most=0.8999999761581421),
    "replace": Option("replace", "BOOLEAN", True),
    "subset": Option("subset", "ENUM", "DEFORM", choices=("ALL", "DEFORM")),
    "protected_group": Option("protected_group", "STRING", ""),
}
KNOWN["bake"] = {
    "use_scene_range": Option("use_scene_range", "BOOLEAN", True),
    "frame_start": Option("frame_start", "INT", 1, least=-100, most=100),
    "frame_end": Option("frame_end", "INT", 250, least=-100, most=100),
    "directory": Option("directory", "STRING", "//"),
    "play": Option("play", "BOOLEAN", True),
}
KNOWN["check"] = {"use_retarget": Option("use_retarget", "BOOLEAN", False)}

STEP = {"command": "retarget", "source": "Body", "targets": ["{garment}"]}
RECIPE: dict[str, Any] = {
    "version": 1,
    "for_each": {"avatar": ["anna", "bert"], "garment": ["shirt", "coat"]},
    "open": "in/{avatar}.blend",
    "append": [{"file": "garments.blend", "objects": ["{garment}"]}],
    "steps": [STEP],
    "output": "out/{avatar}_{garment}.blend",
}
FOLDER = Path(__file__).resolve().parent


def jobs(**changes: Any) -> list[Job]:
    return read_recipe(json.dumps({**RECIPE, **changes}), FOLDER, KNOWN)


def step(**changes: Any) -> list[Job]:
    return jobs(steps=[{**STEP, **changes}])


def bake(**options: Any) -> dict[str, Any]:
    step = {"command": "bake", "objects": ["Rig"], "options": options}
    return {"version": 1, "open": "a.blend", "steps": [step], "output": "b.blend"}


def test_every_combination_in_the_order_of_the_recipe() -> None:
    found = jobs()
    assert [job.name for job in found] == [
        f"avatar={avatar},garment={garment}" for avatar in ("anna", "bert") for garment in ("shirt", "coat")
    ]
    last = found[-1]
    assert last.open == str(FOLDER / "in/bert.blend")
    assert last.output == str(FOLDER / "out/bert_coat.blend")
    assert last.append[0].file == str(FOLDER / "garments.blend")
    assert last.append[0].objects == ("coat",)
    assert last.steps[0].objects == {"source": ("Body",), "targets": ("coat",)}


def test_a_recipe_without_variables_is_one_job() -> None:
    (job,) = read_recipe(json.dumps(bake(directory="//caches", play=False)), FOLDER, KNOWN)
    assert job.name == "recipe"
    assert job.steps[0].options == {"directory": "//caches", "play": False}
    assert not job.steps[0].changes


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outputs": "x"}, "recipe has no key 'outputs': did you mean 'output'?"),
        ({"version": 2}, "recipe.version is 2"),
        ({"version": True}, "recipe.version must be a whole number, not True"),
        ({"steps": []}, "recipe.steps is empty"),
        ({"steps": {}}, "recipe.steps must be a list, not an object"),
        ({"steps": ["retarget"]}, "recipe.steps[0] must be an object"),
        ({"open": 3}, "recipe.open must be a text, not 3"),
        ({"open": "{avatr}.blend"}, "recipe.open has no variable 'avatr': did you mean 'avatar'?"),
        ({"open": "", "append": []}, "recipe lacks 'open' or 'append'"),
        ({"output": ""}, "recipe lacks 'output'"),
        ({"output": "{avatar}.blend"}, "'avatar=anna,garment=shirt' and 'avatar=anna,garment=coat' would both write"),
        ({"for_each": {"avatar": []}}, "recipe.for_each.avatar must have values"),
        ({"for_each": {"avatar": ["a", "a"]}}, "recipe.for_each.avatar must have values, each of them once"),
        ({"for_each": {"avatar": "anna"}}, "recipe.for_each.avatar must be a list, not 'anna'"),
        ({"append": [{"file": "x"}]}, "recipe.append[0] lacks 'objects'"),
        ({"append": [{"file": "x", "objects": [], "from": 1}]}, "recipe.append[0] has no key 'from'"),
        ({"append": [{"file": "x", "objects": ["A"], "rename": {"B": "C"}}]}, "append[0].rename has 'B'"),
    ],
)
def test_mistakes_of_a_recipe_are_told_with_their_place(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        jobs(**changes)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"command": "retrget"}, "recipe.steps[0] has no command 'retrget': did you mean 'retarget'?"),
        ({"target": "A"}, "recipe.steps[0] has no key 'target': did you mean 'targets'?"),
        ({"source": ["A", "B"]}, "recipe.steps[0].source must be a single name"),
        ({"source": ""}, "recipe.steps[0].source must be a name"),
        ({"targets": ["A", "A"]}, "recipe.steps[0].targets names an object twice"),
        ({"parts": ["a"]}, "recipe.steps[0] has no key 'parts'"),
        ({"options": []}, "recipe.steps[0].options must be an object"),
        ({"options": {"max_influence": 4}}, "options has no option 'max_influence': did you mean 'max_influences'?"),
        ({"options": {"max_influences": 4.0}}, "options.max_influences must be a whole number, not 4.0"),
        ({"options": {"max_influences": True}}, "options.max_influences must be a whole number, not True"),
        ({"options": {"max_influences": 65}}, "options.max_influences must be between 0 and 64, not 65"),
        ({"options": {"mix_factor": float("nan")}}, "options.mix_factor must be between 0 and 0.9, not nan"),
        ({"options": {"replace": 1}}, "options.replace must be true or false, not 1"),
        ({"options": {"subset": "deform"}}, "options.subset must be one of 'ALL', 'DEFORM', not 'deform'"),
        ({"options": {"protected_group": None}}, "options.protected_group must be a text, not None"),
    ],
)
def test_mistakes_of_a_step_are_told_with_their_place(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        step(**changes)
    assert message in str(caught.value)


def test_values_at_the_ends_of_a_range_fit() -> None:
    """Blender's ranges are in single precision: 0.9 is a little more than its neighbor there."""
    (job, *_) = step(options={"mix_factor": 0.9, "max_influences": 64})
    assert job.steps[0].options == {"mix_factor": 0.9, "max_influences": 64}


def test_a_lacking_role_is_named() -> None:
    with pytest.raises(InputError, match="lacks 'targets'"):
        jobs(steps=[{"command": "retarget", "source": "Body"}])


def test_frames_that_are_given_are_used() -> None:
    (job,) = read_recipe(json.dumps(bake(frame_start=1, frame_end=9)), FOLDER, KNOWN)
    assert job.steps[0].options == {"frame_start": 1, "frame_end": 9, "use_scene_range": False}
    with pytest.raises(InputError, match="give both, frame_start and frame_end"):
        read_recipe(json.dumps(bake(frame_end=9)), FOLDER, KNOWN)


def test_caches_of_two_jobs_must_not_meet() -> None:
    recipe = {**bake(), "for_each": {"garment": ["a", "b"]}, "output": "{garment}_out.blend"}
    with pytest.raises(InputError, match="'garment=a' and 'garment=b' would both bake into the folder '//'"):
        read_recipe(json.dumps(recipe), FOLDER, KNOWN)
    recipe["steps"] = bake(directory="//{garment}")["steps"]
    assert len(read_recipe(json.dumps(recipe), FOLDER, KNOWN)) == 2
    recipe["open"] = "{garment}/shot.blend"
    recipe["steps"] = bake(directory="//caches")["steps"]
    assert len(read_recipe(json.dumps(recipe), FOLDER, KNOWN)) == 2
    recipe["steps"] = bake(directory="/caches")["steps"]
    with pytest.raises(InputError, match="would both bake into the folder '/caches'"):
        read_recipe(json.dumps(recipe), FOLDER, KNOWN)


def test_a_check_with_a_source_is_a_dry_run() -> None:
    found = jobs(steps=[{"command": "check", "source": "Body", "meshes": "{garment}"}], output="")
    assert found[0].steps[0].options == {"use_retarget": True}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "The recipe is not JSON: line 1, column 2"),
        ('{"version": 1, "version": 1}', "The key 'version' comes twice"),
        ("[]", "recipe must be an object, not a list"),
        ("{}", "recipe lacks 'version', 'steps'"),
    ],
)
def test_what_is_no_recipe(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        read_recipe(text, FOLDER, KNOWN)
    assert message in str(caught.value)


def test_no_job_writes_what_others_read() -> None:
    with pytest.raises(InputError, match=r"'avatar=anna,other=x' would write .*, which jobs read"):
        jobs(
            for_each={"avatar": ["anna", "bert"], "other": ["x"]},
            append=[],
            open="{avatar}.blend",
            steps=[{**STEP, "targets": "{other}"}],
            output="../" + FOLDER.name + "/{avatar}.blend",
        )
