"""Garments: on their wearer at any distance, of another body, with a lining, and pieces of bodies."""

import characters
import garments
import makehuman
import numpy as np
import pytest
from dermis_native import retarget_weights


def weights_of(source, target):
    result = retarget_weights(
        characters.mesh_of(source),
        characters.weights_of(source),
        characters.mesh_of(target),
        source_skeleton=characters.skeleton_of(source),
        target_skeleton=characters.skeleton_of(target),
    )
    dense = result.weights.to_dense()
    assert np.abs(dense.sum(axis=1) - 1).max() <= 1e-6
    return dense


def errors(target, dense):
    return characters.l1_error(dense, target.weights).mean(), characters.pose_error(target, dense)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    ("bones", "distance", "layers"),
    [
        (garments.SUIT, 0.004, 1),
        (garments.SUIT, 0.015, 2),
        (garments.JACKET, 0.02, 1),
        (garments.JACKET, 0.02, 2),
        (garments.LEGS, 0.025, 1),
    ],
)
def test_cloth_at_any_distance_from_its_wearer(seed, bones, distance, layers):
    """At least as good as the closest point, and not torn apart where it spans two limbs."""
    body = characters.random_body(30 + seed)
    cloth = characters.remeshed(garments.cloth(body, bones, distance, layers=layers), 4000)
    l1, pose = errors(cloth, weights_of(body, cloth))
    peer_l1, peer_pose = errors(cloth, makehuman.interpolated_weights(body, cloth.vertices))
    assert l1 <= 1.03 * peer_l1 + 0.002
    assert pose <= peer_pose


@pytest.mark.parametrize("layers", [1, 2])
def test_a_suit_of_another_body(layers):
    """Hands, head and feet have nothing to meet in it, and are not drawn to it."""
    wearer, source = characters.random_body(33), characters.random_body(34)
    cloth = characters.remeshed(garments.cloth(wearer, garments.SUIT, 0.01, layers=layers), 5000)
    dense = weights_of(source, cloth)
    bare = [k for k, name in enumerate(cloth.bone_names) if characters.finger_of(name) >= 0]
    assert dense[:, bare].sum(axis=1).mean() <= 0.002
    assert errors(cloth, dense)[0] <= 0.2


def test_a_skirt_does_not_leap_from_leg_to_leg():
    body = characters.random_body(35)
    skirt = garments.skirt(body)
    edges = skirt.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    leap = lambda weights: np.abs(weights[edges[:, 0]] - weights[edges[:, 1]]).sum(axis=1).max()  # noqa: E731
    dense = weights_of(body, skirt)
    assert leap(dense) < 1.0 < 1.9 < leap(makehuman.interpolated_weights(body, skirt.vertices))
    side = np.array([characters.side_of(name) for name in body.bone_names])
    off = np.abs(skirt.vertices[:, 0] - body.heads[0, 0]) > 0.05 * characters.extent(body)
    lean = (dense @ side) * np.sign(skirt.vertices[:, 0])
    assert (lean[off] > -0.05).all()


@pytest.mark.parametrize("bones", [("head", "neck"), ("hand", "thumb", "index", "middle", "ring", "pinky")])
def test_a_piece_of_another_body(bones):
    piece = characters.remeshed(garments.cut(characters.random_body(36), bones), 3000)
    dense = weights_of(characters.random_body(37), piece)
    assert errors(piece, dense)[0] <= 0.05
    assert characters.misplaced(piece, dense).mean() <= 0.005
