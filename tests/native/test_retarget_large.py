"""Large meshes, of which only samples take part in the fits: as good as small ones, and as independent of order, place,
size and threads.
"""

from dataclasses import replace
from functools import cache

import characters
import makehuman
import numpy as np
import threads
from dermis_native import retarget_weights
from scipy.spatial.transform import Rotation

TRIANGLES = 46_000  # 23,000 vertices: more than are taken whole
# As in test_retarget_properties: a perfectly symmetric body has vertices that may go either way, rough ones have few.
ROUGHNESS = 3e-4
TOLERANCE = 1e-4
UNDECIDED = 0.005


def large(name, macro):
    it = characters.refined(characters.body(name, **macro), TRIANGLES)
    rough = np.random.default_rng(0).normal(size=it.vertices.shape) * ROUGHNESS
    return replace(it, vertices=it.vertices + rough)


@cache
def pair():
    return large("male", makehuman.YOUNG_MALE), characters.with_joint_errors(large("child", makehuman.CHILD))


@cache
def found():
    return retargeted(*pair())


def retargeted(source, target):
    return retarget_weights(
        characters.mesh_of(source),
        characters.weights_of(source),
        characters.mesh_of(target),
        source_skeleton=characters.skeleton_of(source),
        target_skeleton=characters.skeleton_of(target),
    ).weights.to_dense()


def assert_alike(first, second):
    difference = np.abs(first - second).sum(axis=1)
    assert (difference > TOLERANCE).mean() <= UNDECIDED, np.sort(difference)[-20:]


def test_samples_are_as_good_as_all_points():
    source, target = pair()
    assert min(len(source.vertices), len(target.vertices)) > 20_000
    assert characters.l1_error(found(), target.weights).mean() <= 0.16


def test_the_order_of_vertices_does_not_matter():
    source, target = pair()
    orders = [np.random.default_rng(seed).permutation(len(it.vertices)) for seed, it in enumerate(pair())]
    again = retargeted(*(reordered(it, order) for it, order in zip((source, target), orders, strict=True)))
    assert_alike(found()[orders[1]], again)


def reordered(it, order):
    """The character with vertex order[i] as its vertex i."""
    place = np.argsort(order)
    return replace(it, vertices=it.vertices[order], loop_indices=place[it.loop_indices], weights=it.weights[order])


def test_place_direction_and_size_do_not_matter():
    def moved(it, scale, turn, shift):
        rotation = Rotation.from_rotvec(turn).as_matrix()
        carry = lambda points: scale * points @ rotation.T + shift  # noqa: E731
        return replace(it, vertices=carry(it.vertices), heads=carry(it.heads), tails=carry(it.tails))

    source, target = pair()
    again = retargeted(moved(source, 30.0, [0.3, 1.0, -0.4], [3.0, 1.0, 0.0]), moved(target, 0.1, [1.0, 0.2, 0.5], 5.0))
    assert_alike(found(), again)


def test_the_same_bits_on_any_number_of_threads():
    program = "import test_retarget_large as t; found = (t.retargeted(*t.pair()),)"
    assert threads.digests(program, 1, 3) == {threads.digest(found())}
