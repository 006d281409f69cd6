"""`bind_weights(method="paper")` against eq. 2 in numpy."""

import algorithm2
import numpy as np
import pytest
from dermis_native import Skeleton, TriangleMesh, bind_weights
from surfaces import child


def eq_2(vertices, skeleton):
    """Weights (V,B): 1/d⁴ over the three nearest segments in a joint area, the two nearest elsewhere."""
    axes = skeleton.tails - skeleton.heads
    along = np.einsum("vbi,bi->vb", vertices[:, None] - skeleton.heads, axes) / (axes**2).sum(axis=1)
    nearest = skeleton.heads + np.clip(along, 0, 1)[..., None] * axes
    distance = np.linalg.norm(vertices[:, None] - nearest, axis=2)
    kind = algorithm2.decompose(vertices, skeleton, np.ones(len(skeleton), bool))[:, 0]
    rank = np.argsort(np.argsort(distance, axis=1, kind="stable"), axis=1)
    inverse = np.where(rank < np.where(kind == 0, 3, 2)[:, None], distance**-4.0, 0.0)
    return inverse / inverse.sum(axis=1, keepdims=True)


def test_agrees_with_numpy():
    mesh, skeleton, _ = child(2400)
    weights = bind_weights(mesh, skeleton, method="paper").to_dense()
    assert np.abs(weights - eq_2(mesh.vertices, skeleton)).max() < 1e-5
    assert np.isin(np.count_nonzero(weights, axis=1), [2, 3]).all()
    limited = bind_weights(mesh, skeleton, method="paper", max_influences=1).to_dense()
    assert (limited.argmax(axis=1) == weights.argmax(axis=1)).mean() > 0.999
    assert np.abs(limited.sum(axis=1) - 1).max() < 1e-6


def test_the_unit_does_not_matter():
    mesh, skeleton, _ = child(2400)
    weights = bind_weights(mesh, skeleton, method="paper").to_dense()
    for scale in (1e-6, 1e6):
        scaled = TriangleMesh(scale * mesh.vertices, mesh.triangles)
        bones = Skeleton(scale * skeleton.heads, scale * skeleton.tails, skeleton.parents)
        assert np.abs(bind_weights(scaled, bones, method="paper").to_dense() - weights).max() < 1e-4


def test_wrong_arguments_are_named():
    mesh, skeleton, _ = child(2400)
    with pytest.raises(ValueError, match='method must be "volumetric" or "paper", got "heat"'):
        bind_weights(mesh, skeleton, method="heat")
    with pytest.raises(ValueError, match="max_influences must be at least 1"):
        bind_weights(mesh, skeleton, max_influences=0)
    with pytest.raises(ValueError, match="no bones"):
        bind_weights(mesh, Skeleton(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, int)))
