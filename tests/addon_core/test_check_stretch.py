# SPDX-License-Identifier: GPL-3.0-or-later
"""The range-of-motion test against linear blend skinning of the native module."""

import numpy as np
import pytest

from addon.core.character import Bones, BoneWeights
from addon.core.check_stretch import range_of_motion, surface_edges

from .conftest import chain, strip

native = pytest.importorskip("dermis_native")

ROWS = 13


def smooth_weights(surface, falloff=1.0):
    """Partition of unity over three bones stacked along z."""
    z = surface.vertices[:, 2]
    dense = np.exp(-(((z[:, None] - (0.5, 1.5, 2.5)) / falloff) ** 2))
    dense /= dense.sum(axis=1, keepdims=True)
    vertex, bone = np.nonzero(dense)
    return BoneWeights(vertex.astype(np.int32), bone.astype(np.int32), dense[vertex, bone].astype(np.float32)), dense


def test_edges_of_polygons():
    edges = surface_edges(strip(2, 3))
    assert edges.tolist() == [[0, 1], [0, 2], [1, 3], [2, 3], [2, 4], [3, 5], [4, 5]]


@pytest.mark.parametrize("degrees", [45.0, 90.0])
def test_ratios_are_those_of_linear_blend_skinning(degrees):
    surface, bones = strip(3, ROWS), chain("a", "b", "c")
    weights, dense = smooth_weights(surface)
    found = range_of_motion(surface, bones, weights, degrees)
    skin = native.SkinWeights.from_dense(dense.astype(np.float32))
    edges = found.edges
    rest = np.linalg.norm(surface.vertices[edges[:, 0]] - surface.vertices[edges[:, 1]], axis=1)
    worst = np.ones(len(edges))
    for joint in range(3):
        # The bones stand along z, so any two axes across them reach the same ratios only in a symmetric
        # set; the test takes the axes of the strip itself, which are those that the test chooses.
        for axis in np.eye(3):
            for sign in (1, -1):
                matrix = np.eye(4)
                k = np.cross(np.eye(3), axis)
                angle = sign * np.deg2rad(degrees)
                turn = np.eye(3) + np.sin(angle) * k.T + (1 - np.cos(angle)) * (k @ k)
                head = bones.heads[joint]
                matrix[:3, :3], matrix[:3, 3] = turn, head - turn @ head
                transforms = np.stack([matrix if bone >= joint else np.eye(4) for bone in range(3)])
                moved = native.linear_blend_skinning(surface.vertices, skin, transforms).astype(float)
                length = np.linalg.norm(moved[edges[:, 0]] - moved[edges[:, 1]], axis=1)
                worst = np.maximum(worst, length / rest)
    np.testing.assert_allclose(found.ratio, worst, atol=1e-4)


def test_vertex_bound_to_a_far_bone():
    surface, bones = strip(3, ROWS), chain("a", "b", "c")
    weights, _ = smooth_weights(surface, falloff=1.5)
    assert not (range_of_motion(surface, bones, weights, 45).ratio > 2).any()
    bad = 4  # near the foot of the strip, on the bone at its top
    kept = weights.where(weights.vertex != bad)
    wrong = BoneWeights(
        np.append(kept.vertex, bad).astype(np.int32), np.append(kept.bone, 2).astype(np.int32),
        np.append(kept.value, 1).astype(np.float32),
    )  # fmt: skip
    found = range_of_motion(surface, bones, wrong, 45)
    over = found.ratio > 2
    assert over.any()
    assert (found.edges[over] == bad).any(axis=1).all()
    assert set(found.joint[over].tolist()) <= {1, 2}


def test_a_vertex_left_behind_stretches():
    surface, bones = strip(3, ROWS), chain("a", "b", "c")
    weights, _ = smooth_weights(surface, falloff=1.5)
    found = range_of_motion(surface, bones, weights.where(weights.vertex != 21), 45)
    assert ((found.ratio > 2) == (found.edges == 21).any(axis=1))[found.ratio > 2].all()
    assert (found.ratio > 2).any()


def test_rigid_and_scaled_bodies_have_the_same_ratios():
    surface, bones = strip(3, ROWS), chain("a", "b", "c")
    weights, _ = smooth_weights(surface)
    plain = range_of_motion(surface, bones, weights, 60)
    big = Bones(bones.names, bones.heads * 100, bones.tails * 100, bones.parents)
    scaled = range_of_motion(
        type(surface)(surface.vertices * 100, surface.loop_counts, surface.loop_indices), big, weights, 60
    )
    np.testing.assert_allclose(scaled.ratio, plain.ratio, rtol=1e-9)


def test_step_can_end_it():
    surface = strip(3, ROWS)

    def step(_share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        range_of_motion(surface, chain("a", "b", "c"), smooth_weights(surface)[0], 45, step)
