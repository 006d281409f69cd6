# SPDX-License-Identifier: GPL-3.0-or-later
"""The mirrored source, and targets whose halves come from one side."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.character import Bones, Source, Target
from addon.core.errors import InputError
from addon.core.mirror import blended, left_shares, mirrored_source

from .conftest import dense, entries
from .test_seams import grid

NAMES = ("spine", "arm.L", "hand.L", "arm.R", "hand.R")
HEADS = np.array([[0, 0, 0], [0.5, 0, 1], [1.5, 0, 1], [-0.5, 0, 1], [-1.5, 0, 1]], float)
TAILS = np.array([[0, 0, 1], [1.5, 0, 1], [2.5, 0, 1.2], [-1.5, 0, 1], [-2.5, 0, 1.2]], float)
BONES = Bones(NAMES, HEADS, TAILS, np.array([-1, 0, 1, 0, 3], np.int32))


def body(weights):
    return Source("Old", "Rig", grid(6, 1, origin=(-3, 0, 0)), BONES, weights)


def test_left_becomes_right():
    source = body(entries((13, 2, 1.0), (7, 3, 0.5), (3, 0, 1.0)))
    mirrored = mirrored_source(source)
    assert mirrored.bones.names == NAMES
    np.testing.assert_allclose(mirrored.bones.tails[4], (-2.5, 0, 1.2), atol=1e-12)
    assert mirrored.bones.parents.tolist() == [-1, 0, 1, 0, 3]
    np.testing.assert_allclose(mirrored.surface.vertices[:, 0], -source.surface.vertices[:, 0], atol=1e-12)
    assert dense(mirrored.weights, 14, 5)[13].tolist() == [0, 0, 0, 0, 1]
    assert dense(mirrored.weights, 14, 5)[7].tolist() == [0, 0.5, 0, 0, 0]


def test_twice_is_the_source_again():
    source = replace(body(entries((13, 2, 1.0), (7, 3, 0.5))), boneless_groups=("Glove.L", "Glove.R", "Hat"),
                     boneless=entries((1, 0, 0.5), (2, 2, 1.0)))  # fmt: skip
    once = mirrored_source(source)
    assert once.boneless.bone.tolist() == [1, 2]
    twice = mirrored_source(once)
    np.testing.assert_allclose(twice.surface.vertices, source.surface.vertices, atol=1e-12)
    np.testing.assert_array_equal(twice.surface.loop_indices, source.surface.loop_indices)
    np.testing.assert_allclose(twice.bones.tails, TAILS, atol=1e-12)
    np.testing.assert_array_equal(twice.weights.bone, source.weights.bone)


def test_mirror_needs_sides():
    plain = replace(BONES, names=("a", "b", "c", "d", "e"))
    with pytest.raises(InputError, match="'Rig' has no bones that are named left and right"):
        mirrored_source(replace(body(entries((0, 0, 1.0))), bones=plain))
    odd = replace(BONES, names=("spine", "arm.L", "strap.L", "arm.R", "hand.R"))
    with pytest.raises(InputError, match=r"no counterpart on the other side: 'strap\.L'\."):
        mirrored_source(replace(body(entries((0, 2, 1.0))), bones=odd))
    assert mirrored_source(replace(body(entries((0, 0, 1.0))), bones=odd)).bones.names == odd.names


def test_shares_of_the_left_half():
    target = Target("New", "Rig", grid(6, 1, origin=(-3, 0, 0)), BONES, entries(), np.zeros(5, np.bool_))
    assert left_shares(target).tolist() == [0, 0, 0, 0.5, 1, 1, 1] * 2


def test_blended_weights():
    first, second = entries((0, 0, 1.0), (1, 0, 1.0)), entries((0, 0, 0.5), (0, 1, 0.5), (1, 1, 1.0))
    found = dense(blended(first, second, np.array([0.5, 1.0])), 2, 2)
    assert found.tolist() == [[0.75, 0.25], [1, 0]]
