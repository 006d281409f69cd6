"""The PBD skin on a MakeHuman body: a pure function, presets, statistics, wrong arguments."""

from functools import cache

import numpy as np
import pytest
import threads
from deformation import crossing_pairs, longest_stretch, turned, volume
from dermis_native import PbdSkin, linear_blend_skinning
from surfaces import adult, skin


@cache
def body():
    mesh, skeleton, weights = adult()
    return mesh, skeleton, skin(weights), PbdSkin(mesh, skeleton, skin(weights))


def several_joints(skeleton):
    turns = {"thigh_l": -80, "calf_l": 100, "spine_01": 20, "upperarm_r": 50, "lowerarm_r": 40, "index_02_l": 45}
    return turned(skeleton, {name: [np.radians(angle), 0, 0] for name, angle in turns.items()})


def test_several_joints_at_once():
    mesh, skeleton, weights, solver = body()
    rest, triangles, transforms = mesh.vertices, mesh.triangles, several_joints(skeleton)
    plain, solved = linear_blend_skinning(rest, weights, transforms), solver.solve(transforms)
    errors = [abs(volume(v, triangles) - volume(rest, triangles)) for v in (plain, solved)]
    assert errors[1] < 0.3 * errors[0]
    touching = crossing_pairs(rest, triangles)
    assert len(crossing_pairs(plain, triangles) - touching) > 50
    assert not crossing_pairs(solved, triangles) - touching
    assert longest_stretch(rest, solved, triangles) < longest_stretch(rest, plain, triangles)


def test_the_same_bits_in_a_new_process_on_any_number_of_threads():
    _, skeleton, _, solver = body()
    solver.solve(turned(skeleton, {"calf_r": [0.5, 0, 0]}))
    program = (
        "from test_pbd_skin import body, several_joints; _, skeleton, _, solver = body();"
        "found = (solver.solve(several_joints(skeleton)),)"
    )
    assert threads.digests(program, 1, 3) == {threads.digest(solver.solve(several_joints(skeleton)))}


def test_presets_are_what_they_say():
    mesh, skeleton, weights, _ = body()
    counts = {}
    for preset in ("default", "paper", "rumman_fratarcangeli"):
        stats = PbdSkin(mesh, skeleton, weights, preset=preset, cell_size=0.08).stats
        counts[preset] = stats["constraints"]
        assert stats["vertices"] == len(mesh.vertices)
    assert all(counts["paper"].values())
    for kind in ("energy", "self_collision"):
        assert counts["rumman_fratarcangeli"][kind] == 0
    for kind in ("stretch", "volume", "bind"):
        assert counts["rumman_fratarcangeli"][kind] == counts["paper"][kind]


def test_other_shapes_touch_too():
    """Vertices that a shape key has moved are kept apart; where it has not, nothing changes."""
    mesh, skeleton, weights, solver = body()
    rest, triangles = mesh.vertices.astype(np.float32), mesh.triangles
    transforms = turned(skeleton, {"calf_l": [np.radians(120), 0, 0]})
    unkeyed = solver.solve(transforms)
    np.testing.assert_array_equal(solver.solve(transforms, rest), unkeyed)
    corners = rest[triangles]
    normals = np.zeros_like(rest)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    distance = np.linalg.norm(rest - skeleton.heads[skeleton.names.index("calf_l")], axis=1)
    keyed = (rest + 0.02 * normals * np.clip(1 - (distance / 0.2) ** 2, 0, 1)[:, None]).astype(np.float32)
    still = np.tile(np.eye(4), (len(skeleton), 1, 1))
    np.testing.assert_array_equal(solver.solve(still, keyed), keyed)
    solved = solver.solve(transforms, keyed)
    only_added = linear_blend_skinning(keyed, weights, transforms) + (
        unkeyed - linear_blend_skinning(rest, weights, transforms)
    )
    far = distance > 0.5
    np.testing.assert_allclose(solved[far], only_added[far], atol=1e-5)
    around = triangles[(distance[triangles] < 0.3).all(axis=1)]
    touching = crossing_pairs(keyed, around)
    apart, through = (len(crossing_pairs(points, around) - touching) for points in (solved, only_added))
    assert apart < through


def test_stats_follow_the_pose():
    _, skeleton, _, solver = body()
    solver.solve(np.tile(np.eye(4), (len(skeleton), 1, 1)))
    assert solver.stats["active_islands"] == 0
    solver.solve(turned(skeleton, {"calf_l": [1.5, 0, 0]}))
    stats = solver.stats
    assert 0 < stats["active_islands"] < stats["islands"]
    assert stats["tetrahedra"] == len(solver.cage.tetrahedra)
    assert set(stats["milliseconds"]) == {"build", "skinning", "solve", "surface", "total"}
    assert all(time >= 0 for time in stats["milliseconds"].values())


def test_wrong_arguments_are_named():
    mesh, skeleton, weights, solver = body()
    for options, message in [
        ({"preset": "fast"}, "preset must be one of default, paper, rumman_fratarcangeli"),
        ({"start": "bind"}, "start must be one of auto, linear, dual_quaternion"),
        ({"region": "some"}, "region must be one of joints, all"),
        ({"skinning": "dqs"}, "skinning must be one of linear, dual_quaternion"),
        ({"stretch": 2.0}, "stretch is 2; it must be from 0 to 1"),
        ({"stiffness": 0.0}, "stiffness is 0; it must be finite and above 0"),
        ({"cell_size": np.nan}, "cell_size is NaN"),
        ({"threads": 0}, "threads is 0; it must be at least 1"),
    ]:
        with pytest.raises(ValueError, match=message):
            PbdSkin(mesh, skeleton, weights, **options)
    transforms = np.tile(np.eye(4), (len(skeleton), 1, 1))
    with pytest.raises(ValueError, match="1 vertices were given where"):
        solver.solve(transforms, np.zeros((1, 3)))
    transforms[7, 0, 0] = np.inf
    with pytest.raises(ValueError, match="transform of bone 7 is not finite"):
        solver.solve(transforms)
