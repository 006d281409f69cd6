"""The demo's bodies: complete, closed, and with weights that stay true under another topology."""

from __future__ import annotations

from pathlib import Path

import makehuman
import numpy as np
import pytest
from scipy.spatial import cKDTree

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


@pytest.fixture(scope="module")
def body() -> makehuman.Character:
    return makehuman.body("average")


def edge_uses(triangles: makehuman.Integers) -> np.ndarray:
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def volume(character: makehuman.Character) -> float:
    corners = character.vertices[character.triangles]
    return float(np.linalg.det(corners).sum() / 6.0)


def test_body_is_a_closed_surface_that_stands_on_the_floor(body: makehuman.Character) -> None:
    assert (edge_uses(body.triangles) == 2).all()
    assert body.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-12)
    assert 1.4 < body.vertices[:, 2].max() < 2.0
    toes = body.vertices[body.vertices[:, 2] < 0.03]
    head = body.heads[body.bone_names.index("head")]
    assert toes[:, 1].min() < head[1] - 0.1  # it faces -Y


def test_skeleton_lies_inside_the_body(body: makehuman.Character) -> None:
    assert body.bone_names[0] == "Root"
    assert (body.parents < np.arange(len(body.parents))).all()
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    assert (body.heads[1:] > low).all()
    assert (body.heads[1:] < high).all()
    left, right = (body.heads[body.bone_names.index(f"hand_{side}")] for side in "lr")
    np.testing.assert_allclose(left * [-1, 1, 1], right, atol=1e-3)
    assert left[0] > 0.0


def test_weights_are_complete(body: makehuman.Character) -> None:
    assert body.weights.shape == (len(body.vertices), len(body.bone_names))
    assert body.weights.min() >= 0.0
    np.testing.assert_allclose(body.weights.sum(axis=1), 1.0, atol=1e-6)
    # What a bone moves most lies nearer to that bone than to its mirror image.
    moved = body.vertices[body.weights[:, body.bone_names.index("calf_l")] > 0.9]
    assert len(moved) > 100
    assert (moved[:, 0] > 0.0).all()


def test_macro_values_change_the_body(body: makehuman.Character) -> None:
    child, heavy = makehuman.body("child", **makehuman.CHILD), makehuman.body("heavy", **makehuman.HEAVY)
    assert child.vertices[:, 2].max() < 0.85 * body.vertices[:, 2].max()
    assert volume(heavy) > 1.15 * volume(body)
    np.testing.assert_array_equal(child.weights, body.weights)


def test_wrong_macro_values_are_named() -> None:
    with pytest.raises(ValueError, match="strength"):
        makehuman.body("wrong", strength=1.0)
    with pytest.raises(ValueError, match="age is 2"):
        makehuman.body("wrong", age=2.0)


def test_permuted_is_the_same_body(body: makehuman.Character) -> None:
    other = makehuman.permuted(body, seed=3)
    assert not np.array_equal(other.vertices, body.vertices)
    key = np.lexsort(body.vertices.T), np.lexsort(other.vertices.T)
    np.testing.assert_array_equal(body.vertices[key[0]], other.vertices[key[1]])
    np.testing.assert_array_equal(body.weights[key[0]].sum(axis=0), other.weights[key[1]].sum(axis=0))
    original = np.sort(body.vertices[body.triangles].sum(axis=(1, 2)))
    np.testing.assert_allclose(np.sort(other.vertices[other.triangles].sum(axis=(1, 2))), original, rtol=1e-12)


def test_decimated_keeps_shape_and_weights(body: makehuman.Character) -> None:
    coarse = makehuman.decimated(body, 6000)
    uses = edge_uses(coarse.triangles)
    assert 5900 <= len(coarse.triangles) <= 6000
    assert (uses <= 2).all()
    np.testing.assert_allclose(coarse.weights.sum(axis=1), 1.0, atol=1e-6)
    assert volume(coarse) == pytest.approx(volume(body), rel=0.01)
    _, nearest = cKDTree(body.vertices).query(coarse.vertices)
    assert np.abs(coarse.weights - body.weights[nearest]).sum(axis=1).mean() < 0.05


def test_interpolation_reproduces_the_corners(body: makehuman.Character) -> None:
    np.testing.assert_allclose(makehuman.interpolated_weights(body, body.vertices), body.weights, atol=1e-6)


def test_triangulate_cuts_the_shorter_diagonal() -> None:
    vertices = np.array([[0.0, 0, 0], [3, 0, 0], [4, 1, 0], [1, 1, 0], [0, 5, 0]])
    triangles = makehuman.triangulate(vertices, np.array([4, 3]), np.array([0, 1, 2, 3, 0, 3, 4]))
    assert {tuple(sorted(t)) for t in triangles.tolist()} == {(0, 1, 3), (1, 2, 3), (0, 3, 4)}


@pytest.mark.parametrize(
    ("name", "macro"), [("default", makehuman.AVERAGE), ("child", makehuman.CHILD), ("heavy", makehuman.HEAVY)]
)
def test_same_as_the_reference_export(name: str, macro: dict[str, float]) -> None:
    path = SHARED / f"mh_{name}.npz"
    if not path.is_file():
        pytest.skip("no reference export beside the checkout")
    body = makehuman.body(name, **macro)
    with np.load(path) as reference:
        order = [list(reference["bone_names"]).index(bone) for bone in body.bone_names]
        np.testing.assert_allclose(body.vertices, reference["verts"], atol=1e-6)
        np.testing.assert_array_equal(body.loop_indices, reference["loop_indices"])
        # The reference has another rule for the root, which moves nothing.
        np.testing.assert_allclose(body.heads[1:], reference["heads"][order][1:], atol=1e-6)
        np.testing.assert_allclose(body.tails[1:], reference["tails"][order][1:], atol=1e-6)
        dense = np.zeros_like(body.weights)
        dense[reference["w_vert"], reference["w_bone"]] = reference["w_val"]
        np.testing.assert_allclose(body.weights, dense[:, order], atol=1e-6)
