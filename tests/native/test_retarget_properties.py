"""What does not change a retarget: the order of vertices and bones, place, direction and size."""

from functools import cache

import numpy as np
import pytest
from dermis_native import Skeleton, SkinWeights, TriangleMesh, retarget_weights
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from surfaces import adult, child

METHODS = ("auto", "paper")
TOLERANCE = 1e-4
# Share of vertices that may go either way: two matches are equally good up to rounding.
UNDECIDED = 0.005
# Roughness of the surfaces in metres: on a perfectly symmetric body the vertices in the middle lie on
# the border of two regions, and rounding would decide on which side.
ROUGHNESS = 1e-3

seeds = st.integers(0, 2**32 - 1)
scales = st.floats(-2, 2).map(lambda power: 10.0**power)


@cache
def characters():
    """Source and target, each as vertices, triangles, heads, tails, parents, names and weights."""
    rough = np.random.default_rng(0).normal(size=(2000, 3)) * ROUGHNESS
    return tuple(
        (
            mesh.vertices + rough[: len(mesh.vertices)],
            mesh.triangles,
            s.heads,
            s.tails,
            s.parents,
            tuple(s.names),
            weights,
        )
        for mesh, s, weights in (adult(1200), child(1200))
    )


def retargeted(source, target, method, **options):
    """Dense weights of the target."""
    skeletons = [
        Skeleton(heads, tails, parents, list(names)) for _, _, heads, tails, parents, names, _ in (source, target)
    ]
    result = retarget_weights(
        TriangleMesh(source[0], source[1]),
        SkinWeights.from_dense(source[6]),
        TriangleMesh(target[0], target[1]),
        source_skeleton=skeletons[0],
        target_skeleton=skeletons[1],
        method=method,
        **options,
    )
    return result.weights.to_dense()


@cache
def plain(method):
    return retargeted(*characters(), method)


def assert_equal(found, expected):
    difference = np.abs(found - expected).sum(axis=1)
    assert (difference > TOLERANCE).mean() <= UNDECIDED, difference.max()


def moved(character, seed, scale):
    """The character turned, moved and scaled."""
    random = np.random.default_rng(seed)
    turn, offset = Rotation.random(random_state=random).as_matrix(), random.normal(size=3)
    place = lambda points: scale * (points @ turn.T + offset)  # noqa: E731
    vertices, triangles, heads, tails, *rest = character
    return place(vertices), triangles, place(heads), place(tails), *rest


def renumbered(character, seed):
    """The character with vertices, triangles and their first corners in another order, and that order."""
    random = np.random.default_rng(seed)
    vertices, triangles, *rest, weights = character
    order = random.permutation(len(vertices))
    corners = np.argsort(order)[triangles[random.permutation(len(triangles))]]
    corners = np.take_along_axis(corners, (random.integers(0, 3, (len(corners), 1)) + np.arange(3)) % 3, axis=1)
    return (vertices[order], corners, *rest, weights[order]), order


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=6, deadline=None)
@given(seeds, scales)
def test_a_target_elsewhere(method, seed, scale):
    source, target = characters()
    assert_equal(retargeted(source, moved(target, seed, scale), method), plain(method))


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=4, deadline=None)
@given(seeds, scales)
def test_a_source_elsewhere(method, seed, scale):
    source, target = characters()
    assert_equal(retargeted(moved(source, seed, scale), target, method), plain(method))


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=5, deadline=None)
@given(seeds)
def test_vertices_in_another_order(method, seed):
    source, target = characters()
    shuffled, order = renumbered(target, seed)
    assert_equal(retargeted(source, shuffled, method), plain(method)[order])
    shuffled, _ = renumbered(source, seed)
    assert_equal(retargeted(shuffled, target, method), plain(method))


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=4, deadline=None)
@given(seeds)
def test_bones_in_another_order(method, seed):
    source, (vertices, triangles, heads, tails, parents, names, weights) = characters()
    order = np.random.default_rng(seed).permutation(len(parents))
    place = np.append(np.argsort(order), -1)
    shuffled = (
        vertices,
        triangles,
        heads[order],
        tails[order],
        place[parents[order]],
        tuple(names[bone] for bone in order),
        weights[:, order],
    )
    assert_equal(retargeted(source, shuffled, method), plain(method)[:, order])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_a_hundred_times_the_size(method, scale):
    source, target = characters()
    vertices, triangles, heads, tails, *rest = target
    scaled = (scale * vertices, triangles, scale * heads, scale * tails, *rest)
    assert_equal(retargeted(source, scaled, method), plain(method))


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=5, deadline=None)
@given(seeds, st.integers(1, 5))
def test_totals_and_limits(method, seed, limit):
    (*body, weights), target = characters()
    # Source rows of any sum, some of them empty.
    random = np.random.default_rng(seed)
    painted = weights * random.uniform(0.1, 3.0, (len(weights), 1)) * (random.random((len(weights), 1)) < 0.9)
    found = retargeted((*body, painted), target, method, max_influences=limit)
    assert (found >= 0).all()
    assert np.abs(found.sum(axis=1, dtype=float) - 1).max() <= 1e-6
    assert np.count_nonzero(found, axis=1).max() <= limit
