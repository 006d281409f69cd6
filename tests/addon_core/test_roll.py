# SPDX-License-Identifier: GPL-3.0-or-later
"""Roll axes under the smallest rotation, beside scipy's."""

import numpy as np
from scipy.spatial.transform import Rotation

from addon.core.roll import turned_axes


def unit(random, count):
    vectors = random.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_equals_the_smallest_rotation():
    random = np.random.default_rng(1)
    old, new = unit(random, 200), unit(random, 200)
    axes = np.cross(old, unit(random, 200))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    normal = np.cross(old, new)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    angle = np.arccos(np.clip(np.einsum("nk,nk->n", old, new), -1, 1))
    expected = Rotation.from_rotvec(normal * angle[:, None]).apply(axes)
    found = turned_axes(axes, 3.0 * old, 0.1 * new)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_allclose(np.einsum("nk,nk->n", found, new), 0, atol=1e-9)


def test_small_turns_and_none():
    axes = np.array([[1.0, 0, 0]] * 2)
    before = np.array([[0.0, 0, 1]] * 2)
    after = np.array([[0.0, 0, 2], [1e-9, 0, 1]])
    np.testing.assert_allclose(turned_axes(axes, before, after), [[1, 0, 0], [1, 0, -1e-9]], atol=1e-15)


def test_opposite_directions_turn_about_the_axis():
    axes = np.array([[1.0, 0, 0], [0.6, 0.8, 0]])
    before = np.array([[0.0, 0, 1], [0, 0, 2]])
    np.testing.assert_array_equal(turned_axes(axes, before, -before), axes)


def test_directions_without_length_change_nothing():
    axes = np.array([[1.0, 0, 0]])
    none, some = np.zeros((1, 3)), np.array([[0.0, 1, 0]])
    np.testing.assert_array_equal(turned_axes(axes, none, some), axes)
    np.testing.assert_array_equal(turned_axes(axes, some, none), axes)
