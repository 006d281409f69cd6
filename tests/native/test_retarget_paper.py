"""`retarget_weights(method="paper")` against Algorithm 2 in numpy, and its invariants."""

import algorithm2
import numpy as np
import pytest
import threads
from dermis_native import Skeleton, TriangleMesh, retarget_weights
from surfaces import adult, child, skin


def landmarks_of(source, target, source_skeleton, target_skeleton, weights):
    result = retarget_weights(
        source, weights, target, source_skeleton=source_skeleton, target_skeleton=target_skeleton, method="paper"
    )
    return result.landmarks


@pytest.mark.parametrize("with_skeletons", [False, True])
def test_agrees_with_the_numpy_version_on_a_real_body(with_skeletons):
    source, source_skeleton, weights = adult(3600)
    target, target_skeleton, _ = child(3600)
    landmarks = landmarks_of(source, target, source_skeleton, target_skeleton, skin(weights))
    assert len(landmarks) == 5
    skeletons = {"source_skeleton": source_skeleton, "target_skeleton": target_skeleton} if with_skeletons else {}
    result = retarget_weights(
        source, skin(weights), target, landmarks=landmarks, method="paper", eigenpairs=300, **skeletons
    )
    regions = None
    if with_skeletons:
        takes_part = weights.any(axis=0)
        regions = [
            algorithm2.decompose(mesh.vertices, skeleton, takes_part)
            for mesh, skeleton in ((source, source_skeleton), (target, target_skeleton))
        ]
    first, expected = algorithm2.retarget(source, weights, target, landmarks, regions)
    same = (result.correspondence == first).mean()
    difference = np.abs(result.weights.to_dense() - expected)
    print(f"same first match {same:.2%}, mean difference {difference.mean():.1e} per weight", end=" ")
    print(f"and {difference.sum(axis=1).mean():.1e} per vertex")
    assert same >= 0.99
    # Matches rest on exact distances; eq. 23 uses the truncated basis, which is what remains here.
    assert difference.mean() <= 1e-3
    assert difference.sum(axis=1).mean() <= 1e-2


def test_landmarks_by_rule_sit_on_head_hands_and_knees():
    source, source_skeleton, weights = adult(3600)
    target, target_skeleton, _ = child(3600)
    pairs = landmarks_of(source, target, source_skeleton, target_skeleton, skin(weights))
    for mesh, vertices in ((source, pairs[:, 0]), (target, pairs[:, 1])):
        points = mesh.vertices[vertices]
        height = np.ptp(mesh.vertices[:, 2])
        feet = mesh.vertices[:, 2].min()
        assert points[0, 2] > feet + 0.95 * height
        assert np.allclose(points[1, 0], -points[2, 0], atol=0.03 * height)
        assert (np.abs(points[1:3, 0]) > 0.2 * height).all()
        assert np.allclose(points[3:, 2], feet + 0.28 * height, atol=0.05 * height)


def test_the_same_body_gets_its_own_weights():
    mesh, skeleton, weights = adult(3600)
    result = retarget_weights(
        mesh, skin(weights), mesh, source_skeleton=skeleton, target_skeleton=skeleton, method="paper"
    )
    expected = weights / weights.sum(axis=1, keepdims=True)
    assert (result.correspondence == np.arange(len(weights))).all()
    assert np.abs(result.weights.to_dense() - expected).max() < 1e-6


def test_rows_sum_to_one_and_influences_are_limited():
    source, source_skeleton, weights = adult(3600)
    target, target_skeleton, _ = child(3600)
    for limit in (None, 4, 1):
        result = retarget_weights(
            source,
            skin(weights * 0.37),
            target,
            source_skeleton=source_skeleton,
            target_skeleton=target_skeleton,
            max_influences=limit,
        )
        dense = result.weights.to_dense()
        assert (dense >= 0).all()
        assert np.abs(dense.sum(axis=1, dtype=float) - 1).max() <= 1e-6
        assert (np.count_nonzero(dense, axis=1) <= (limit or dense.shape[1])).all()


def test_size_position_and_vertex_order_do_not_matter():
    source, source_skeleton, weights = adult(1200)
    target, target_skeleton, _ = child(1200)
    plain = retarget_weights(
        source, skin(weights), target, source_skeleton=source_skeleton, target_skeleton=target_skeleton
    )
    random = np.random.default_rng(0)
    order = random.permutation(len(target.vertices))
    new_index = np.argsort(order)
    moved = TriangleMesh(100 * target.vertices[order] + 7, new_index[target.triangles])
    skeleton = Skeleton(
        100 * target_skeleton.heads + 7, 100 * target_skeleton.tails + 7, target_skeleton.parents, target_skeleton.names
    )
    result = retarget_weights(source, skin(weights), moved, source_skeleton=source_skeleton, target_skeleton=skeleton)
    difference = np.abs(result.weights.to_dense() - plain.weights.to_dense()[order]).sum(axis=1)
    assert (difference < 1e-4).mean() > 0.995


def test_bones_are_paired_by_name():
    source, source_skeleton, weights = adult(1200)
    target, target_skeleton, _ = child(1200)
    arguments = (source, skin(weights), target)
    plain = retarget_weights(*arguments, source_skeleton=source_skeleton, target_skeleton=target_skeleton)
    order = np.random.default_rng(1).permutation(len(target_skeleton))
    new_index = np.argsort(order)
    parents = np.array([-1 if p < 0 else new_index[p] for p in target_skeleton.parents[order]])
    shuffled = Skeleton(
        target_skeleton.heads[order],
        target_skeleton.tails[order],
        parents,
        [target_skeleton.names[bone] for bone in order],
    )
    result = retarget_weights(*arguments, source_skeleton=source_skeleton, target_skeleton=shuffled)
    assert np.abs(result.weights.to_dense() - plain.weights.to_dense()[:, order]).max() < 1e-6


def test_loose_parts_follow_the_nearest_surface():
    source, source_skeleton, weights = adult(1200)
    target, target_skeleton, _ = child(1200)
    plain = retarget_weights(
        source, skin(weights), target, source_skeleton=source_skeleton, target_skeleton=target_skeleton, method="paper"
    )
    near = target.vertices[10]
    count = len(target.vertices)
    button = near + 1e-4 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    speck = [near]
    mesh = TriangleMesh(
        np.concatenate([target.vertices, button, speck]),
        np.concatenate([target.triangles, [[count, count + 1, count + 2]]]),
    )
    result = retarget_weights(
        source, skin(weights), mesh, source_skeleton=source_skeleton, target_skeleton=target_skeleton, method="paper"
    )
    assert result.matched[:count].all()
    assert not result.matched[count:].any()
    dense = result.weights.to_dense()
    assert np.abs(dense[:count] - plain.weights.to_dense()).max() < 1e-6
    assert np.abs(dense[count:] - dense[10]).max() < 0.05
    assert np.abs(dense.sum(axis=1) - 1).max() <= 1e-6


def test_a_seam_in_the_surface_does_not_matter():
    source, source_skeleton, weights = adult(1200)
    target, target_skeleton, _ = child(1200)
    skeletons = {"source_skeleton": source_skeleton, "target_skeleton": target_skeleton, "method": "paper"}
    plain = retarget_weights(source, skin(weights), target, **skeletons)
    # Cut the target in two along the plane of symmetry: vertices there are repeated.
    left = target.vertices[target.triangles].mean(axis=1)[:, 0] > 0
    used = np.intersect1d(target.triangles[left], target.triangles[~left])
    copies = np.arange(len(target.vertices))
    copies[used] = len(target.vertices) + np.arange(len(used))
    triangles = target.triangles.astype(int)
    triangles[left] = copies[triangles[left]]
    cut = TriangleMesh(np.concatenate([target.vertices, target.vertices[used]]), triangles)
    assert cut.components.max() > 0
    result = retarget_weights(source, skin(weights), cut, **skeletons)
    assert result.matched.all()
    dense = result.weights.to_dense()
    assert np.abs(dense[: len(target.vertices)] - plain.weights.to_dense()).max() < 1e-6
    assert (dense[len(target.vertices) :] == dense[used]).all()


def test_unpainted_source_vertices_are_not_chosen():
    source, source_skeleton, weights = adult(1200)
    target, target_skeleton, _ = child(1200)
    bare = weights.copy()
    bare[::3] = 0
    result = retarget_weights(
        source, skin(bare), target, source_skeleton=source_skeleton, target_skeleton=target_skeleton, method="paper"
    )
    assert (result.correspondence % 3 != 0).all()
    assert np.abs(result.weights.to_dense().sum(axis=1) - 1).max() <= 1e-6


@pytest.mark.parametrize("method", ["auto", "paper"])
def test_threads_do_not_change_a_bit(method):
    program = (
        "from surfaces import adult, child, skin; from dermis_native import retarget_weights as retarget;"
        "(source, bones, weights), (target, own, _) = adult(3600), child(3600);"
        f"r = retarget(source, skin(weights), target, source_skeleton=bones, target_skeleton=own, method='{method}');"
        "found = r.weights.to_dense(), r.correspondence"
    )
    assert len(threads.digests(program, 1, 2, 5)) == 1
