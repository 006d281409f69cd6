"""`bind_weights(method="volumetric")`: the artist's weights, any mesh, and what must not change a result."""

import characters
import numpy as np
import pytest
import threads
from bad_characters import bad_characters
from bind_figures import BODIES, character, on_the_other_side, stretched_edges
from dermis_native import Cancelled, Progress, Skeleton, TriangleMesh, bind_weights
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

LARGEST_ERROR = 0.42


def bind(it, **options):
    weights = bind_weights(characters.mesh_of(it), characters.skeleton_of(it), **options).to_dense()
    return np.asarray(weights, np.float64)


def assert_valid(weights, vertex_count, bone_count):
    assert weights.shape == (vertex_count, bone_count)
    assert (weights >= 0).all()
    assert np.abs(weights.sum(axis=1, dtype=np.float64) - 1).max() <= 1e-6


@pytest.mark.parametrize("name", BODIES)
def test_comes_near_to_the_artists_weights(name):
    it = character(name)
    weights = bind(it)
    assert_valid(weights, len(it.vertices), len(it.bone_names))
    assert characters.l1_error(weights, it.weights).mean() <= LARGEST_ERROR
    assert on_the_other_side(it, weights) <= 0.001
    assert stretched_edges(it, weights) < 0.01
    moved = it.weights.max(axis=0) > 0.5
    assert (weights.max(axis=0)[moved] > 0.5).all(), "every bone that the artist gave vertices has some"


@pytest.mark.parametrize("name", bad_characters())
def test_bad_meshes_and_skeletons_get_valid_weights(name):
    mesh, skeleton = bad_characters()[name]()
    weights = bind_weights(mesh, skeleton).to_dense()
    assert_valid(weights, len(mesh.vertices), len(skeleton))


@pytest.mark.skipif(not characters.SHARED.is_dir(), reason="no folder of characters beside the checkout")
@pytest.mark.parametrize("path", sorted(characters.SHARED.glob("*.npz")), ids=lambda path: path.stem)
def test_other_characters_get_valid_weights(path):
    with np.load(path) as data:
        if "bone_names" not in data or not len(data["bone_names"]):
            pytest.skip("no skeleton")
    it = characters.shared(path.stem)
    weights = bind(it)
    assert_valid(weights, len(it.vertices), len(it.bone_names))
    assert on_the_other_side(it, weights) <= 0.001


@pytest.mark.parametrize("name", ["young man", "baby"])
def test_a_posed_body_is_bound_as_well(name):
    rest = character(name)
    it = characters.posed(rest)
    weights = bind(it)
    assert characters.l1_error(weights, it.weights).mean() <= LARGEST_ERROR
    # The pose has no mirror plane; the sides are those of the body at rest.
    assert on_the_other_side(rest, weights) <= 0.001
    assert stretched_edges(it, weights) < 0.01


def test_shells_hardly_change_the_weights():
    whole, skeleton = characters.mesh_of(character("child", 3000)), characters.skeleton_of(character("child", 3000))
    weights = bind_weights(whole, skeleton).to_dense()
    corners = whole.triangles.ravel()
    apart = TriangleMesh(whole.vertices[corners], np.arange(len(corners)).reshape(-1, 3))
    split = bind_weights(apart, skeleton).to_dense()
    assert np.abs(split - weights[corners]).sum(axis=1).mean() < 1e-6, "seams are welded"
    outside = TriangleMesh(whole.vertices, whole.triangles[:, ::-1])
    assert np.abs(bind_weights(outside, skeleton).to_dense() - weights).sum(axis=1).mean() < 1e-6


def test_a_speck_follows_the_nearest_surface_as_one():
    it = character("child", 3000)
    skeleton = characters.skeleton_of(it)
    on_head = it.vertices[it.vertices[:, 2].argmax()] + [0, 0, 0.1]
    speck = on_head + 0.004 * np.eye(3)
    mesh = TriangleMesh(
        np.concatenate([it.vertices, speck]), np.concatenate([it.triangles, [len(it.vertices) + np.arange(3)]])
    )
    weights = bind_weights(mesh, skeleton).to_dense()
    assert (weights[-3:] == weights[-1]).all()
    assert weights[-1, it.bone_names.index("head")] > 0.9


@settings(max_examples=3, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-3, 3))
def test_place_size_and_order_do_not_matter(seed, exponent):
    random = np.random.default_rng(seed)
    it = character("child", 3000)
    mesh, skeleton = characters.mesh_of(it), characters.skeleton_of(it)
    weights = bind_weights(mesh, skeleton).to_dense()
    turn, scale, offset = Rotation.random(random_state=seed).as_matrix().T, 10**exponent, random.normal(size=3)
    order = random.permutation(len(it.vertices))
    place = lambda points: scale * (points @ turn + offset)  # noqa: E731
    triangles = np.argsort(order)[random.permutation(it.triangles)]
    elsewhere = bind_weights(
        TriangleMesh(place(it.vertices)[order], triangles),
        Skeleton(place(skeleton.heads), place(skeleton.tails), skeleton.parents),
    ).to_dense()
    assert np.abs(elsewhere - weights[order]).sum(axis=1).mean() < 1e-4


def test_bones_may_be_in_another_order():
    it = character("child", 3000)
    mesh, skeleton = characters.mesh_of(it), characters.skeleton_of(it)
    order = np.random.default_rng(0).permutation(len(skeleton))
    parents = np.append(np.argsort(order), -1)[skeleton.parents[order]]
    other = bind_weights(mesh, Skeleton(skeleton.heads[order], skeleton.tails[order], parents)).to_dense()
    assert np.abs(other - bind_weights(mesh, skeleton).to_dense()[:, order]).sum(axis=1).mean() < 1e-4


def test_the_same_bits_on_any_number_of_threads():
    program = (
        "import surfaces, dermis_native as d; mesh, skeleton, _ = surfaces.child(3000);"
        "found = (d.bind_weights(mesh, skeleton).to_dense(),)"
    )
    assert len(threads.digests(program, 1, 2, 5)) == 1


def test_chosen_bones_and_limits():
    it = character("child", 3000)
    names = list(it.bone_names)
    chosen = [names.index(name) for name in ("upperarm_l", "lowerarm_l", "hand_l")]
    mask = np.zeros(len(names), bool)
    mask[chosen] = True
    weights = bind(it, bones=chosen)
    assert (weights == bind(it, bones=mask)).all()
    assert_valid(weights, len(it.vertices), len(names))
    assert (weights[:, ~mask] == 0).all()
    for limit in (1, 2, 4):
        limited = bind(it, max_influences=limit)
        assert_valid(limited, len(it.vertices), len(names))
        assert np.count_nonzero(limited, axis=1).max() <= limit
    assert (bind(it, bones=np.arange(len(names)) == 7)[:, 7] == 1).all()


def test_wrong_arguments_are_named():
    it = character("child", 3000)
    mesh, skeleton = characters.mesh_of(it), characters.skeleton_of(it)
    with pytest.raises(ValueError, match="no bone is chosen"):
        bind_weights(mesh, skeleton, bones=[])
    with pytest.raises(ValueError, match=r"bones\[1\] is 99, but there are 53 bones"):
        bind_weights(mesh, skeleton, bones=[0, 99])
    with pytest.raises(ValueError, match=r"bones must have shape \(53,\), got \(3,\)"):
        bind_weights(mesh, skeleton, bones=[True, False, True])
    with pytest.raises(ValueError, match="the mesh has no triangles"):
        bind_weights(TriangleMesh(it.vertices, np.zeros((0, 3), int)), skeleton)
    with pytest.raises(ValueError, match="the skeleton has no bones"):
        bind_weights(mesh, Skeleton(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, int)))
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        bind_weights(mesh, skeleton, progress=progress)


# Few different coordinates: coincident vertices, zero areas and flat pieces are then common.
coordinates = st.sampled_from([-2.0, -1.0, 0.0, 1e-9, 0.5, 1.0, 3.0])


@settings(max_examples=100, deadline=None)
@given(
    hnp.arrays(float, (9, 3), elements=coordinates),
    hnp.arrays(np.int64, (14, 3), elements=st.integers(0, 8)),
    hnp.arrays(float, (6, 3), elements=coordinates),
)
def test_any_triangle_soup(vertices, triangles, ends):
    weights = bind_weights(TriangleMesh(vertices, triangles), Skeleton(ends[:3], ends[3:], [-1, 0, 0])).to_dense()
    assert_valid(weights, 9, 3)
