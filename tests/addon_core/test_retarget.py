# SPDX-License-Identifier: GPL-3.0-or-later
"""The native call, its checks and its report, through the real native module."""

from dataclasses import replace

import numpy as np
import pytest

from .conftest import chain, dense, entries

native = pytest.importorskip("dermis_native")

from addon.core.character import BonePair  # noqa: E402
from addon.core.check_task import resulting_weights  # noqa: E402
from addon.core.errors import InputError  # noqa: E402
from addon.core.merge import MergeSettings  # noqa: E402
from addon.core.report import retarget_line, retarget_notes  # noqa: E402
from addon.core.retarget import MATCHED, RetargetSettings, check_source, check_target  # noqa: E402
from addon.core.task import RetargetTask  # noqa: E402


def retarget(source, target, **settings):
    task = RetargetTask(source, [target], RetargetSettings(**settings))
    task.start()
    return task.result()[0]


@pytest.mark.parametrize("method", ["auto", "paper"])
def test_weights_follow_the_surface(source, target, method):
    found = retarget(source, target, method=method)
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
    plain = retarget(source, target)
    heads = chain("a", "b", "c").heads[[2, 0, 1]]
    tails, parents = np.add(heads, (0, 0, 1)), np.array([2, -1, 1], np.int32)
    shuffled = replace(
        target, bones=replace(target.bones, names=("c", "a", "b"), heads=heads, tails=tails, parents=parents)
    )
    found = retarget(source, shuffled)
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
    with pytest.raises(InputError, match="has no deforming bone 'z'"):
        RetargetTask(source, [replace(target, bone_map=(BonePair("a", "z"),))], RetargetSettings())


def test_report(source, target):
    found = retarget(source, target)
    assert retarget_line(source, {"New": found}, 0.5).startswith(
        "Weights of 'Old' given to 'New': 16 vertices, 3 bones, at most "
    )
    assert "to 2 meshes: 32 vertices, 3 bones" in retarget_line(source, {"New": found, "Other": found}, 0.5)
    assert retarget_notes(source, {"New": found}) == []
    noted = replace(source, boneless_groups=("Mask",))
    mapping = replace(found.mapping, target=(*found.mapping.target, "tail"))
    assert retarget_notes(noted, {"New": replace(found, mapping=mapping)}) == [
        "1 group without a bone ignored: 'Mask'.",
        "'New' has bones that the source lacks, left without weights: 'tail'.",
    ]
    weighted = replace(found, mapping=mapping, groups=(*found.groups, len(mapping.target) - 1))
    assert retarget_notes(source, {"New": weighted}) == [
        "'New' has bones that the source lacks, weighted by their place: 'tail'."
    ]
    shown = replace(source, shape="evaluated")
    assert retarget_notes(shown, {"New": found}) == [
        "The source was taken as it is shown, with pose, shape keys and modifiers."
    ]


def test_report_of_a_scope(source, target):
    some = replace(target, only_vertices=np.arange(16) < 10)
    found = retarget(source, some, merge=MergeSettings(max_influences=1))
    assert len(found.replaced) == 10
    assert (found.status[10:] == 0).all()
    line = retarget_line(source, {"New": found}, 0.5)
    assert "10 vertices" in line
    assert "6 vertices left as they were" in line


def test_groups_without_a_bone_follow_the_match(source, target):
    heights = source.surface.vertices[:, 2]
    mask = entries(*((v, 0, 1.0) for v in np.flatnonzero(heights > 1.6).tolist()))
    masked = replace(source, boneless_groups=("Top",), boneless=mask)
    target = replace(target, copied_groups=("Top",), landmarks=np.array([(0, 0), (7, 5), (17, 14)], np.int64))
    found = retarget(masked, target)
    copied = dense(found.copied, 16, 1)[:, 0]
    high = target.surface.vertices[:, 2]
    assert (copied[high > 2.4] == 1).all()
    assert (copied[high < 0.9] == 0).all()
    half = retarget(masked, target, merge=MergeSettings(mix=0.5))
    np.testing.assert_allclose(dense(half.copied, 16, 1)[:, 0], copied / 2)


def test_seam_between_two_targets(source, target):
    """A strip cut in two: both sides of the cut get the same weights in one run."""
    upper = replace(
        target, name="Upper", surface=replace(target.surface, vertices=np.add(target.surface.vertices, (0, 0, 3)))
    )
    bones = replace(source.bones, heads=source.bones.heads * (1, 1, 2), tails=source.bones.tails * (1, 1, 2))
    both = [replace(each, bones=bones) for each in (target, upper)]
    task = RetargetTask(source, both, RetargetSettings())
    task.start()
    low, high = task.result()
    assert (low.seams, high.seams) == (2, 2)
    np.testing.assert_array_equal(dense(low.weights, 16, 3)[14:], dense(high.weights, 16, 3)[:2])
    apart = RetargetTask(source, both, RetargetSettings(close_seams=False))
    apart.start()
    assert [each.seams for each in apart.result()] == [0, 0]


def test_statuses_are_counted(source, target):
    found = retarget(source, target)
    assert np.count_nonzero(found.status == MATCHED) == found.matched


@pytest.mark.parametrize("keep", [True, False])
def test_bones_that_only_the_target_has(source, target, keep):
    """A bone of a skirt, painted by hand at some vertices."""
    names, heads = ("a", "b", "c", "skirt"), np.vstack([target.bones.heads, (4, 0, 1)])
    bones = replace(
        target.bones,
        names=names,
        heads=heads,
        tails=np.add(heads, (0, 0, 1)),
        parents=np.array([-1, 0, 1, 1], np.int32),
    )
    old = entries((4, 3, 0.75), (4, 0, 0.25), (5, 3, 1.0))
    mine = replace(target, bones=bones, existing=old, locked=np.zeros(4, np.bool_))
    mine = replace(mine, bone_map=(BonePair("a", "a"), BonePair("b", "b"), BonePair("c", "c")))
    found = retarget(source, mine, keep_unmapped=keep)
    after = dense(resulting_weights(mine, found), 16, 4)
    np.testing.assert_allclose(after.sum(axis=1), 1, atol=1e-6)
    assert after[4:6, 3].tolist() == ([0.75, 1.0] if keep else [0, 0])
    note = retarget_notes(source, {"New": found}, kept=keep)[0]
    assert ("kept their weights" in note) == keep
