"""Whatever the mesh, a retarget gives valid weights or a typed error, never a crash."""

import numpy as np
import pytest
from dermis_native import BiharmonicDistance, DermisError, Skeleton, SkinWeights, TriangleMesh, retarget_weights
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from surfaces import bad_meshes, torus


def chain():
    heads = np.array([[-2.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    return Skeleton(heads, heads + np.array([1.0, 0, 0]), [-1, 0, 1])


def source():
    vertices, triangles = torus(16, 10)
    near = np.exp(-np.linalg.norm(vertices[:, None] - chain().heads, axis=2))
    return TriangleMesh(vertices, triangles), SkinWeights.from_dense(near / near.sum(axis=1, keepdims=True))


def retargeted(target):
    mesh, weights = source()
    return retarget_weights(mesh, weights, target, source_skeleton=chain(), target_skeleton=chain(), eigenpairs=20)


def assert_valid(result, target):
    dense = result.weights.to_dense()
    assert dense.shape == (len(target.vertices), 3)
    assert (dense >= 0).all()
    assert np.abs(dense.sum(axis=1, dtype=float) - 1).max() <= 1e-6
    assert (result.correspondence >= 0).all()


@pytest.mark.parametrize(("name", "vertices", "triangles"), list(bad_meshes()))
def test_bad_meshes_get_valid_weights(name, vertices, triangles):
    assert name
    target = TriangleMesh(vertices, triangles)
    assert_valid(retargeted(target), target)


# Few different coordinates: coincident vertices, zero areas and flat pieces are then common.
coordinates = st.sampled_from([-2.0, -1.0, 0.0, 1e-9, 0.5, 1.0, 3.0])


@settings(max_examples=150, deadline=None)
@given(hnp.arrays(float, (9, 3), elements=coordinates), hnp.arrays(np.int64, (14, 3), elements=st.integers(0, 8)))
def test_any_triangle_soup(vertices, triangles):
    target = TriangleMesh(vertices, triangles)
    try:
        result = retargeted(target)
    except (ValueError, DermisError):
        return
    assert_valid(result, target)


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(float, (9, 3), elements=coordinates), hnp.arrays(np.int64, (14, 3), elements=st.integers(0, 8)))
def test_distances_on_any_triangle_soup(vertices, triangles):
    try:
        distance = BiharmonicDistance(TriangleMesh(vertices, triangles), eigenpairs=5)
    except (ValueError, DermisError):
        return
    columns = np.stack([distance.from_vertex(i) for i in range(9)])
    assert not np.isnan(columns).any()
    assert (columns >= 0).all()
    assert (np.diag(columns) == 0).all()
    assert (np.isinf(columns) == np.isinf(columns.T)).all()


def test_ten_thousand_specks_follow_the_body():
    vertices, triangles = torus(20, 12)
    random = np.random.default_rng(0)
    centres = random.normal(size=(10_000, 1, 3)) * 2
    specks = (centres + 0.01 * random.normal(size=(10_000, 3, 3))).reshape(-1, 3)
    target = TriangleMesh(
        np.concatenate([vertices, specks]),
        np.concatenate([triangles, len(vertices) + np.arange(30_000).reshape(-1, 3)]),
    )
    result = retargeted(target)
    assert_valid(result, target)
    assert result.matched[: len(vertices)].all()
    assert np.isinf(BiharmonicDistance(target, eigenpairs=10).between([0], [len(vertices)])).all()
