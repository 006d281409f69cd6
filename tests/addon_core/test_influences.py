# SPDX-License-Identifier: GPL-3.0-or-later
"""A limit of influences without jumps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from addon.core.character import BoneWeights
from addon.core.influences import limit_influences

from .conftest import dense


def sparse(matrix):
    vertex, bone = np.nonzero(matrix)
    return BoneWeights(vertex.astype(np.int32), bone.astype(np.int32), matrix[vertex, bone].astype(np.float32))


def limited(matrix, limit):
    matrix = np.atleast_2d(np.asarray(matrix, np.float32))
    return dense(limit_influences(sparse(matrix), np.full(len(matrix), limit, np.int32)), *matrix.shape)


@given(arrays(np.float32, (4, 7), elements=st.floats(0, 1, width=32)), st.integers(1, 8))
def test_limit_and_totals(matrix, limit):
    found = limited(matrix, limit)
    assert ((found > 0).sum(axis=1) <= limit).all()
    np.testing.assert_allclose(found.sum(axis=1), matrix.sum(axis=1), rtol=1e-5, atol=1e-30)
    few = (matrix > 0).sum(axis=1) <= limit
    np.testing.assert_array_equal(found[few], matrix[few])
    # The strongest stay, and none overtakes a stronger one.
    for before, after in zip(matrix, found, strict=True):
        order = np.argsort(-before, kind="stable")
        assert (np.diff(after[order]) <= 1e-6).all()


@pytest.mark.parametrize("limit", [2, 4])
def test_no_jump_where_bones_change_places(limit):
    """Along a path on which weights rise and fall, the result moves no faster than some multiple of the path."""
    t = np.linspace(0, 1, 2001)
    centres = np.linspace(-0.3, 1.3, 9)
    # An odd spacing, so that the strongest bones are never all equal to the first that goes.
    path = np.exp(-(((t[:, None] - centres) / 0.25) ** 2)) + 1e-3
    path[:, ::2] *= 3
    path /= path.sum(axis=1, keepdims=True)
    found = limited(path, limit)
    step = np.abs(np.diff(found, axis=0)).sum(axis=1).max()
    hard = np.where(np.argsort(np.argsort(-path, axis=1), axis=1) < limit, path, 0)
    hard /= hard.sum(axis=1, keepdims=True)
    assert step < 12 * np.abs(np.diff(path, axis=0)).sum(axis=1).max()
    if limit == 4:
        assert np.abs(np.diff(hard, axis=0)).sum(axis=1).max() > 5 * step, "the path does not test anything"


def test_equal_weights_stay_in_equal_shares():
    np.testing.assert_allclose(limited([0.2] * 5, 2), [[0.5, 0.5, 0, 0, 0]])


def test_small_rest_leaves_the_strong_ones_nearly_alone():
    found = limited([0.5, 0.3, 0.19, 0.01], 3)
    np.testing.assert_allclose(found[0, :3], np.array([0.5, 0.3, 0.19]) / 0.99, atol=1e-6)


def test_limits_may_differ_between_vertices():
    matrix = np.array([[0.6, 0.3, 0.1], [0.6, 0.3, 0.1]], np.float32)
    found = dense(limit_influences(sparse(matrix), np.array([1, 3], np.int32)), 2, 3)
    np.testing.assert_allclose(found, [[1, 0, 0], [0.6, 0.3, 0.1]])
