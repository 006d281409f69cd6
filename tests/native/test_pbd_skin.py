"""The PBD skin on a MakeHuman body, beside plain skinning."""

import hashlib
import os
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from deformation import about, crossings, joint_turns, longest_edge, pose, volume
from dermis_native import PbdSkin, linear_blend_skinning
from surfaces import adult, skin


@cache
def body():
    mesh, skeleton, weights = adult()
    return mesh, skeleton, skin(weights), PbdSkin(mesh, skeleton, skin(weights))


def test_joints_keep_their_volume():
    mesh, skeleton, weights, solver = body()
    rest, triangles = mesh.vertices, mesh.triangles
    target, touching = volume(rest, triangles), crossings(rest, triangles)
    errors, crossed = np.zeros(2), np.zeros(2)
    for name, transforms in joint_turns(skeleton).items():
        plain, solved = linear_blend_skinning(rest, weights, transforms), solver.solve(transforms)
        assert solver.stats["inverted"] == 0, name
        edges = [longest_edge(v, triangles, rest) for v in (plain, solved)]
        assert edges[1] < edges[0], name
        errors += [abs(volume(v, triangles) - target) for v in (plain, solved)]
        crossed += [crossings(v, triangles) - touching for v in (plain, solved)]
    assert errors[1] <= 0.15 * errors[0], errors
    assert crossed[1] <= 0.03 * crossed[0], crossed


@pytest.mark.parametrize("name", ["hip 90", "forearm twist 120", "shoulder 60", "spine 35"])
def test_a_smooth_motion_does_not_pop(name):
    mesh, skeleton, weights, solver = body()
    corrections = []
    for share in np.linspace(0, 1, 31):
        transforms = joint_turns(skeleton, share)[name]
        corrections.append(solver.solve(transforms) - linear_blend_skinning(mesh.vertices, weights, transforms))
    steps = np.linalg.norm(np.diff(corrections, axis=0), axis=2).max(1)
    assert steps.max() <= 3 * np.median(steps), steps


def several_joints(skeleton):
    names = {"thigh_l": -80, "calf_l": 100, "spine_01": 20, "upperarm_r": 50, "lowerarm_r": 40, "index_02_l": 45}
    return pose(skeleton, {skeleton.names.index(name): about([1, 0, 0], angle) for name, angle in names.items()})


def test_several_joints_at_once():
    mesh, skeleton, weights, solver = body()
    transforms = several_joints(skeleton)
    plain, solved = linear_blend_skinning(mesh.vertices, weights, transforms), solver.solve(transforms)
    target = volume(mesh.vertices, mesh.triangles)
    error = [abs(volume(v, mesh.triangles) - target) for v in (plain, solved)]
    assert error[1] < 0.3 * error[0]
    touching = crossings(mesh.vertices, mesh.triangles)
    assert crossings(plain, mesh.triangles) > touching + 50
    assert crossings(solved, mesh.triangles) == touching, "none that the rest pose does not have"
    assert longest_edge(solved, mesh.triangles, mesh.vertices) < longest_edge(plain, mesh.triangles, mesh.vertices)


def test_rest_comes_back_to_the_last_bit():
    mesh, skeleton, _, solver = body()
    rest = solver.solve(np.tile(np.eye(4), (len(skeleton), 1, 1)))
    np.testing.assert_array_equal(rest, mesh.vertices.astype(np.float32))


SOLVE = """
import hashlib, numpy as np, sys
sys.path[:0] = {paths!r}
from test_pbd_skin import body, several_joints
_, skeleton, _, solver = body()
print(hashlib.sha256(solver.solve(several_joints(skeleton)).tobytes()).hexdigest())
"""


def test_the_same_bits_in_a_new_process_on_any_number_of_threads():
    _, skeleton, _, solver = body()
    for transforms in joint_turns(skeleton, 0.5).values():
        solver.solve(transforms)
    expected = hashlib.sha256(solver.solve(several_joints(skeleton)).tobytes()).hexdigest()
    for threads in ("1", "3"):
        environment = os.environ | {"RAYON_NUM_THREADS": threads}
        command = [sys.executable, "-c", SOLVE.format(paths=sys.path)]
        run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=True)
        assert run.stdout.strip() == expected, f"{threads} threads"


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


def test_stats_follow_the_pose():
    _, skeleton, _, solver = body()
    solver.solve(np.tile(np.eye(4), (len(skeleton), 1, 1)))
    assert solver.stats["active_islands"] == 0
    solver.solve(joint_turns(skeleton)["knee 90"])
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
