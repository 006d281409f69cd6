"""Offsets before skinning: what a shape key has to hold so that the Armature modifier shows the solved skin."""

import numpy as np
import pytest
from deformation import turned
from dermis_native import (
    PbdSkin,
    SkinWeights,
    dual_quaternion_skinning,
    linear_blend_skinning,
    rest_space_offsets,
)
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from skin_poses import cylinder, cylinder_pose

# Singular values below this share of the largest are limited.
SINGULAR = 1e-2
VERTICES = 5
numbers = st.floats(-2, 2, width=32)
SKINNING = {"linear": linear_blend_skinning, "dual_quaternion": dual_quaternion_skinning}


@pytest.fixture(scope="module", params=SKINNING)
def tube(request):
    mesh, skeleton, weights = cylinder()
    return mesh, skeleton, weights, SKINNING[request.param], PbdSkin(mesh, skeleton, weights, skinning=request.param)


@pytest.mark.parametrize(("kind", "degrees"), [("bend", 90), ("twist", 120)])
@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("keyed", [False, True])
def test_skinning_the_offset_vertices_gives_the_solved_skin(tube, kind, degrees, masked, keyed):
    mesh, skeleton, weights, skinned, skin = tube
    pose = cylinder_pose(skeleton, kind, degrees)
    rest = mesh.vertices * [1.0, 1.1, 0.9] if keyed else mesh.vertices
    shares = np.linspace(0, 1, len(rest)) if masked else None
    offsets, limited = skin.solve_offsets(pose, rest if keyed else None, shares)
    share = 1 if shares is None else shares[:, None]
    shown = lambda v: v + share * (skinned(v, weights, pose) - v)  # noqa: E731
    wanted = rest + share * (skin.solve(pose, rest if keyed else None) - rest)
    assert np.abs(wanted - shown(rest)).max() > 0.05
    np.testing.assert_allclose(shown(rest + offsets), wanted, atol=2e-5)
    assert limited == 0
    assert offsets.dtype == np.float32


def test_rest_and_a_moved_whole_need_nothing(tube):
    _, skeleton, _, _, skin = tube
    for pose in (turned(skeleton, {}), np.tile(turned(skeleton, {0: [1, 2, 0.5]})[0], (2, 1, 1))):
        offsets, limited = skin.solve_offsets(pose)
        assert limited == 0
        assert not offsets.any()


def test_collapsed_vertices_are_limited_and_counted():
    mesh, skeleton, weights = cylinder()
    offsets, limited = PbdSkin(mesh, skeleton, weights).solve_offsets(cylinder_pose(skeleton, "twist", 180))
    assert 0 < limited < len(offsets) // 4
    assert np.isfinite(offsets).all()
    assert np.abs(offsets).max() < 2 / SINGULAR


def test_scaled_bones_keep_their_direction():
    """The rest matrices decide what dual quaternion skinning makes of scaled bones."""
    mesh, skeleton, weights = cylinder()
    rest = np.tile(np.eye(4), (2, 1, 1))
    rest[:, :3, :3] = Rotation.from_euler("z", -90, degrees=True).as_matrix()
    rest[:, :3, 3] = skeleton.heads
    pose = cylinder_pose(skeleton, "bend", 60)
    pose[1] = pose[1] @ rest[1] @ np.diag([1.4, 0.8, 1.1, 1]) @ np.linalg.inv(rest[1])
    far = np.abs(mesh.vertices[:, 0]) > 3.5
    plain = dual_quaternion_skinning(mesh.vertices, weights, pose, rest=rest)
    skin = PbdSkin(mesh, skeleton, weights, skinning="dual_quaternion", rest=rest)
    np.testing.assert_array_equal(skin.solve(pose)[far], plain[far])
    offsets, _ = skin.solve_offsets(pose)
    shown = dual_quaternion_skinning(mesh.vertices + offsets, weights, pose, rest=rest)
    np.testing.assert_allclose(shown, skin.solve(pose), atol=2e-5)


def test_wrong_arguments_are_named():
    mesh, skeleton, weights = cylinder()
    skin = PbdSkin(mesh, skeleton, weights)
    pose = turned(skeleton, {})
    shares = np.ones(len(mesh.vertices))
    shares[11] = 1.5
    with pytest.raises(ValueError, match=r"shares\[11\] is 1.5; it must be from 0 to 1"):
        skin.solve_offsets(pose, None, shares)
    with pytest.raises(ValueError, match="vertices and the shares 3"):
        skin.solve_offsets(pose, None, shares[:3])
    with pytest.raises(ValueError, match="1 vertices were given where"):
        skin.solve_offsets(pose, np.zeros((1, 3)))
    with pytest.raises(ValueError, match="3 rest matrices were given where 2 are needed"):
        PbdSkin(mesh, skeleton, weights, rest=np.tile(np.eye(4), (3, 1, 1)))


@given(
    arrays(np.float32, (VERTICES, 3), elements=numbers),
    arrays(np.float32, (VERTICES, 3, 3), elements=numbers),
    arrays(np.float32, VERTICES, elements=st.floats(0, 1, width=32)),
)
def test_shares_of_any_matrix(wanted, matrices, shares):
    """Every vertex has a bone of its own, so that its blended matrix is the bone's."""
    transforms = np.tile(np.eye(4, dtype=np.float32), (VERTICES, 1, 1))
    transforms[:, :3, :3] = matrices
    weights = SkinWeights.from_dense(np.eye(VERTICES))
    offsets, limited = rest_space_offsets(wanted, weights, transforms, shares=shares)
    assert np.isfinite(offsets).all()
    share = shares[:, None, None].astype(np.float64)
    blended = (1 - share) * np.eye(3) + share * matrices
    singular = np.linalg.svd(blended)[1]
    regular = singular[:, 2] > 1.01 * SINGULAR * singular[:, 0]
    reached = np.einsum("nij,nj->ni", blended, offsets)
    # Offsets are float32 and may be a hundred times what is wanted.
    np.testing.assert_allclose(reached[regular], wanted[regular], atol=2e-4)
    assert limited <= np.count_nonzero(~regular)


@pytest.mark.parametrize("least", [0.0, 1e-9, 0.5 * SINGULAR, 0.999 * SINGULAR])
def test_flat_matrices_are_limited_and_counted(least):
    wanted = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    weights = SkinWeights.from_dense(np.ones((2, 1)))
    offsets, limited = rest_space_offsets(wanted, weights, np.diag([1.0, 1.0, least, 1.0])[None], shares=np.ones(2))
    assert limited == 1, "a vertex that does not move is not counted"
    assert 0 <= offsets[0, 2] <= 1 / SINGULAR
    assert not offsets[1].any()
