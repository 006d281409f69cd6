# SPDX-License-Identifier: GPL-3.0-or-later
"""Sizes, up-axes, mirrored objects and loose parts: the weights do not depend on how a scene is made."""

import sys

import bpy
import characters as c
import numpy as np
import pytest
from mathutils import Euler, Matrix
from scratch_profile import MODULE

NAMES = ("lower", "middle", "upper")
LANDMARKS = [(0, 0), (39, 29), (80, 58), (122, 94), (156, 135), (157, 136)]


def target_with_rig(name="Target"):
    target = c.target_tube(name, rings=15)
    rig = c.armature(f"{name}Rig", c.tube_bones())
    c.deform(target, rig)
    return target, rig


def placed(ob, rig, matrix, applied):
    """The character under a transform, of its objects or applied to their data."""
    if applied:
        ob.data.transform(matrix)
        rig.data.transform(matrix)
        ob.data.update()
    else:
        rig.matrix_world = matrix
    bpy.context.view_layer.update()


def expected(source, method):
    plain, _ = target_with_rig("Plain")
    c.add_landmarks(source, plain, LANDMARKS)
    c.retarget(source, plain, method=method)
    return c.dense(plain, NAMES)


@pytest.mark.parametrize("applied", [True, False])
@pytest.mark.parametrize(
    "matrix",
    [
        Matrix.Scale(0.01, 4),
        Matrix.Scale(100, 4),
        Euler((np.pi / 2, 0, 0)).to_matrix().to_4x4(),
        Matrix.Scale(0.01, 4) @ Euler((-np.pi / 2, 0, 0)).to_matrix().to_4x4(),
        Matrix.Scale(-1, 4, (1, 0, 0)),
    ],
    ids=["1:100", "100:1", "y-up", "1:100 y-up", "mirrored"],
)
def test_scale_up_axis_and_mirrored_objects(matrix, applied):
    source, _ = c.source_tube()
    # A round tube looks alike from all sides: its mirror image is met at other angles by method auto.
    method = "PAPER" if matrix.is_negative else "AUTO"
    wanted = expected(source, method)
    target, rig = target_with_rig()
    placed(target, rig, matrix, applied)
    c.add_landmarks(source, target, LANDMARKS)
    assert c.retarget(source, target, method=method) == {"FINISHED"}
    found = c.dense(target, NAMES)
    np.testing.assert_allclose(found.sum(axis=1), 1, atol=1e-6)
    assert np.abs(found - wanted).sum(axis=1).mean() < 0.02


@pytest.mark.parametrize("applied", [True, False])
@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_bipeds_of_very_different_size(scale, applied):
    source, rig = c.biped("Source")
    c.paint(source, rig)
    c.deform(source, rig)
    target, own = c.biped("Target", arm=0.9, leg=0.9, voxel=0.06, seed=2)
    c.deform(target, own)
    turned = Matrix.Scale(scale, 4) @ Euler((np.pi / 2, 0, 0.5)).to_matrix().to_4x4()
    placed(target, own, turned, applied)
    assert c.retarget(source, target) == {"FINISHED"}
    names = c.bone_names(own)
    weights = c.dense(target, names)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    truth = c.mesh_object("Truth", [target.matrix_world @ v.co for v in target.data.vertices], [])
    painted = c.paint(truth, own, falloff=8.0 / scale)
    assert np.abs(weights - painted).sum(axis=1).mean() < 0.5


def test_target_of_only_loose_parts():
    """Four separate rings at the height of the bones, and a single loose vertex."""
    source, _ = c.source_tube()
    vertices, faces = [], []
    for height in (0.3, 1.2, 1.8, 2.7):
        ring, ring_faces = c.tube(9, 3, height=0.15, radius=0.6)
        faces += [tuple(len(vertices) + i for i in face) for face in ring_faces]
        vertices += [(x, y, z + height) for x, y, z in ring]
    vertices.append((0.6, 0, 2.9))
    target = c.mesh_object("Target", vertices, faces)
    assert c.retarget(source, target) == {"FINISHED"}
    weights = c.dense(target, NAMES)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert weights.min() >= 0
    assert "117 vertices" in target.dermis_retarget.result


def test_names_without_any_in_common_are_reported_side_by_side():
    source, _ = c.source_tube()
    target = c.target_tube()
    other = {"lower": "root", "middle": "belly", "upper": "crown"}
    own = c.armature("Own", [(other[n], p and other[p], h, t) for n, p, h, t in c.tube_bones()])
    c.deform(target, own)
    c.retarget(source, target)
    note = "No bone names in common with 'Target', check the bones: "
    assert note + "'lower' to 'root', 'middle' to 'belly', 'upper' to 'crown'." in target.dermis_retarget.result


def test_skeletons_with_nothing_in_common(monkeypatch):
    source, _ = c.source_tube()
    target = c.target_tube()
    own = c.armature("Own", [("only", None, (0, 0, 0), (0, 0, 3))])
    c.deform(target, own)
    before = c.state(target)
    bones, native = sys.modules[f"{MODULE}.core.bones"], sys.modules["dermis_native"]

    def nothing(_source, _target):
        raise native.RetargetError("no bone of the source has a counterpart in the target")

    monkeypatch.setattr(bones, "map_bones", nothing)
    names = "'SourceRig' has 'lower', 'middle', 'upper'; 'Own' has 'only'"
    with pytest.raises(RuntimeError, match=f"{names}.*Nothing was changed"):
        c.retarget(source, target)
    with pytest.raises(RuntimeError, match=f"{names}.*Nothing was changed"):
        bpy.ops.dermis.map_bones()
    assert c.state(target) == before
    kept = target.dermis_retarget
    kept.bone_map_source = bpy.data.objects["SourceRig"]
    row = kept.bone_map.add()
    row.source = "lower"
    with pytest.raises(
        RuntimeError, match=r"The bone list from 'SourceRig' to 'Own' cannot be used.*Nothing was changed"
    ):
        c.retarget(source, target)
    row.target = "only"
    assert c.retarget(source, target) == {"FINISHED"}
