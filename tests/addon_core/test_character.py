# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays of a character."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.character import Bones, Surface
from addon.core.errors import InputError, counted, listed, sentence


def test_flipped_turns_every_polygon_over():
    surface = Surface(np.zeros((7, 3)), np.array([3, 4], np.int32), np.array([0, 1, 2, 3, 4, 5, 6], np.int32))
    assert surface.flipped().loop_indices.tolist() == [2, 1, 0, 6, 5, 4, 3]
    assert surface.flipped().flipped().loop_indices.tolist() == surface.loop_indices.tolist()


def test_surface_without_faces_is_named():
    empty = np.empty(0, np.int32)
    with pytest.raises(InputError, match=r"^'Body' has 1 vertex and no faces\.$"):
        Surface(np.zeros((1, 3)), empty, empty).check("Body")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_coordinate_that_is_not_finite_is_named(value):
    vertices = np.zeros((4, 3))
    vertices[2, 1] = value
    surface = Surface(vertices, np.array([3], np.int32), np.array([0, 1, 2], np.int32))
    with pytest.raises(InputError, match="first is vertex 2"):
        surface.check("Body")


def bones(parents):
    count = len(parents)
    names = tuple(f"bone{i}" for i in range(count))
    return Bones(names, np.zeros((count, 3)), np.ones((count, 3)), np.array(parents, np.int32))


@given(st.lists(st.tuples(st.integers(-1, 10), st.booleans()), min_size=1, max_size=11))
def test_subset_keeps_the_nearest_kept_ancestor(drawn):
    parents = [min(parent, i - 1) for i, (parent, _) in enumerate(drawn)]
    kept = [i for i, (_, keep) in enumerate(drawn) if keep]
    subset = bones(parents).subset(kept)
    assert subset.names == tuple(f"bone{i}" for i in kept)
    for i, bone in enumerate(kept):
        ancestors = []
        while (bone := parents[bone]) >= 0:
            ancestors.append(bone)
        expected = next((kept.index(a) for a in ancestors if a in kept), -1)
        assert subset.parents[i] == expected


def test_bones_without_any_or_not_finite():
    with pytest.raises(InputError, match="'Rig' has no deforming bone"):
        bones([]).check("Rig")
    broken = bones([-1, 0])
    broken.tails[1, 2] = np.nan
    with pytest.raises(InputError, match="not finite at 'bone1'"):
        broken.check("Rig")


def test_words():
    assert listed(["a", "b"]) == "'a', 'b'"
    assert listed([str(i) for i in range(10)], limit=2) == "'0', '1' and 8 more"
    assert counted(1, "vertex", "vertices") == "1 vertex"
    assert counted(1234, "bone") == "1,234 bones"
    assert sentence("no such bone ") == "No such bone."
    assert sentence("Done.") == "Done."
