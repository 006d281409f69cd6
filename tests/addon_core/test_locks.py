# SPDX-License-Identifier: GPL-3.0-or-later
"""New weights beside locked ones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from addon.core.character import Target
from addon.core.errors import InputError
from addon.core.locks import check_totals, merge_weights

from .conftest import chain, dense, entries, strip

ROWS, BONES = 3, 4
VERTICES = 2 * ROWS
unit = st.floats(0, 1, width=32)


def from_dense(matrix):
    vertex, bone = np.nonzero(matrix)
    return entries(*zip(vertex.tolist(), bone.tolist(), matrix[vertex, bone].tolist(), strict=True))


def target_with(existing, locked):
    return Target("New", "Rig", strip(2, ROWS), chain(*"abcd"), from_dense(existing), np.array(locked, np.bool_))


@given(
    new=arrays(np.float32, (VERTICES, BONES), elements=unit),
    existing=arrays(np.float32, (VERTICES, BONES), elements=unit),
    locked=st.lists(st.booleans(), min_size=BONES, max_size=BONES).filter(lambda flags: not all(flags)),
    limit=st.one_of(st.none(), st.integers(1, 5)),
)
def test_totals_limits_and_locks(new, existing, locked, limit):
    new[:, 0] += 0.01
    new /= new.sum(axis=1, keepdims=True)
    target = target_with(existing, locked)
    merged, replaced = merge_weights(from_dense(new), target, max_influences=limit)
    written = dense(merged, VERTICES, BONES)
    assert (written[:, locked] == 0).all(), "locked groups are not written"
    assert (written >= 0).all()
    assert replaced.tolist() == list(range(VERTICES))
    kept = np.where(locked, existing, 0).astype(np.float64)
    totals = kept.sum(axis=1) + written.sum(axis=1)
    np.testing.assert_allclose(totals, np.maximum(kept.sum(axis=1), 1), atol=1.5e-6)
    if limit is not None:
        free = np.maximum(limit - (kept > 0).sum(axis=1), 1)
        assert ((written > 0).sum(axis=1) <= free).all()


def test_without_locks_the_weights_stay():
    new = np.array([[0.25, 0.75, 0, 0]] * VERTICES, np.float32)
    merged, _ = merge_weights(from_dense(new), target_with(np.zeros((VERTICES, BONES)), [False] * BONES))
    np.testing.assert_array_equal(dense(merged, VERTICES, BONES), new)


def test_only_vertices_without_weights():
    existing = np.zeros((VERTICES, BONES), np.float32)
    existing[2, 3] = 0.125
    new = np.array([[1, 0, 0, 0]] * VERTICES, np.float32)
    merged, replaced = merge_weights(from_dense(new), target_with(existing, [False] * BONES), replace=False)
    assert replaced.tolist() == [0, 1, 3, 4, 5]
    assert set(merged.vertex.tolist()) == {0, 1, 3, 4, 5}


def test_share_of_a_locked_bone_goes_to_the_nearest_free_one():
    new = np.zeros((VERTICES, BONES), np.float32)
    new[:, 1] = 1
    merged, _ = merge_weights(from_dense(new), target_with(np.zeros((VERTICES, BONES)), [False, True, False, False]))
    # Rows of the strip are at z = 0, 1 and 2; bone a spans 0 to 1, bone c 2 to 3.
    assert dense(merged, VERTICES, BONES).argmax(axis=1).tolist() == [0, 0, 0, 0, 2, 2]


def test_limit_keeps_the_strongest_and_the_lower_bone_among_equals():
    new = np.array([[0.2, 0.3, 0.3, 0.2]] * VERTICES, np.float32)
    target = target_with(np.zeros((VERTICES, BONES)), [False] * BONES)
    one, _ = merge_weights(from_dense(new), target, max_influences=1)
    assert set(one.bone.tolist()) == {1}
    three, _ = merge_weights(from_dense(new), target, max_influences=3)
    assert set(three.bone.tolist()) == {0, 1, 2}


def test_all_locked():
    with pytest.raises(InputError, match="All bone groups of 'New' are locked"):
        merge_weights(entries(), target_with(np.zeros((VERTICES, BONES)), [True] * BONES))


def test_totals_are_checked():
    check_totals("New", entries((0, 0, 0.5), (0, 1, 0.5), (1, 1, 1.0)), 2)
    with pytest.raises(RuntimeError, match="1 vertex of 'New' got no full weight, the first is vertex 1"):
        check_totals("New", entries((0, 0, 1.0)), 2)
    for value in (np.nan, -0.5, np.inf):
        with pytest.raises(RuntimeError, match="Vertex 1 of 'New' got an impossible weight"):
            check_totals("New", entries((0, 0, 1.0), (1, 0, value)), 2)


def test_target_is_not_changed(target):
    existing = entries((0, 0, 0.5), (1, 1, 0.25))
    locked = replace(target, existing=existing, locked=np.array([True, False, False]))
    before = [array.copy() for array in (existing.vertex, existing.bone, existing.value)]
    merge_weights(entries((0, 1, 1.0)), locked)
    for array, old in zip((existing.vertex, existing.bone, existing.value), before, strict=True):
        np.testing.assert_array_equal(array, old)
