"""Wrong arguments are named and nothing else happens."""

import numpy as np
import pytest
from dermis_native import (
    BoneMap,
    Cancelled,
    DermisError,
    NumericalError,
    Progress,
    RetargetError,
    Skeleton,
    SkinWeights,
    TriangleMesh,
    retarget_weights,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from surfaces import adult, skin, torus

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def test_errors_have_one_base():
    assert issubclass(NumericalError, DermisError)
    assert issubclass(RetargetError, DermisError)
    assert issubclass(Cancelled, DermisError)


@pytest.mark.parametrize(
    ("vertices", "triangles", "message"),
    [
        (SQUARE[:, :2], [[0, 1, 2]], r"vertices must have shape \(n, 3\), got \(4, 2\)"),
        (SQUARE, [0, 1, 2], r"triangles must have shape \(n, 3\), got \(3,\)"),
        (SQUARE, [[0, 1, 4]], "triangle 0 refers to vertex 4, but there are 4"),
        (SQUARE, [[0, 1, 2], [0, -1, 2]], "triangle 1 refers to vertex -1"),
        (SQUARE, [[0.0, 1.0, 2.0]], "triangles must be an array of integers"),
        (np.where(SQUARE == 1, np.nan, SQUARE), [[0, 1, 2]], "vertex 1 has a coordinate that is not finite"),
        (np.array([["a", "b", "c"]]), [[0, 1, 2]], "vertices must be an array of numbers"),
    ],
)
def test_meshes(vertices, triangles, message):
    with pytest.raises(ValueError, match=message):
        TriangleMesh(vertices, np.asarray(triangles))


def test_any_float_and_integer_type_and_order_will_do():
    for floats in (np.float32, np.float64):
        for integers in (np.int32, np.int64, np.uint16, np.uint64):
            mesh = TriangleMesh(np.asfortranarray(SQUARE.astype(floats)), np.array([[0, 1, 2], [0, 2, 3]], integers))
            assert (mesh.vertices == SQUARE).all()
            assert mesh.triangles.dtype == np.uint32


def test_topology_of_a_mesh():
    mesh = TriangleMesh(np.concatenate([SQUARE, [[5, 5, 5]]]), [[0, 1, 2], [0, 2, 3], [0, 2, 1], [1, 1, 2]])
    assert mesh.non_manifold_edges.tolist() == [[0, 2]]
    assert mesh.boundary_edges.tolist() == [[0, 3], [2, 3]]
    assert mesh.components.tolist() == [0, 0, 0, 0, 1]
    assert mesh.degenerate_triangles.tolist() == [3]


def test_polygons():
    mesh = TriangleMesh.from_polygons(SQUARE, [4], [0, 1, 2, 3])
    assert len(mesh.triangles) == 2
    with pytest.raises(ValueError, match="polygon 1 has 2 corners"):
        TriangleMesh.from_polygons(SQUARE, [3, 2], [0, 1, 2, 0, 1])
    with pytest.raises(ValueError, match="4 corners in all, but 3"):
        TriangleMesh.from_polygons(SQUARE, [4], [0, 1, 2])


def test_skeletons():
    ends = np.zeros((2, 3))
    with pytest.raises(ValueError, match="bone 1 is its own ancestor"):
        Skeleton(ends, ends, [-1, 1])
    with pytest.raises(ValueError, match="bone 0 has parent 7"):
        Skeleton(ends, ends, [7, 0])
    with pytest.raises(ValueError, match="2 heads, 2 tails, 1 parents"):
        Skeleton(ends, ends, [-1])
    with pytest.raises(ValueError, match='both named "arm"'):
        Skeleton(ends, ends, [-1, 0], ["arm", "arm"])
    with pytest.raises(ValueError, match="tail of bone 1 is not finite"):
        Skeleton(ends, [[0, 0, 0], [0, np.inf, 0]], [-1, 0])


def test_weights():
    with pytest.raises(ValueError, match=r"vertex 1 for bone 0 is -0\.5"):
        SkinWeights.from_dense([[1.0], [-0.5]])
    with pytest.raises(ValueError, match="vertex 0 for bone 1 is NaN"):
        SkinWeights.from_dense([[0.0, np.nan]])
    with pytest.raises(ValueError, match="entry 1 refers to bone 2, but there are 2"):
        SkinWeights.from_triplets([0, 0], [0, 2], [1.0, 1.0], 1, 2)
    with pytest.raises(ValueError, match="same length, got 2, 1 and 2"):
        SkinWeights.from_triplets([0, 0], [0], [1.0, 1.0], 1, 2)


@settings(max_examples=50, deadline=None)
@given(
    hnp.arrays(np.float32, hnp.array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.floats(0, 4, width=32))
)
def test_weights_round_trip(dense):
    weights = SkinWeights.from_dense(dense)
    assert (weights.to_dense() == dense).all()
    again = SkinWeights.from_triplets(*weights.to_triplets(), *dense.shape)
    assert (again.to_dense() == dense).all()
    totals = weights.normalized().to_dense().sum(axis=1)
    assert np.allclose(totals[dense.sum(axis=1) > 1e-30], 1, atol=1e-6)


def characters():
    mesh, skeleton, weights = adult(1200)
    return mesh, skeleton, skin(weights)


def test_retarget_names_what_is_missing():
    mesh, skeleton, weights = characters()
    with pytest.raises(RetargetError, match="landmark"):
        retarget_weights(mesh, weights, mesh)
    with pytest.raises(RetargetError, match="told apart by 1 landmark pair;"):
        retarget_weights(mesh, weights, mesh, landmarks=[[0, 0]])
    with pytest.raises(ValueError, match="landmark 1: target vertex 99999 does not exist"):
        retarget_weights(mesh, weights, mesh, landmarks=[[0, 0], [1, 99999]])
    with pytest.raises(ValueError, match='method must be "auto" or "paper", got "best"'):
        retarget_weights(mesh, weights, mesh, method="best")
    with pytest.raises(ValueError, match="max_influences"):
        retarget_weights(mesh, weights, mesh, landmarks=[[0, 0], [1, 1]], max_influences=0)
    both = {"source_skeleton": skeleton, "target_skeleton": skeleton}
    bare = SkinWeights.from_triplets(
        np.zeros(0, int), np.zeros(0, int), np.zeros(0), weights.vertex_count, weights.bone_count
    )
    with pytest.raises(RetargetError, match="no source vertex has a weight"):
        retarget_weights(mesh, bare, mesh, **both)
    short = SkinWeights.from_dense(np.ones((3, weights.bone_count)))
    with pytest.raises(ValueError, match="source weights have 3 vertices, but the source mesh has"):
        retarget_weights(mesh, short, mesh, **both)
    one_bone = SkinWeights.from_dense(np.ones((weights.vertex_count, 1)))
    with pytest.raises(ValueError, match="source weights have 1 bones, but the source skeleton has"):
        retarget_weights(mesh, one_bone, mesh, **both)


def test_retarget_names_bones_that_do_not_match():
    mesh, skeleton, weights = characters()
    nothing = Skeleton(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, int))
    with pytest.raises(RetargetError, match=r"source: \"Root\", \"pelvis\".* and 41 more; target: none"):
        retarget_weights(mesh, weights, mesh, source_skeleton=skeleton, target_skeleton=nothing)


def test_bone_maps_name_the_bone_at_fault():
    mesh, skeleton, weights = characters()
    count = len(skeleton)
    own = [[bone] for bone in range(count)]
    with pytest.raises(ValueError, match="1 entries, but the source has 53 bones"):
        BoneMap(skeleton, skeleton, [[0]])
    with pytest.raises(ValueError, match='source bone "pelvis" is mapped to target bone 53'):
        BoneMap(skeleton, skeleton, [own[0], [53], *own[2:]])
    hands = [skeleton.names.index("hand_l"), skeleton.names.index("hand_r")]
    with pytest.raises(ValueError, match='"pelvis" is mapped to "hand_l" and "hand_r", which are not on one chain'):
        BoneMap(skeleton, skeleton, [own[0], hands, *own[2:]])
    bone_map = BoneMap(skeleton, skeleton, own)
    with pytest.raises(ValueError, match="a bone map needs both skeletons"):
        retarget_weights(mesh, weights, mesh, landmarks=[[0, 0], [1, 1]], bone_map=bone_map)
    fewer = Skeleton(skeleton.heads[:1], skeleton.tails[:1], [-1])
    with pytest.raises(ValueError, match="belongs to 53 target bones, but there are 1"):
        retarget_weights(mesh, weights, mesh, source_skeleton=skeleton, target_skeleton=fewer, bone_map=bone_map)


def test_landmarks_on_another_piece_are_named():
    mesh, skeleton, weights = characters()
    vertices, triangles = torus(8, 6)
    count = len(mesh.vertices)
    pieces = TriangleMesh(
        np.concatenate([mesh.vertices, vertices]), np.concatenate([mesh.triangles, triangles + count])
    )
    with pytest.raises(RetargetError, match=f"landmark 2: target vertex {count + 5} lies on another piece"):
        retarget_weights(mesh, weights, pieces, landmarks=[[0, 0], [9, 9], [5, count + 5]])
    assert skeleton is not None


@pytest.mark.parametrize("vertices", [np.zeros((0, 3)), np.zeros((1, 3)), np.eye(3)[:2], np.zeros((3, 3))])
def test_targets_without_a_surface(vertices):
    mesh, skeleton, weights = characters()
    triangles = np.array([[0, 1, 2]])[: len(vertices) // 3]
    target = TriangleMesh(vertices, triangles.reshape(-1, 3))
    with pytest.raises(ValueError, match="target mesh: the mesh has no triangle with an area"):
        retarget_weights(mesh, weights, target, source_skeleton=skeleton, target_skeleton=skeleton)


def test_progress_runs_and_cancels():
    mesh, skeleton, weights = characters()
    both = {"source_skeleton": skeleton, "target_skeleton": skeleton}
    progress = Progress()
    retarget_weights(mesh, weights, mesh, progress=progress, **both)
    assert progress.fraction == 1
    assert progress.stage
    progress.cancel()
    assert progress.cancelled
    with pytest.raises(Cancelled):
        retarget_weights(mesh, weights, mesh, progress=progress, **both)
