# SPDX-License-Identifier: GPL-3.0-or-later
"""Transforms in the solver's space."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from addon.core.pose import affine_inverse, conjugated, settled

numbers = st.floats(-3, 3, width=32)


def affine(linear, origin):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, origin
    return matrix


matrices = st.builds(affine, arrays(np.float64, (3, 3), elements=numbers), arrays(np.float64, 3, elements=numbers))
placements = matrices.filter(lambda m: abs(np.linalg.det(m)) > 0.1)


@given(placements)
def test_inverse(matrix):
    np.testing.assert_allclose(affine_inverse(matrix), np.linalg.inv(matrix), atol=1e-9, rtol=1e-9)


def test_flat_matrix_has_no_inverse():
    with pytest.raises(ZeroDivisionError):
        affine_inverse(affine(np.diag([1.0, 0.0, 1.0]), np.zeros(3)))


@given(placements, st.lists(matrices, min_size=1, max_size=3))
def test_points_go_the_same_way_in_both_spaces(to_solver, deltas):
    deltas = np.array(deltas)
    point = np.array([0.3, -0.2, 0.5, 1.0])
    moved = to_solver @ deltas @ point[:, None]
    also = conjugated(deltas, to_solver) @ to_solver @ point[:, None]
    np.testing.assert_allclose(also, moved, atol=1e-7)


@given(st.lists(matrices, min_size=1, max_size=3))
def test_in_one_space_transforms_stay(deltas):
    np.testing.assert_array_equal(conjugated(np.array(deltas), np.eye(4)), deltas)


@given(placements)
def test_bones_at_rest_give_the_exact_identity(to_solver):
    np.testing.assert_array_equal(conjugated(np.stack([np.eye(4)] * 3), to_solver), [np.eye(4)] * 3)


@given(placements)
def test_rounding_settles_and_motion_does_not(matrix):
    assert settled(matrix.astype(np.float32).astype(np.float64), matrix) is matrix
    moved = matrix.copy()
    moved[0, 3] += 1e-3
    assert settled(moved, matrix) is moved
