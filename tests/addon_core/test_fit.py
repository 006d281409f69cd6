# SPDX-License-Identifier: GPL-3.0-or-later
"""Fitting bones into a body: what is refused, what is said of the result."""

from dataclasses import replace

import numpy as np
import pytest
from dermis_native import Cancelled

from addon.core.character import Bones, Surface
from addon.core.errors import InputError
from addon.core.fit import Body, FitTask, FittedBones, Template, check_lengths, fit_counts, fit_line, fit_notes


def prism(low=0.0, high=8.0, radius=1.0, rings=17):
    """A closed prism around the z axis."""
    angles = np.arange(8) * (np.pi / 4)
    circle = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.array([(x, y, z) for z in np.linspace(low, high, rings) for x, y in circle])
    lower = np.array([(8 * r + i, 8 * r + (i + 1) % 8) for r in range(rings - 1) for i in range(8)])
    sides = np.column_stack([lower, lower[:, ::-1] + 8])
    corners = np.concatenate([sides.ravel(), np.arange(8)[::-1], 8 * (rings - 1) + np.arange(8)])
    counts = np.array([4] * len(sides) + [8, 8], np.int32)
    return Surface(vertices, counts, corners.astype(np.int32))


TEMPLATE = Template(
    "Rig",
    Bones(
        ("lower", "upper", "control"),
        np.array([[0.0, 0, 0], [0, 0, 1], [0, 1, 0]]),
        np.array([[0.0, 0, 1], [0, 0, 2], [0, 1, 1]]),
        np.array([-1, 0, -1], np.int32),
    ),
    deform=np.array([True, True, False]),
    fixed=np.zeros(3, bool),
)
BODY = Body(("Tube",), (prism(),))
FITTED = FittedBones(
    TEMPLATE.bones.heads, TEMPLATE.bones.tails, np.array([True, True, False]), 0.9, "embedding", True, ""
)


def test_bones_go_into_the_body():
    task = FitTask(TEMPLATE, BODY, None)
    result = task.work()
    for points in (result.heads[:2], result.tails[:2]):
        assert (np.linalg.norm(points[:, :2], axis=1) < 1.0).all()
        assert ((points[:, 2] >= 0) & (points[:, 2] <= 8)).all()
    assert (result.heads[1] == result.tails[0]).all()
    assert result.tails[1, 2] - result.heads[0, 2] > 4
    assert 0 <= result.score <= 1
    assert task.fraction > 0.9
    assert task.stage


def test_fixed_bones_stay():
    bones = TEMPLATE.bones
    moved = replace(bones, heads=np.add(bones.heads, (0.2, 0, 3)), tails=np.add(bones.tails, (0.2, 0, 3)))
    fixed = np.array([True, False, False])
    result = FitTask(replace(TEMPLATE, bones=moved, fixed=fixed), BODY, None).work()
    np.testing.assert_array_equal(result.heads[0], moved.heads[0])
    np.testing.assert_array_equal(result.tails[0], moved.tails[0])
    np.testing.assert_array_equal(result.heads[1], moved.tails[0])


def test_several_meshes_count_as_one():
    halves = Body(("Low", "High"), (prism(high=4.0), prism(low=4.0)))
    whole, both = (FitTask(TEMPLATE, body, None).work() for body in (BODY, halves))
    np.testing.assert_allclose(both.heads[:, 2], whole.heads[:, 2], atol=0.4)


def test_bad_input_is_named():
    for template, message in (
        (replace(TEMPLATE, deform=np.zeros(3, bool)), "Armature 'Rig' has no deforming bone"),
        (
            replace(TEMPLATE, deform=np.array([False, True, False])),
            "Armature 'Rig' has one bone to fit, 'upper': a skeleton of at least two is needed",
        ),
        (replace(TEMPLATE, fixed=np.ones(3, bool)), "All bones of 'Rig' are kept where they are"),
        (
            replace(TEMPLATE, bones=replace(TEMPLATE.bones, tails=TEMPLATE.bones.tails * np.nan)),
            "Armature 'Rig' has coordinates that are not finite at 'lower', 'upper', 'control'",
        ),
    ):
        with pytest.raises(InputError, match=message):
            FitTask(template, BODY, None)
    empty = Surface(np.zeros((2, 3)), np.empty(0, np.int32), np.empty(0, np.int32))
    with pytest.raises(InputError, match="'Nothing' has 2 vertices and no faces"):
        FitTask(TEMPLATE, Body(("Tube", "Nothing"), (prism(), empty)), None)


def test_the_cores_errors_name_both():
    point = Surface(np.zeros((3, 3)), np.array([3], np.int32), np.arange(3, dtype=np.int32))
    with pytest.raises(InputError, match=r"'Rig' cannot be fitted into 'Point': .*[^.]\.$"):
        FitTask(TEMPLATE, Body(("Point",), (point,)), None).work()


def test_cancelled():
    task = FitTask(TEMPLATE, BODY, None)
    task.cancel()
    with pytest.raises(Cancelled):
        task.work()


def test_what_is_said():
    assert fit_counts(TEMPLATE, FITTED) == ["2 bones placed by the shape", "1 carried along", "score 0.90"]
    kept = replace(TEMPLATE, fixed=np.array([True, False, False]))
    assert fit_counts(kept, FITTED) == ["1 bone placed by the shape", "1 carried along", "1 kept", "score 0.90"]
    assert fit_line(TEMPLATE, BODY, FITTED, 0.5) == (
        "'Rig' fitted into 'Tube': 2 bones placed by the shape, 1 carried along, score 0.90, symmetric, 0.50 s."
    )
    assert fit_notes(FITTED) == []
    assert fit_notes(replace(FITTED, message="no arm was found")) == ["No arm was found."]
    [note] = fit_notes(replace(FITTED, score=0.1))
    assert note.startswith("The skeleton fits badly")


def test_bones_too_short_for_blender():
    check_lengths("Rig", ("a", "b"), np.array([1.0, 1e-3]), 1e-6)
    with pytest.raises(InputError, match="Bones of 'Rig' would be too short for Blender: 'b'"):
        check_lengths("Rig", ("a", "b"), np.array([1.0, 1e-6]), 1e-6)
