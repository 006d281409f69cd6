"""Biharmonic distance against the dense spectrum (eq. 17)."""

import algorithm2
import numpy as np
import pytest
from dermis_native import BiharmonicDistance, TriangleMesh
from surfaces import adult, sphere, torus


@pytest.fixture(scope="module")
def body():
    mesh, _, _ = adult(3600)
    return mesh, algorithm2.biharmonic_distances(mesh)


def test_all_pairs_of_a_real_body(body):
    mesh, exact = body
    i, j = np.triu_indices(len(exact), 1)
    error = np.abs(BiharmonicDistance(mesh, eigenpairs=300).between(i, j) / exact[i, j] - 1)
    median, high = np.median(error), np.percentile(error, 95)
    print(f"all pairs: median {median:.5%}, 95th percentile {high:.3%}")
    assert median <= 0.0005
    assert high <= 0.025


def test_landmark_columns_are_exact(body):
    mesh, exact = body
    distance = BiharmonicDistance(mesh, eigenpairs=10)
    for vertex in (0, 700, len(exact) - 1):
        column = distance.from_vertex(vertex)
        assert column[vertex] == 0
        others = np.arange(len(exact)) != vertex
        assert np.abs(column[others] / exact[others, vertex] - 1).max() < 1e-6


def test_estimate_beyond_the_basis_beats_plain_truncation(body):
    mesh, exact = body
    sides = mesh.triangles[:, :2].astype(int)
    i, j = sides[sides[:, 0] < sides[:, 1]].T
    distance = BiharmonicDistance(mesh, eigenpairs=100)
    error = np.abs(distance.between(i, j) / exact[i, j] - 1)
    assert np.median(error) < 0.08  # plain truncation is off by 0.29 here


def test_is_a_metric_on_the_sphere():
    mesh = TriangleMesh(*sphere(2))
    distance = BiharmonicDistance(mesh, eigenpairs=60)
    everything = np.stack([distance.from_vertex(i) for i in range(len(mesh.vertices))])
    assert np.allclose(everything, everything.T, rtol=1e-6, atol=1e-9)
    detour = everything[:, :, None] + everything[None]
    assert (everything[:, None] <= detour.transpose(0, 2, 1) + 1e-9).all() or (
        everything[:, None, :] <= detour.min(axis=1)[:, None] + 1e-9
    ).all()
    # Farther on the sphere is farther in the distance.
    angle = np.arccos(np.clip(mesh.vertices @ mesh.vertices[0], -1, 1))
    order = np.argsort(angle)
    assert np.corrcoef(np.argsort(np.argsort(everything[0])), np.argsort(order))[0, 1] > 0.99


def test_scales_with_the_mesh():
    vertices, triangles = torus()
    small, large = (BiharmonicDistance(TriangleMesh(s * vertices, triangles), eigenpairs=20) for s in (1, 1000))
    assert np.allclose(1000 * small.from_vertex(5), large.from_vertex(5), rtol=1e-9)
    pairs = np.arange(100), np.arange(100)[::-1].copy()
    assert np.allclose(1000 * small.between(*pairs), large.between(*pairs), rtol=1e-9)


def test_pieces_are_infinitely_far_apart():
    vertices, triangles = torus(10, 8)
    count = len(vertices)
    mesh = TriangleMesh(
        np.concatenate([vertices, 3 + vertices, [[9, 9, 9]]]), np.concatenate([triangles, triangles + count])
    )
    alone = BiharmonicDistance(TriangleMesh(vertices, triangles), eigenpairs=30)
    both = BiharmonicDistance(mesh, eigenpairs=30)
    column = both.from_vertex(3)
    assert np.allclose(column[:count], alone.from_vertex(3), rtol=1e-9)
    assert np.isinf(column[count:]).all()
    assert np.isinf(both.between([0, 5], [count, 2 * count])).all()
    assert both.between([2 * count], [2 * count]) == 0
    assert both.from_vertex(2 * count)[-1] == 0


def test_wrong_vertices_are_named():
    distance = BiharmonicDistance(TriangleMesh(*torus(8, 6)), eigenpairs=5)
    with pytest.raises(ValueError, match="index 1 refers to vertex 48"):
        distance.between([0, 48], [0, 1])
    with pytest.raises(ValueError, match="index 0 refers to vertex -1"):
        distance.from_vertex(-1)
    with pytest.raises(ValueError, match="2 first and 1 second"):
        distance.between([0, 1], [0])
    with pytest.raises(ValueError, match="integers"):
        distance.between([0.5], [1])
