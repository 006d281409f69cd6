# SPDX-License-Identifier: GPL-3.0-or-later
"""Fingers that follow other fingers."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.character import Bones, BoneWeights
from addon.core.check_fingers import bleeding_fingers, find_hands

FINGERS = ("index", "middle", "ring", "pinky")


def hand_bones(names=FINGERS):
    """A hand along x with four fingers of three bones, 0.4 apart."""
    all_names, heads, tails, parents = ["hand"], [(0, 0.6, 0)], [(1, 0.6, 0)], [-1]
    for finger, name in enumerate(names):
        for link in range(3):
            all_names.append(f"{name}_{link + 1:02}")
            heads.append((1 + link, 0.4 * finger, 0))
            tails.append((2 + link, 0.4 * finger, 0))
            parents.append(0 if link == 0 else len(all_names) - 2)
    return Bones(tuple(all_names), np.array(heads, float), np.array(tails, float), np.array(parents, np.int32))


def points_and_weights():
    """Points around every finger, each on its own nearest bone."""
    along, finger, around = np.meshgrid(np.arange(1.05, 4, 0.1), np.arange(4), np.arange(6), indexing="ij")
    angle = around * np.pi / 3
    points = np.stack([along, 0.4 * finger + 0.15 * np.cos(angle), 0.15 * np.sin(angle)], axis=-1).reshape(-1, 3)
    link = np.minimum(along.ravel().astype(int) - 1, 2)
    bone = (1 + 3 * finger.ravel() + link).astype(np.int32)
    return (
        points,
        finger.ravel(),
        BoneWeights(np.arange(len(points), dtype=np.int32), bone, np.ones(len(bone), np.float32)),
    )


def test_hand_is_found():
    (hand,) = find_hands(hand_bones())
    assert hand.bone == 0
    assert hand.fingers == ((1, 2, 3), (4, 5, 6), (7, 8, 9), (10, 11, 12))


def test_hand_without_names_is_found_by_its_size():
    plain = hand_bones(("a", "b", "c", "d"))
    assert find_hands(plain) == []  # nothing but a hand: its fingers are as long as the skeleton
    far = Bones(
        (*plain.names, "root"),
        np.vstack([plain.heads, (-40, 0, 0)]),
        np.vstack([plain.tails, (-39, 0, 0)]),
        np.append(plain.parents, -1).astype(np.int32),
    )
    assert [hand.bone for hand in find_hands(far)] == [0]


def test_legs_and_a_tail_are_no_fingers():
    names = ("hips", *(f"{limb}{i}" for limb in ("legL", "legR", "tail") for i in range(3)))
    heads = np.array([(0, 0, 0), *((limb, 0, -i) for limb in range(3) for i in range(3))], float)
    parents = np.array([-1, 0, 1, 2, 0, 4, 5, 0, 7, 8], np.int32)
    assert find_hands(Bones(names, heads, heads + 0.5, parents)) == []


def test_good_fingers():
    points, _, weights = points_and_weights()
    assert not bleeding_fingers(points, hand_bones(), weights).any()


def test_finger_that_follows_its_neighbour():
    points, finger, weights = points_and_weights()
    wrong = (finger == 1) & (points[:, 0] > 2)
    shifted = replace(weights, bone=np.where(wrong, weights.bone + 3, weights.bone).astype(np.int32))
    np.testing.assert_array_equal(bleeding_fingers(points, hand_bones(), shifted), wrong)


@pytest.mark.parametrize("amount", [0.05, 0.3])
def test_two_fingers_on_one_vertex(amount):
    points, finger, weights = points_and_weights()
    mixed = (finger == 2) & (points[:, 0] > 2.5)
    vertex = np.flatnonzero(mixed).astype(np.int32)
    value = np.where(mixed, 1 - amount, 1).astype(np.float32)
    both = BoneWeights(
        np.concatenate([weights.vertex, vertex]),
        np.concatenate([weights.bone, weights.bone[vertex] - 3]).astype(np.int32),
        np.concatenate([value, np.full(len(vertex), amount, np.float32)]),
    )
    found = bleeding_fingers(points, hand_bones(), both)
    np.testing.assert_array_equal(found, mixed if amount > 0.1 else np.zeros(len(points), bool))


def test_near_the_palm_fingers_share():
    points, finger, weights = points_and_weights()
    near = (finger == 0) & (points[:, 0] < 1.5)
    shifted = replace(weights, bone=np.where(near, weights.bone + 3, weights.bone).astype(np.int32))
    assert not bleeding_fingers(points, hand_bones(), shifted).any()
