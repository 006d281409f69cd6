# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones are paired by name."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.bones import distances_to_bones, pair_bones
from addon.core.errors import InputError

from .conftest import chain, entries


def test_pairs_are_in_the_order_of_the_target(source, target):
    pairs = pair_bones(source, replace(target, bones=chain("c", "tail", "a", "b"), locked=np.zeros(4, np.bool_)))
    assert pairs.source == (2, 0, 1)
    assert pairs.target == (0, 2, 3)
    assert pairs.only_in_target == ("tail",)


def test_lost_bones_are_listed_on_both_sides(source, target):
    with pytest.raises(InputError, match=r"'NewRig' of 'New' lacks 'b', 'c'.*only 'NewRig' has 'x', 'y'\."):
        pair_bones(source, replace(target, bones=chain("a", "x", "y")))


def test_bone_without_weight_may_be_missing(source, target):
    light = replace(source, weights=entries((0, 0, 1.0), (1, 2, 0.0)))
    assert pair_bones(light, replace(target, bones=chain("a"))).source == (0,)


def test_distances_to_segments():
    points = np.array([[0.5, 0, 0.5], [2.5, 0, 0.25], [0.5, 0, -3.0], [0.5, 4, 4]], np.float64)
    expected = [[0, 0.5], [2, np.hypot(2, 0.75)], [3, 4], [5, np.hypot(4, 2)]]
    np.testing.assert_allclose(distances_to_bones(points, chain("a", "b")), expected)


def test_distance_to_a_bone_without_length():
    point = chain("a")
    point.tails[:] = point.heads
    np.testing.assert_allclose(distances_to_bones(np.array([[0.5, 3, 4]]), point), [[5]])
