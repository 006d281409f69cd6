# SPDX-License-Identifier: GPL-3.0-or-later
"""Coincident vertices at open edges."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from addon.core.character import Surface
from addon.core.seams import close_seams, coincident, open_vertices

from .conftest import dense, entries, strip


def grid(columns, rows, origin=(0, 0, 0)):
    """Quads over a grid of vertices in the plane y = 0."""
    x, z = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1) + origin
    width = columns + 1
    corners = [
        (r * width + c, r * width + c + 1, (r + 1) * width + c + 1, (r + 1) * width + c)
        for r in range(rows)
        for c in range(columns)
    ]
    return Surface(vertices, np.full(len(corners), 4, np.int32), np.array(corners, np.int32).ravel())


def test_open_vertices():
    marked = open_vertices(grid(3, 3)).reshape(4, 4)
    inside = np.zeros((4, 4), bool)
    inside[1:3, 1:3] = True
    np.testing.assert_array_equal(marked, ~inside)


def test_vertices_of_no_face_are_open():
    surface = strip(1, 2)
    loose = Surface(np.vstack([surface.vertices, (9, 9, 9)]), surface.loop_counts, surface.loop_indices)
    assert open_vertices(loose).tolist() == [True] * 5


@given(st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=1, max_size=30), st.floats(0.01, 0.3), st.integers(0, 9))
def test_coincident_groups_are_those_of_the_lattice(points, jitter, seed):
    """Points of a lattice with a jitter much smaller than its width."""
    lattice = np.array(points, float)
    noise = np.random.default_rng(seed).uniform(-0.5, 0.5, lattice.shape) * jitter
    label = coincident(lattice + noise, jitter)
    _, expected = np.unique(lattice, axis=0, return_inverse=True)
    expected = expected.ravel()
    assert ((label[:, None] == label) == (expected[:, None] == expected)).all()


def test_mean_on_the_seam_and_nothing_elsewhere():
    first, second = grid(2, 1), grid(2, 1, origin=(2, 0, 0))
    low = entries(*((v, 0, 1.0) for v in range(6)))
    high = entries(*((v, 1, 1.0) for v in range(6)))
    (one, other), counts = close_seams([first, second], [low, high], [("a", "b"), ("b", "a")])
    assert counts == [2, 2]
    np.testing.assert_array_equal(dense(one, 6, 2), dense(low, 6, 2))
    np.testing.assert_array_equal(dense(other, 6, 2), dense(high, 6, 2))
    (one, other), _ = close_seams([first, second], [low, high], [("a", "b"), ("a", "b")])
    assert dense(one, 6, 2)[[2, 5]].tolist() == [[0.5, 0.5]] * 2
    assert dense(other, 6, 2)[[0, 3]].tolist() == [[0.5, 0.5]] * 2
    assert dense(one, 6, 2)[[0, 1, 3, 4]].tolist() == [[1, 0]] * 4


def test_cut_inside_one_object():
    surface = strip(1, 2)
    doubled = Surface(
        np.vstack([surface.vertices, np.add(surface.vertices, (0, 0, 1))]),
        np.full(2, 4, np.int32),
        np.concatenate([surface.loop_indices, surface.loop_indices + 4]),
    )
    weights = entries(*((v, int(v >= 4), 1.0) for v in range(8)))
    (found,), counts = close_seams([doubled], [weights], [("a", "b")])
    assert counts == [4]
    assert dense(found, 8, 2)[2:6].tolist() == [[0.5, 0.5]] * 4


def test_bones_that_one_object_lacks():
    first, second = grid(1, 1), grid(1, 1, origin=(1, 0, 0))
    low = entries(*((v, 0, 1.0) for v in range(4)))
    (one, other), _ = close_seams([first, second], [low, low], [("a",), ("b", "a")])
    assert dense(one, 4, 1).tolist() == [[1], [0.5], [1], [0.5]]
    assert dense(other, 4, 2).tolist() == [[0.5, 0.5], [1, 0], [0.5, 0.5], [1, 0]]


def test_no_seam_leaves_everything():
    weights = entries((0, 0, 1.0), (1, 0, 0.5))
    (found,), counts = close_seams([grid(2, 2)], [weights], [("a",)])
    assert counts == [0]
    assert found is weights
