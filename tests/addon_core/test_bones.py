# SPDX-License-Identifier: GPL-3.0-or-later
"""The map of bones: found by the native module or as listed by the user."""

from dataclasses import replace

import numpy as np
import pytest

from .conftest import chain

native = pytest.importorskip("dermis_native")

from addon.core.bones import distances_to_bones, found_bones, listed_bones, map_characters  # noqa: E402
from addon.core.character import BonePair, Bones  # noqa: E402
from addon.core.errors import InputError  # noqa: E402
from addon.core.report import mapping_line, retarget_line, retarget_notes  # noqa: E402
from addon.core.retarget import RetargetSettings  # noqa: E402
from addon.core.task import RetargetTask  # noqa: E402


def fork():
    """A chain a-b-c, a branch x of a and y at its end."""
    bones = chain("a", "b", "c", "x", "y")
    heads, tails = bones.heads.copy(), bones.tails.copy()
    heads[3], tails[3] = (0.5, 0, 0.5), (2.0, 0, 0.5)
    heads[4], tails[4] = (2.0, 0, 0.5), (3.0, 0, 0.5)
    return Bones(bones.names, heads, tails, np.array([-1, 0, 1, 0, 3], np.int32))


def pairs(*rows):
    return tuple(BonePair(*row) for row in rows)


def test_equal_names():
    mapping = found_bones("Old", chain("a", "b", "c"), "New", chain("a", "b", "c", "tail"))
    assert mapping.native.targets == [[0], [1], [2]]
    assert mapping.only_in_target == ("tail",)
    assert mapping.mapped == (0, 1, 2)
    assert mapping.counts() == {"name": 3}
    assert mapping.heirs() == ()
    assert mapping_line("Old", "New", mapping) == "Bones of 'Old' mapped to 'New': 3 by name."


def test_list_of_the_user():
    rows = pairs(("a", "a"), ("b", "c"), ("b", "b"), ("c", ""))
    mapping = listed_bones("Old", fork(), "New", fork(), rows)
    assert mapping.native.targets == [[0], [1, 2], [], [], []]  # from the top of the chain down
    assert mapping.counts() == {"user": 2}
    assert mapping.heirs() == (("c", "b"), ("x", "a"), ("y", "a"))
    assert mapping.rows() == [
        ("a", "a", "user"), ("b", "b", "user"), ("b", "c", "user"), ("c", "", "none"),
        ("x", "", "none"), ("y", "", "none"),
    ]  # fmt: skip
    assert mapping_line("Old", "New", mapping).endswith(": 2 by hand, 3 without a counterpart.")


def test_list_tells_what_was_found_and_what_was_changed():
    found = found_bones("Old", fork(), "New", fork())
    again = listed_bones("Old", fork(), "New", fork(), found.rows())
    assert again.counts() == {"name": 5}
    changed = [row._replace(target="", how="user") if row.source == "c" else row for row in found.rows()]
    changed = [row._replace(target="x", how="user") if row.source == "y" else row for row in changed]
    mixed = listed_bones("Old", fork(), "New", fork(), changed)
    assert mixed.counts() == {"name": 3, "user": 1}
    assert mixed.how == ("name", "name", "none", "name", "user")


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ((("a", "a"), ("old", "b")), "pairs 'old' with 'b', but 'Old' has no deforming bone 'old'"),
        ((("a", "gone"),), "pairs 'a' with 'gone', but 'New' has no deforming bone 'gone'"),
        ((("a", "c"), ("a", "y")), "The bone list from 'Old' to 'New' cannot be used: .*\"c\" and \"y\""),
        ((("a", "b"), ("a", "b")), "cannot be used: .*'?a'?.*twice"),
        ((("a", ""), ("b", "")), "cannot be used|No bone"),
    ],
)
def test_list_that_cannot_be_used(rows, message):
    with pytest.raises(InputError, match=message):
        listed_bones("Old", fork(), "New", fork(), pairs(*rows))


def run(source, target):
    return RetargetTask(source, [target], RetargetSettings()).work()[0]


def test_other_names(source, target):
    plain = run(source, target)
    renamed = replace(target, bones=replace(target.bones, names=("x", "y", "z")))
    found = run(source, renamed)
    np.testing.assert_allclose(found.weights.value, plain.weights.value, atol=1e-5)
    np.testing.assert_array_equal(found.weights.bone, plain.weights.bone)
    assert "3 mapped by structure" in retarget_line(source, {"New": found}, 1.0)
    assert retarget_notes(source, {"New": found}) == [
        "No bone names in common with 'New', check the bones: 'a' to 'x', 'b' to 'y', 'c' to 'z'."
    ]


def test_list_of_the_target_is_used(source, target):
    """Source bones b and c both go to the target's b."""
    listed = replace(target, bone_map=pairs(("a", "a"), ("b", "b"), ("c", "b")))
    found = run(source, listed)
    assert set(found.weights.bone.tolist()) == {0, 1}
    assert found.groups == (0, 1)
    assert found.mapping.only_in_target == ("c",)
    top = found.weights.where(found.weights.vertex == 15)
    assert (top.bone.tolist(), top.value.tolist()) == ([1], [1.0])
    assert "3 mapped by hand" in retarget_line(source, {"New": found}, 1.0)


def test_bone_without_a_counterpart_is_reported(source, target):
    short = replace(target, bone_map=pairs(("a", "a"), ("b", "b"), ("c", "")))
    found = run(source, short)
    notes = retarget_notes(source, {"New": found})
    assert "Bones without a counterpart for 'New' gave their weight on: 'c' to 'b'." in notes
    light = replace(source, weights=source.weights.where(source.weights.bone < 2))
    notes = retarget_notes(light, {"New": run(light, short)})
    assert not any("gave their weight" in note for note in notes), "a bone without weight loses nothing"


def test_map_of_characters_prefers_the_list(source, target):
    assert map_characters(source, target).counts() == {"name": 3}
    assert map_characters(source, replace(target, bone_map=pairs(("a", "c")))).counts() == {"user": 1}


def test_distances_to_segments():
    points = np.array([[0.5, 0, 0.5], [2.5, 0, 0.25], [0.5, 0, -3.0], [0.5, 4, 4]], np.float64)
    expected = [[0, 0.5], [2, np.hypot(2, 0.75)], [3, 4], [5, np.hypot(4, 2)]]
    np.testing.assert_allclose(distances_to_bones(points, chain("a", "b")), expected)
