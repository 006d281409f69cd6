# SPDX-License-Identifier: GPL-3.0-or-later
"""The native call, its checks and its report, through the real native module."""

from dataclasses import replace

import numpy as np
import pytest

from .conftest import chain, dense, entries

native = pytest.importorskip("dermis_native")

from addon.core.errors import InputError  # noqa: E402
from addon.core.report import retarget_line, retarget_notes  # noqa: E402
from addon.core.retarget import RetargetSettings, check_source, check_target, retarget  # noqa: E402
from addon.core.task import RetargetTask  # noqa: E402


@pytest.mark.parametrize("method", ["auto", "paper"])
def test_weights_follow_the_surface(source, target, method):
    found = retarget(source, target, RetargetSettings(method=method), native.Progress())
    weights = dense(found.weights, 16, 3)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert weights[0].argmax() == 0
    assert weights[15].argmax() == 2
    assert found.matched + found.filled == 16
    assert found.groups == (0, 1, 2)
    assert found.influences >= 1


def test_columns_are_the_bones_of_the_target(source, target):
    # Landmarks off the axis of the strip, so that no tie hangs on the order of the bones.
    target = replace(target, landmarks=np.array([(0, 0), (7, 5), (17, 14)], np.int64))
    plain = retarget(source, target, RetargetSettings(), native.Progress())
    heads = chain("a", "b", "c").heads[[2, 0, 1]]
    tails, parents = np.add(heads, (0, 0, 1)), np.array([2, -1, 1], np.int32)
    shuffled = replace(
        target, bones=replace(target.bones, names=("c", "a", "b"), heads=heads, tails=tails, parents=parents)
    )
    found = retarget(source, shuffled, RetargetSettings(), native.Progress())
    np.testing.assert_allclose(dense(found.weights, 16, 3)[:, [1, 2, 0]], dense(plain.weights, 16, 3), atol=1e-6)


def test_source_must_have_something_to_give(source):
    with pytest.raises(InputError, match="No vertex of 'Old' has weight on a bone of 'OldRig'"):
        check_source(replace(source, weights=entries((0, 0, 0.0))))
    with pytest.raises(InputError, match="'Old' has a weight that is not finite at vertex 1"):
        check_source(replace(source, weights=entries((0, 0, 1.0), (1, 0, np.nan))))


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([(0, 0), (18, 1)], "Landmark 2 names vertex 18 of 'Old', which has 18 vertices"),
        ([(0, 16)], "Landmark 1 names vertex 16 of 'New', which has 16 vertices"),
        ([(-1, 0)], "Landmark 1 names vertex -1 of 'Old'"),
        ([(3, 0), (3, 1)], "Two landmarks name the same vertex 3 of 'Old'"),
        ([(0, 5), (1, 5)], "Two landmarks name the same vertex 5 of 'New'"),
    ],
)
def test_landmarks_are_checked(source, target, pairs, message):
    with pytest.raises(InputError, match=message):
        check_target(source, replace(target, landmarks=np.array(pairs, np.int64)))


def test_task_gives_a_result_for_each_target(source, target):
    task = RetargetTask(source, [target, replace(target, name="Other")], RetargetSettings())
    task.start()
    assert task.wait(60)
    first, second = task.result()
    np.testing.assert_array_equal(first.weights.value, second.weights.value)
    assert task.fraction == pytest.approx(1)


def test_cancelled_task_raises(source, target):
    task = RetargetTask(source, [target], RetargetSettings())
    task.cancel()
    task.start()
    with pytest.raises(native.Cancelled):
        task.result()


def test_task_checks_at_once(source, target):
    with pytest.raises(InputError, match="lacks 'b', 'c'"):
        RetargetTask(source, [replace(target, bones=chain("a"))], RetargetSettings())


def test_report(source, target):
    found = retarget(source, target, RetargetSettings(), native.Progress())
    assert retarget_line(source, {"New": found}, 0.5).startswith(
        "Weights of 'Old' given to 'New': 16 vertices, 3 bones, at most "
    )
    assert "to 2 meshes: 32 vertices, 3 bones" in retarget_line(source, {"New": found, "Other": found}, 0.5)
    assert retarget_notes(source, {"New": found}) == []
    noted = replace(source, ignored_groups=("Mask",))
    assert retarget_notes(noted, {"New": replace(found, only_in_target=("tail",))}) == [
        "1 group without a bone ignored: 'Mask'.",
        "'New' has bones that the source lacks, left without weights: 'tail'.",
    ]
