"""The cage: lattice tetrahedra around any mesh."""

import igl
import numpy as np
import pytest
from dermis_native import TriangleMesh, tetrahedralize
from surfaces import adult, bad_meshes, sphere, torus


def volumes(cage):
    a, b, c, d = (cage.vertices[cage.tetrahedra[:, k]] for k in range(4))
    return np.einsum("ti,ti->t", np.cross(b - a, c - a), d - a) / 6


@pytest.mark.parametrize("surface", [sphere(3), torus(24, 10)], ids=["sphere", "torus"])
def test_the_cage_covers_the_solid_and_little_more(surface):
    vertices, triangles = surface
    size = 0.2
    cage = tetrahedralize(TriangleMesh(vertices, triangles), cell_size=size)
    np.testing.assert_allclose(volumes(cage), size**3 / 12)
    middles = cage.vertices[cage.tetrahedra].mean(1)
    distance = igl.point_mesh_squared_distance(middles, vertices, triangles)[0] ** 0.5
    inside = igl.winding_number(vertices, triangles, middles) > 0.5
    assert (inside | (distance < size)).all()
    random = np.random.default_rng(0).uniform(vertices.min(0), vertices.max(0), (2000, 3))
    within = random[igl.winding_number(vertices, triangles, random) > 0.5]
    assert covered(cage, within).all()


def covered(cage, points):
    """True for points inside of some tetrahedron."""
    a = cage.vertices[cage.tetrahedra]
    inverse = np.linalg.inv(np.stack([a[:, k] - a[:, 0] for k in (1, 2, 3)], -1))
    near = np.argsort(np.linalg.norm(points[:, None] - a.mean(1), axis=2), axis=1)[:, :30]
    b = np.einsum("ptij,ptj->pti", inverse[near], points[:, None] - a[near][:, :, 0])
    return ((b > -1e-9).all(-1) & (b.sum(-1) < 1 + 1e-9)).any(1)


def test_dihedral_angles_are_sixty_or_ninety_degrees():
    cage = tetrahedralize(TriangleMesh(*sphere(2)), cell_size=0.5)
    corners = cage.vertices[cage.tetrahedra]
    for i, j, k, m in [(0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 0, 2), (2, 3, 0, 1)]:
        axis = corners[:, j] - corners[:, i]
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        flat = []
        for corner in (k, m):
            arm = corners[:, corner] - corners[:, i]
            arm -= axis * np.einsum("ti,ti->t", arm, axis)[:, None]
            flat.append(arm / np.linalg.norm(arm, axis=1, keepdims=True))
        angle = np.degrees(np.arccos(np.clip(np.einsum("ti,ti->t", *flat), -1, 1)))
        assert (np.isclose(angle, 60) | np.isclose(angle, 90)).all()


@pytest.mark.parametrize(("name", "vertices", "triangles"), list(bad_meshes()))
def test_any_mesh_has_a_cage(name, vertices, triangles):
    cage = tetrahedralize(TriangleMesh(vertices, triangles))
    assert len(cage.tetrahedra) > 0, name
    assert (volumes(cage) > 0).all()


def test_a_body_has_a_cage_of_a_few_cells_across_its_limbs():
    mesh, _, _ = adult()
    cage = tetrahedralize(mesh)
    assert 5_000 < len(cage.tetrahedra) < 200_000


def test_wrong_cell_sizes_are_refused():
    mesh = TriangleMesh(*sphere(1))
    for size in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match="cell size is"):
            tetrahedralize(mesh, cell_size=size)
    with pytest.raises(ValueError, match="more than 2000000 tetrahedra"):
        tetrahedralize(mesh, cell_size=1e-4)
    with pytest.raises(ValueError, match="no triangles"):
        tetrahedralize(TriangleMesh(np.eye(3), np.zeros((0, 3), int)))
