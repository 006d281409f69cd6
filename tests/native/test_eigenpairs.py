"""The partial eigen decomposition: repeated eigenvalues, no pair missed."""

import algorithm2
import numpy as np
import pytest
import scipy.linalg
from dermis_native import Cancelled, Progress, TriangleMesh, eigenpairs
from surfaces import adult, csc, sphere, torus


@pytest.mark.parametrize(("surface", "count"), [(sphere, 100), (torus, 100), (torus, 400), (sphere, 24)])
def test_every_pair_is_found_though_eigenvalues_repeat(surface, count):
    mesh = TriangleMesh(*surface())
    stiffness, areas = csc(mesh)
    expected = scipy.linalg.eigh(stiffness.toarray(), np.diag(areas), eigvals_only=True)[1 : count + 1]
    values, vectors = eigenpairs(mesh, count)
    assert values.shape == (count,)
    assert vectors.shape == (len(areas), count)
    assert np.abs(values / expected - 1).max() < 1e-8
    assert np.abs(vectors.T @ (areas[:, None] * vectors) - np.eye(count)).max() < 1e-8
    residual = stiffness @ vectors - areas[:, None] * vectors * values
    assert (np.linalg.norm(residual / np.sqrt(areas)[:, None], axis=0) / values).max() < 1e-7


def test_sphere_has_the_multiplicities_of_spherical_harmonics():
    values, _ = eigenpairs(TriangleMesh(*sphere(4)), 48)
    degrees = np.repeat(np.arange(1, 7), 2 * np.arange(1, 7) + 1)
    assert np.allclose(values, degrees * (degrees + 1), rtol=0.03)


def test_real_body_against_the_dense_spectrum():
    mesh, _, _ = adult(3600)
    values, _ = eigenpairs(mesh, 300)
    assert np.abs(values / algorithm2.spectrum(mesh)[0][1:301] - 1).max() < 1e-9


@pytest.mark.parametrize("scale", [1e-3, 0.1, 10.0, 1e3])
def test_the_unit_does_not_matter(scale):
    mesh, _, _ = adult(1200)
    values, _ = eigenpairs(mesh, 100)
    scaled, _ = eigenpairs(TriangleMesh(scale * mesh.vertices, mesh.triangles), 100)
    assert np.abs(scale**2 * scaled / values - 1).max() < 1e-8


def test_all_pairs_of_a_tiny_mesh():
    tetrahedron = TriangleMesh(
        np.concatenate([np.eye(3), np.zeros((1, 3))]), [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]
    )
    values, vectors = eigenpairs(tetrahedron, 3)
    assert (values > 0).all()
    assert vectors.shape == (4, 3)


def test_too_many_pairs_and_several_components_are_errors():
    from dermis_native import DermisError

    mesh = TriangleMesh(*torus(8, 6))
    with pytest.raises((ValueError, DermisError), match="48"):
        eigenpairs(mesh, 48)
    vertices, triangles = torus(8, 6)
    twice = TriangleMesh(np.concatenate([vertices, vertices + 9]), np.concatenate([triangles, triangles + 48]))
    with pytest.raises(ValueError, match="2 components"):
        eigenpairs(twice, 10)


def test_cancelling_raises():
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        eigenpairs(TriangleMesh(*sphere(3)), 50, progress=progress)


def test_the_same_bits_every_time():
    mesh = TriangleMesh(*sphere(3))
    first, second = (eigenpairs(mesh, 60) for _ in range(2))
    assert all((a == b).all() for a, b in zip(first, second, strict=True))
