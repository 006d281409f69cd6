"""`fit_skeleton`: joints near the artist's on other bodies and in other poses, any mesh, any template."""

import re
from functools import cache

import characters
import numpy as np
import pytest
import threads
from bad_characters import bad_meshes, bad_skeletons, body
from bind_figures import BODIES, character
from dermis_native import Cancelled, Progress, Skeleton, TriangleMesh, fit_skeleton, tetrahedralize
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

LARGEST_MEAN, LARGEST = 0.03, 0.08  # errors of main joints, of the height
FINGER = re.compile("|".join(characters.FINGERS))


@cache
def template():
    """The young man's skeleton."""
    return characters.skeleton_of(character("young man"))


@cache
def fitted(name, triangles=8000):
    """A body, its mesh, and the template fitted into it."""
    it = character(name, triangles)
    mesh = characters.mesh_of(it)
    return it, mesh, fit_skeleton(mesh, template())


def bare(name):
    """The mesh of a character beside the checkout, which need not have a skeleton."""
    with np.load(characters.SHARED / f"{name}.npz") as data:
        vertices = data["verts"].astype(np.float64)
        return TriangleMesh.from_polygons(vertices, data["loop_counts"], data["loop_indices"])


def main_joints(names):
    return [i for i, name in enumerate(names) if not FINGER.search(name) and name.lower() != "root"]


def errors(fitted, it):
    """Distances of the main joints from the artist's, as shares of the height."""
    order = [it.bone_names.index(name) for name in fitted.names]
    distances = np.linalg.norm(fitted.heads - it.heads[order], axis=1) / np.ptp(it.vertices[:, 2])
    return distances[main_joints(fitted.names)]


def assert_valid(found, template, mesh):
    """What holds for every result."""
    skeleton = found.skeleton
    assert skeleton.names == template.names
    assert (skeleton.parents == template.parents).all()
    ends = np.concatenate([skeleton.heads, skeleton.tails])
    assert np.isfinite(ends).all()
    assert 0 <= found.score <= 1
    assert found.method in ("embedding", "template")
    assert found.found.shape == (len(template),)
    assert (found.method == "embedding") == found.found.any()
    assert found.method == "embedding" or found.message
    size = np.ptp(np.concatenate([template.heads, template.tails]), axis=0).max()
    for bone, parent in enumerate(template.parents):
        if parent >= 0 and np.linalg.norm(template.heads[bone] - template.tails[parent]) < 1e-6 * size:
            assert (skeleton.heads[bone] == skeleton.tails[parent]).all(), "connected bones stay connected"
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    placed = np.concatenate([skeleton.heads[found.found], skeleton.tails[found.found]])
    voxel = 0.02 * (high - low).max()
    assert (placed >= low - voxel).all()
    assert (placed <= high + voxel).all()


def inside(mesh, points):
    """Whether each point is inside of the mesh, or within a few percent of a limb's thickness."""
    vertices, triangles = mesh.vertices, mesh.triangles
    corners = vertices[triangles]
    winding = np.empty(len(points))
    for i, point in enumerate(points):
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(p, axis=1) for p in (a, b, c))
        numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
        dot = lambda p, q: np.einsum("ij,ij->i", p, q)  # noqa: E731
        denominator = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        winding[i] = np.arctan2(numerator, denominator).sum() / (2 * np.pi)
    return np.abs(winding) > 0.5


@pytest.mark.parametrize("name", BODIES)
def test_joints_come_near_to_the_artists(name):
    it, mesh, found = fitted(name)
    assert_valid(found, template(), mesh)
    assert found.method == "embedding"
    assert found.symmetric
    assert found.score > 0.6
    assert not found.message
    error = errors(found.skeleton, it)
    assert error.mean() <= LARGEST_MEAN
    assert error.max() <= LARGEST
    main = main_joints(template().names)
    assert inside(mesh, found.skeleton.heads[main]).all()
    for joint in main:
        side = characters.side_of(template().names[joint])
        assert side == 0 or found.skeleton.heads[joint, 0] * side > 0, "left stays left"


@pytest.mark.parametrize("name", BODIES)
def test_the_template_need_not_have_the_bodys_pose(name):
    it = characters.posed(character(name))
    mesh = characters.mesh_of(it)
    found = fit_skeleton(mesh, template())
    assert_valid(found, template(), mesh)
    assert found.method == "embedding"
    error = errors(found.skeleton, it)
    assert error.mean() <= LARGEST_MEAN
    assert error.max() <= LARGEST


@pytest.mark.skipif(not characters.SHARED.is_dir(), reason="no folder of characters beside the checkout")
@pytest.mark.parametrize("name", ["mh_child", "mh_heavy", "mh_child_dec6k"])
def test_other_bodies_with_the_same_rig(name):
    it = characters.shared(name)
    source = characters.skeleton_of(characters.shared("mh_default"))
    found = fit_skeleton(characters.mesh_of(it), source)
    assert found.method == "embedding"
    error = errors(found.skeleton, it)
    assert error.mean() <= LARGEST_MEAN
    assert error.max() <= LARGEST


@pytest.mark.skipif(not characters.SHARED.is_dir(), reason="no folder of characters beside the checkout")
@pytest.mark.parametrize(
    ("body_name", "template_name"),
    [("smpl_man", "mh_default"), ("cesium_man", "mh_default_rig_mixamo"), ("m2m_human_male", "mh_default"),
     ("m2m_zombie", "mh_default"), ("mh_default_rig_mixamo", "cesium_man"), ("khronos_fox", "m2m_fox"),
     ("quat_wolf", "khronos_fox"), ("quat_husky", "khronos_fox")],
)  # fmt: skip
def test_other_characters(body_name, template_name):
    mesh = bare(body_name)
    source = characters.skeleton_of(characters.shared(template_name))
    found = fit_skeleton(mesh, source)
    assert_valid(found, source, mesh)
    assert found.method == "embedding"
    heads = found.skeleton.heads[found.found]
    assert inside(mesh, heads).mean() >= 0.98
    beside = np.abs(source.heads[:, 0]) > 0.02 * np.ptp(source.heads, axis=0).max()
    sides = np.where(beside, np.sign(source.heads[:, 0]), 0)[found.found]
    assert (heads[:, 0] * sides >= 0).all(), "left stays left"


@pytest.mark.parametrize("name", bad_meshes())
def test_bad_meshes_get_a_valid_skeleton(name):
    mesh, skeleton = bad_meshes()[name]()
    if np.ptp(mesh.vertices, axis=0).max() == 0:
        with pytest.raises(ValueError, match="no size"):
            fit_skeleton(mesh, skeleton)
        return
    assert_valid(fit_skeleton(mesh, skeleton), skeleton, mesh)


@pytest.mark.parametrize("name", bad_skeletons())
def test_bad_templates_get_a_valid_skeleton_or_an_error(name):
    mesh, skeleton = bad_skeletons()[name]()
    try:
        found = fit_skeleton(mesh, skeleton)
    except ValueError as error:
        assert re.search("no size|at least two", str(error))  # noqa: PT017
        return
    assert_valid(found, skeleton, mesh)


def test_a_far_and_large_template_fits_as_well():
    _, mesh, near = fitted("child", 4000)
    source = template()
    far = fit_skeleton(
        mesh, Skeleton(100 * source.heads + [5, 7, 9], 100 * source.tails + [5, 7, 9], source.parents, source.names)
    )
    assert np.abs(far.skeleton.heads - near.skeleton.heads).max() < 0.01
    assert far.score == pytest.approx(near.score, abs=0.02)


@settings(max_examples=3, deadline=None)
@given(st.floats(-3, 3), hnp.arrays(float, 3, elements=st.floats(-5, 5)))
def test_place_and_size_of_the_body_do_not_matter(exponent, step):
    _, mesh, found = fitted("child", 4000)
    elsewhere = fit_skeleton(TriangleMesh(10**exponent * (mesh.vertices + step), mesh.triangles), template())
    body_bones = np.array(template().names) != "Root"
    back = elsewhere.skeleton.heads / 10**exponent - step
    assert np.abs(back - found.skeleton.heads)[body_bones].max() < 0.02


def test_the_last_digits_of_the_input_do_not_matter():
    _, mesh, found = fitted("child", 4000)
    height = np.ptp(mesh.vertices[:, 2])
    noise = 1e-7 * height * np.random.default_rng(1).normal(size=mesh.vertices.shape)
    noisy = fit_skeleton(TriangleMesh(mesh.vertices + noise, mesh.triangles), template())
    assert np.abs(noisy.skeleton.heads - found.skeleton.heads).max() < 1e-3 * height


def test_fixed_bones_stay():
    it = character("heavy man", 4000)
    source = template()
    names = list(source.names)
    fixed = np.zeros(len(names), bool)
    fixed[[names.index("lowerarm_l"), names.index("head")]] = True
    found = fit_skeleton(characters.mesh_of(it), source, fixed=fixed)
    assert (found.skeleton.heads[fixed] == source.heads[fixed]).all()
    assert (found.skeleton.tails[fixed] == source.tails[fixed]).all()
    hand, arm = names.index("hand_l"), names.index("lowerarm_l")
    assert (found.skeleton.heads[hand] == found.skeleton.tails[arm]).all()


def test_symmetry_is_exact_where_it_is_used():
    it = character("child", 4000)
    mirrored = np.concatenate([it.vertices, it.vertices * [-1, 1, 1]])
    triangles = np.concatenate([it.triangles, len(it.vertices) + it.triangles[:, ::-1]])
    names = list(template().names)
    other = [names.index(re.sub("_([lr])$", lambda m: "_r" if m[1] == "l" else "_l", name)) for name in names]
    found = fit_skeleton(TriangleMesh(mirrored, triangles), template())
    assert found.symmetric
    main = main_joints(names)
    heads = found.skeleton.heads
    assert np.abs(heads[other][main] * [-1, 1, 1] - heads[main]).max() < 0.005
    assert not fit_skeleton(TriangleMesh(mirrored, triangles), template(), symmetric=False).symmetric


def test_bones_that_do_not_deform_are_carried():
    _, mesh, plain = fitted("child", 4000)
    source = template()
    heads = np.concatenate([source.heads, [[0.0, -1.0, 0.9]]])
    tails = np.concatenate([source.tails, [[0.0, -1.2, 0.9]]])
    with_control = Skeleton(heads, tails, [*source.parents, 1], [*source.names, "control"])
    deform = [True] * len(source) + [False]
    found = fit_skeleton(mesh, with_control, deform=deform)
    assert not found.found[-1]
    assert np.abs(found.skeleton.heads[:-1] - plain.skeleton.heads).max() < 1e-9
    assert found.skeleton.heads[-1, 1] < -0.5


@pytest.mark.skipif(not characters.SHARED.is_dir(), reason="no folder of characters beside the checkout")
@pytest.mark.parametrize("body_name", ["quat_wolf", "khronos_fox", "spot", "cesium_man"])
def test_another_kind_of_creature_is_said(body_name):
    is_beast = body_name != "cesium_man"
    mesh = bare(body_name)
    for name in ("mh_default", "khronos_fox"):
        source = characters.skeleton_of(characters.shared(name))
        found = fit_skeleton(mesh, source)
        assert_valid(found, source, mesh)
        if (name == "khronos_fox") == is_beast:
            assert found.score >= 0.5
            assert not found.message
        else:
            assert found.score < 0.5
            assert found.message


def test_bones_without_length_stay_so():
    source = template()
    tails = source.tails.copy()
    hand = list(source.names).index("thumb_03_l")
    tails[hand] = source.heads[hand]
    flat = Skeleton(source.heads, tails, source.parents, source.names)
    found = fit_skeleton(characters.mesh_of(character("child", 4000)), flat)
    assert (found.skeleton.heads[hand] == found.skeleton.tails[hand]).all()
    assert '"thumb_03_l" has no length' in found.message


def test_the_same_bits_on_any_number_of_threads():
    program = (
        "import surfaces, dermis_native as d; mesh, skeleton, _ = surfaces.child(3000);"
        "fitted = d.fit_skeleton(mesh, skeleton).skeleton; found = fitted.heads, fitted.tails"
    )
    assert len(threads.digests(program, 1, 2, 5)) == 1


def test_wrong_arguments_are_named():
    vertices, triangles, bones = body()
    mesh, skeleton = TriangleMesh(vertices, triangles), Skeleton(*bones)
    count = len(skeleton)
    with pytest.raises(ValueError, match="the mesh has no triangles"):
        fit_skeleton(TriangleMesh(vertices, np.zeros((0, 3), int)), skeleton)
    with pytest.raises(ValueError, match="the template has 1 bones; a skeleton of at least two"):
        fit_skeleton(mesh, Skeleton([[0, 0, 0]], [[0, 0, 1]], [-1]))
    with pytest.raises(ValueError, match="the template has no size"):
        fit_skeleton(mesh, Skeleton(np.zeros((2, 3)), np.zeros((2, 3)), [-1, 0]))
    with pytest.raises(ValueError, match="no bone of the template is marked as deforming"):
        fit_skeleton(mesh, skeleton, deform=[False] * count)
    with pytest.raises(ValueError, match=rf"fixed must have shape \({count},\), got \(2,\)"):
        fit_skeleton(mesh, skeleton, fixed=[True, False])
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        fit_skeleton(mesh, skeleton, progress=progress)


def test_joints_are_in_the_middle_of_limbs():
    _, mesh, found = fitted("young man")
    found = found.skeleton
    cells = tetrahedralize(mesh, cell_size=0.02)
    for name in ("lowerarm_l", "calf_l", "lowerarm_r", "calf_r"):
        joint = found.heads[found.names.index(name)]
        near = cells.vertices[np.linalg.norm(cells.vertices - joint, axis=1) < 0.1]
        assert np.linalg.norm(near.mean(axis=0) - joint) < 0.03, name


# Few different coordinates: coincident vertices, zero areas and flat pieces are then common.
coordinates = st.sampled_from([-2.0, -1.0, 0.0, 1e-9, 0.5, 1.0, 3.0])


@settings(max_examples=60, deadline=None)
@given(
    hnp.arrays(float, (9, 3), elements=coordinates),
    hnp.arrays(np.int64, (14, 3), elements=st.integers(0, 8)),
    hnp.arrays(float, (6, 3), elements=coordinates),
)
def test_any_triangle_soup(vertices, triangles, ends):
    mesh, skeleton = TriangleMesh(vertices, triangles), Skeleton(ends[:3], ends[3:], [-1, 0, 0])
    try:
        found = fit_skeleton(mesh, skeleton)
    except ValueError as error:
        assert "no size" in str(error)  # noqa: PT017
        return
    assert_valid(found, skeleton, mesh)
