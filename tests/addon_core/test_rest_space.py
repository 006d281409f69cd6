# SPDX-License-Identifier: GPL-3.0-or-later
"""Offsets taken back before a masked skinning."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from addon.core.rest_space import SINGULAR, shared_rest_space_offsets

VERTICES = 5
numbers = st.floats(-2, 2, width=32)


@given(
    arrays(np.float32, (VERTICES, 3), elements=numbers),
    arrays(np.float64, (VERTICES, 3, 3), elements=numbers),
    arrays(np.float32, VERTICES, elements=st.floats(0, 1, width=32)),
)
def test_skinning_turns_them_into_what_was_wanted(wanted, matrices, shares):
    offsets, limited = shared_rest_space_offsets(wanted, matrices, shares)
    assert np.isfinite(offsets).all()
    share = shares[:, None, None].astype(np.float64)
    blended = (1 - share) * np.eye(3) + share * matrices
    singular = np.linalg.svd(blended)[1]
    regular = singular[:, 2] > 1.01 * SINGULAR * singular[:, 0]
    reached = np.einsum("nij,nj->ni", blended, offsets)
    # Offsets are float32 and may be a hundred times what is wanted.
    np.testing.assert_allclose(reached[regular], wanted[regular], atol=1e-4)
    assert limited <= np.count_nonzero(~regular)


def test_no_share_keeps_the_bits():
    wanted = np.array([[0.1, 0.2, 0.3]], np.float32)
    offsets, limited = shared_rest_space_offsets(wanted, np.zeros((1, 3, 3)), np.zeros(1, np.float32))
    np.testing.assert_allclose(offsets, wanted, rtol=1e-6)
    assert limited == 0


@pytest.mark.parametrize("least", [0.0, 1e-9, 0.5 * SINGULAR, 0.999 * SINGULAR])
def test_flat_matrices_are_limited_and_counted(least):
    wanted = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]], np.float32)
    matrices = np.stack([np.diag([1.0, 1.0, least])] * 2)
    offsets, limited = shared_rest_space_offsets(wanted, matrices, np.ones(2, np.float32))
    assert limited == 1, "a vertex that does not move is not counted"
    assert 0 <= offsets[0, 2] <= 1 / SINGULAR
    assert not offsets[1].any()
