"""Skinning against numpy."""

import numpy as np
import pytest
from dermis_native import SkinWeights, dual_quaternion_skinning, linear_blend_skinning, rest_space_offsets
from scipy.spatial.transform import Rotation


@pytest.fixture
def scene():
    """Vertices, dense weights with empty and unnormalised rows, rigid transforms."""
    random = np.random.default_rng(7)
    weights = random.random((200, 5)) * (random.random((200, 5)) < 0.6)
    weights[:3] = 0
    transforms = np.tile(np.eye(4), (5, 1, 1))
    transforms[:, :3, :3] = Rotation.random(5, random).as_matrix()
    transforms[:, :3, 3] = random.normal(size=(5, 3))
    return random.normal(size=(200, 3)), weights, transforms


def blend(vertices, weights, transforms):
    total = weights.sum(1, keepdims=True)
    normalised = np.divide(weights, total, out=np.zeros_like(weights), where=total > 1e-4)
    moved = np.einsum("bij,vj->vbi", transforms, np.c_[vertices, np.ones(len(vertices))])[..., :3]
    return vertices + np.einsum("vb,vbi->vi", normalised, moved - vertices[:, None])


def dual_blend(vertices, weights, transforms):
    """Blends real and dual parts linearly, signs relative to what is there already."""
    rotations = Rotation.from_matrix(transforms[:, :3, :3]).as_quat(scalar_first=True)
    result = vertices.copy()
    for v, row in enumerate(weights):
        real, dual = np.zeros(4), np.zeros(4)
        for bone in np.flatnonzero(row):
            q, t = rotations[bone], np.r_[0, transforms[bone, :3, 3]]
            sign = -1 if q @ real < 0 else 1
            real += sign * row[bone] * q
            dual += sign * row[bone] * 0.5 * product(t, q)
        if row.any():
            length = np.linalg.norm(real)
            real, dual = real / length, dual / length
            inverse = real * [1, -1, -1, -1]
            result[v] = (product(product(real, np.r_[0, vertices[v]]), inverse) + 2 * product(dual, inverse))[1:]
    return result


def product(p, q):
    return np.r_[p[0] * q[0] - p[1:] @ q[1:], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])]


def test_linear_blend(scene):
    vertices, weights, transforms = scene
    skinned = linear_blend_skinning(vertices, SkinWeights.from_dense(weights), transforms)
    assert skinned.dtype == np.float32
    np.testing.assert_allclose(skinned, blend(vertices, weights, transforms), atol=2e-6)


def test_dual_quaternions(scene):
    vertices, weights, transforms = scene
    skinned = dual_quaternion_skinning(vertices, SkinWeights.from_dense(weights), transforms)
    np.testing.assert_allclose(skinned, dual_blend(vertices, weights, transforms), atol=5e-6)


def test_scaled_bones_keep_their_scale(scene):
    vertices, _, transforms = scene
    rest = np.roll(transforms, 1, axis=0)
    posed = transforms @ np.diag([1.5, 0.5, 2, 1])
    weights = np.eye(5)[np.arange(200) % 5]
    scaled = posed @ np.linalg.inv(rest)
    skinned = dual_quaternion_skinning(vertices, SkinWeights.from_dense(weights), scaled, rest=rest)
    np.testing.assert_allclose(skinned, blend(vertices, weights, scaled), atol=2e-5)


def test_scaled_bones_blend_as_rigid_motions(scene):
    """What the scale does to the vertex counts as translation of the bone, so rotations blend undisturbed."""
    vertices, weights, transforms = scene
    rest = np.tile(np.eye(4), (5, 1, 1))
    scale = np.diag([1.5, 0.5, 2, 1])
    skinned = dual_quaternion_skinning(vertices, SkinWeights.from_dense(weights), transforms @ scale, rest=rest)
    for v in range(0, 200, 7):
        rigid = transforms.copy()
        rigid[:, :3, 3] += transforms[:, :3, :3] @ (scale[:3, :3] @ vertices[v] - vertices[v])
        wanted = dual_blend(vertices[v : v + 1], weights[v : v + 1], rigid)[0]
        np.testing.assert_allclose(skinned[v], wanted, atol=2e-5)


def test_a_stretched_character_is_skinned_in_its_own_space(scene):
    """Blender blends in the armature's space, whatever its object does to that."""
    vertices, weights, transforms = scene
    weights = SkinWeights.from_dense(weights)
    rest = np.roll(transforms, 1, axis=0)
    posed = transforms @ np.diag([1.3, 0.8, 1, 1])
    wanted = dual_quaternion_skinning(vertices, weights, posed @ np.linalg.inv(rest), rest=rest)
    world = np.array([[1, 0.2, 0, 0.5], [0.1, 2, 0.3, -1], [0, 0, -0.5, 2], [0, 0, 0, 1]])
    placed = vertices @ world[:3, :3].T + world[:3, 3]
    in_world = world @ posed @ np.linalg.inv(rest) @ np.linalg.inv(world)
    skinned = dual_quaternion_skinning(placed, weights, in_world, rest=world @ rest)
    np.testing.assert_allclose(skinned, wanted @ world[:3, :3].T + world[:3, 3], atol=5e-5)
    still = np.tile(np.eye(4), (5, 1, 1))
    np.testing.assert_array_equal(
        dual_quaternion_skinning(placed, weights, still, rest=world @ rest), placed.astype(np.float32)
    )


@pytest.mark.parametrize("preserve_volume", [False, True])
def test_rest_space_offsets_move_the_skinned_surface(scene, preserve_volume):
    vertices, weights, transforms = scene
    turns = np.outer(np.linspace(0, 1.4, 5), np.array([1, 2, 3]) / 14**0.5)
    transforms[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    skin = dual_quaternion_skinning if preserve_volume else linear_blend_skinning
    weights = SkinWeights.from_dense(weights)
    wanted = np.random.default_rng(1).normal(size=vertices.shape) * 0.1
    rest, limited = rest_space_offsets(wanted, weights, transforms, preserve_volume=preserve_volume)
    assert limited == 0
    moved = skin(vertices + rest, weights, transforms) - skin(vertices, weights, transforms)
    np.testing.assert_allclose(moved, wanted, atol=5e-6)


def test_a_collapsed_vertex_is_limited_and_counted():
    weights = SkinWeights.from_dense(np.array([[0.5, 0.5], [1, 0]]))
    transforms = np.stack([np.eye(4), np.diag([1.0, -1, -1, 1])])
    rest, limited = rest_space_offsets(np.ones((2, 3)), weights, transforms)
    assert limited == 1
    assert np.isfinite(rest).all()
    np.testing.assert_array_equal(rest[1], 1)


def test_wrong_arguments_are_named(scene):
    vertices, weights, transforms = scene
    weights = SkinWeights.from_dense(weights)
    bad = transforms.copy()
    bad[3, 1, 2] = np.nan
    for skin in (linear_blend_skinning, dual_quaternion_skinning):
        with pytest.raises(ValueError, match="transform of bone 3 is not finite"):
            skin(vertices, weights, bad)
        with pytest.raises(ValueError, match=r"transforms must have shape \(n, 4, 4\)"):
            skin(vertices, weights, transforms[:, :3])
        with pytest.raises(ValueError, match="199 vertices were given where 200 are needed"):
            skin(vertices[1:], weights, transforms)
    transposed = np.where(np.arange(5)[:, None, None] == 2, transforms.transpose(0, 2, 1), transforms)
    with pytest.raises(ValueError, match=r"last row of transforms\[2\] must be"):
        linear_blend_skinning(vertices, weights, transposed)
