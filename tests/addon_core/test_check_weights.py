# SPDX-License-Identifier: GPL-3.0-or-later
"""Missing weights, wrong totals, too many influences."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from addon.core.check_weights import too_many, unweighted, wrong_totals

from .conftest import entries
from .test_influences import sparse


def test_each_fault_is_its_own():
    weights = entries((1, 0, 0.5), (1, 1, 0.5), (2, 0, 0.7), (3, 0, 1.2), (4, 0, 0.0))
    assert unweighted(weights, 5).tolist() == [True, False, False, False, True]
    assert wrong_totals(weights, 5).tolist() == [False, False, True, True, False]
    assert too_many(weights, 5, 1).tolist() == [False, True, False, False, False]
    assert not too_many(weights, 5, 2).any()


@given(arrays(np.float32, (5, 6), elements=st.floats(0, 1, width=32)), st.integers(1, 6))
def test_against_dense_counts(matrix, limit):
    weights = sparse(matrix)
    np.testing.assert_array_equal(too_many(weights, 5, limit), (matrix > 0).sum(axis=1) > limit)
    np.testing.assert_array_equal(unweighted(weights, 5), matrix.sum(axis=1) == 0)
