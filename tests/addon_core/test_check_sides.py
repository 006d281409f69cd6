# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights on the other side's bones."""

from dataclasses import replace

import numpy as np

from addon.core.check_sides import wrong_sides
from addon.core.sides import mirrored_name

from .conftest import entries
from .test_mirror import BONES

POINTS = np.array([[2.0, 0, 1], [-2.0, 0, 1], [0.1, 0, 1], [-0.1, 0, 1], [0, 0, 0.5]])


def test_left_hand_on_the_right_hand_bone():
    weights = entries((0, 2, 0.5), (0, 4, 0.5), (1, 4, 1.0), (2, 1, 0.5), (2, 3, 0.5), (3, 3, 1.0), (4, 0, 1.0))
    assert wrong_sides(POINTS, BONES, weights).tolist() == [True, False, False, False, False]


def test_little_weight_and_middle_bones_are_no_fault():
    weights = entries((0, 2, 0.92), (0, 4, 0.08), (1, 0, 1.0))
    assert not wrong_sides(POINTS, BONES, weights).any()


def test_any_orientation_and_either_naming():
    rng = np.random.default_rng(4)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    move = np.array([5.0, 6, 7])
    turned = replace(BONES, heads=BONES.heads @ turn.T + move, tails=BONES.tails @ turn.T + move)
    weights = entries((0, 4, 1.0), (1, 4, 1.0))
    for bones in (turned, replace(turned, names=tuple(map(mirrored_name, BONES.names)))):
        assert wrong_sides(POINTS @ turn.T + move, bones, weights).tolist() == [True, False, False, False, False]


def test_without_sides_nothing_is_said():
    assert wrong_sides(POINTS, replace(BONES, names=("a", "b", "c", "d", "e")), entries((0, 4, 1.0))) is None


def test_bone_that_stands_on_the_other_side_is_left_aside():
    heads, tails = BONES.heads.copy(), BONES.tails.copy()
    heads[4], tails[4] = (1.0, 0, 2), (1.5, 0, 2)  # the right hand crosses over
    crossed = replace(BONES, heads=heads, tails=tails)
    assert not wrong_sides(POINTS, crossed, entries((0, 4, 1.0))).any()
