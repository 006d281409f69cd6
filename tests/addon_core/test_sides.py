# SPDX-License-Identifier: GPL-3.0-or-later
"""Left and right by name, and the plane between them."""

import numpy as np
import pytest

from addon.core.character import Bones
from addon.core.sides import (
    LEFT,
    MIDDLE,
    RIGHT,
    bone_sides,
    mirror_partners,
    mirrored_name,
    side_of_name,
    symmetry_plane,
)

PAIRS = [
    ("hand.L", "hand.R"), ("hand.l.001", "hand.r.001"), ("hand_l", "hand_r"), ("L_Arm", "R_Arm"),
    ("Bip01 L Thigh", "Bip01 R Thigh"), ("J_Bip_L_UpperArm", "J_Bip_R_UpperArm"), ("thumb_01_l", "thumb_01_r"),
    ("LeftArm", "RightArm"), ("mixamorig:LeftHandIndex1", "mixamorig:RightHandIndex1"),
    ("leftUpperArm", "rightUpperArm"),
    ("armLeft", "armRight"), ("Left_Leg", "Right_Leg"), ("leg-left", "leg-right"), ("lShldr", "rShldr"),
    ("handL", "handR"), ("DEF-forearm.L.002", "DEF-forearm.R.002"), ("左腕", "右腕"), ("LEFT_ARM", "RIGHT_ARM"),
]  # fmt: skip


@pytest.mark.parametrize(("left", "right"), PAIRS)
def test_names_of_pairs(left, right):
    assert (mirrored_name(left), mirrored_name(right)) == (right, left)
    assert (side_of_name(left), side_of_name(right)) == (LEFT, RIGHT)


@pytest.mark.parametrize("name", ["spine", "head", "Root", "lower", "rib", "roll", "Bright", "tail.001", "collar", ""])
def test_names_without_a_side(name):
    assert mirrored_name(name) == name
    assert side_of_name(name) == MIDDLE


def test_a_side_counts_only_with_its_counterpart():
    names = ("hand.L", "hand.R", "strap.L", "spine")
    assert mirror_partners(names).tolist() == [1, 0, -1, 3]
    assert bone_sides(names).tolist() == [LEFT, RIGHT, MIDDLE, MIDDLE]


def test_plane_in_any_orientation():
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    move = np.array([3.0, -2.0, 5.0])
    heads = np.array([[0.2, 0, 1], [-0.2, 0, 1], [0.1, 0, 0.5], [-0.1, 0, 0.5], [0, 0, 1]])
    tails = np.add(heads, [[0.3, 0, 0], [-0.3, 0, 0], [0, 0, -0.4], [0, 0, -0.4], [0, 0, 1]])
    names = ("arm.L", "arm.R", "leg.L", "leg.R", "spine")
    bones = Bones(names, heads @ turn.T + move, tails @ turn.T + move, np.array([4, 4, 4, 4, -1], np.int32))
    plane = symmetry_plane(bones)
    np.testing.assert_allclose(plane.normal, turn[:, 0], atol=1e-12)
    points = rng.normal(size=(10, 3))
    np.testing.assert_allclose(plane.heights(points @ turn.T + move), points[:, 0], atol=1e-12)
    np.testing.assert_allclose(plane.reflected(bones.heads)[:2], bones.heads[[1, 0]], atol=1e-12)


def test_no_plane_without_pairs():
    point = np.zeros((2, 3))
    assert symmetry_plane(Bones(("a", "b"), point, point + 1, np.array([-1, 0], np.int32))) is None
    assert symmetry_plane(Bones(("a.L", "a.R"), point, point + 1, np.array([-1, 0], np.int32))) is None
