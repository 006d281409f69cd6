# SPDX-License-Identifier: GPL-3.0-or-later
"""Rest shape or the shape that is shown."""

import sys

import bpy
import characters as c
import numpy as np
import pytest
from mathutils import Matrix
from scratch_profile import MODULE


def surface(ob, evaluated):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return sys.modules[f"{MODULE}.blender.mesh"].read_surface(ob, depsgraph, evaluated)


def bones(rig, posed):
    depsgraph = bpy.context.evaluated_depsgraph_get() if posed else None
    return sys.modules[f"{MODULE}.blender.armature"].read_bones(rig, depsgraph)


def test_surface_is_in_world_space():
    ob = c.target_tube()
    ob.matrix_world = Matrix.Translation((1, 2, 3)) @ Matrix.Diagonal((2, 3, 4, 1))
    bpy.context.view_layer.update()
    found = surface(ob, False)
    expected = np.array([v.co for v in ob.data.vertices]) * (2, 3, 4) + (1, 2, 3)
    np.testing.assert_allclose(found.vertices, expected, atol=1e-6)
    assert found.loop_counts.tolist() == [len(p.vertices) for p in ob.data.polygons]
    assert found.loop_indices.tolist() == [v for p in ob.data.polygons for v in p.vertices]


def test_mirrored_object_keeps_its_outside():
    ob = c.target_tube()
    ob.scale.x = -1
    bpy.context.view_layer.update()
    found = surface(ob, False)
    triangle = found.vertices[found.loop_indices[:3]]
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    assert normal @ (triangle.mean(axis=0) * (1, 1, 0)) > 0


def test_rest_ignores_shape_keys_modifiers_and_pose():
    ob, rig = c.source_tube()
    rest = surface(ob, False)
    ob.shape_key_add(name="Basis")
    key = ob.shape_key_add(name="Wide")
    for point in key.data:
        point.co.x *= 2
    key.value = 1.0
    rig.pose.bones["upper"].location = (0, 1, 0)
    ob.modifiers.new("Subdivision", "SUBSURF")
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(surface(ob, False).vertices, rest.vertices)
    shown = surface(ob, True)
    assert shown.vertices[:, 0].max() == pytest.approx(1.0)
    assert shown.vertices[:, 2].max() == pytest.approx(4.0, abs=0.02)
    assert ob.modifiers["Subdivision"].show_viewport


def test_posed_bones():
    _, rig = c.source_tube()
    rig.location.x = 1
    rig.pose.bones["upper"].location = (0, 1, 0)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(bones(rig, False).tails[2], (1, 0, 3), atol=1e-6)
    np.testing.assert_allclose(bones(rig, True).tails[2], (1, 0, 4), atol=1e-6)
    assert bones(rig, False).parents.tolist() == [-1, 0, 1]


def test_bones_under_a_bone_that_does_not_deform():
    _, rig = c.source_tube()
    rig.data.bones["middle"].use_deform = False
    found = bones(rig, False)
    assert found.names == ("lower", "upper")
    assert found.parents.tolist() == [-1, 0]


def test_same_pose_on_both_sides():
    """A source posed like the target gives good weights only with its evaluated geometry."""
    source, rig = c.source_tube()
    rig.pose.bones["middle"].rotation_mode = "XYZ"
    rig.pose.bones["middle"].rotation_euler = (1.2, 0, 0)
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    posed = source.evaluated_get(depsgraph).data
    target = c.mesh_object("Target", [v.co for v in posed.vertices], [tuple(p.vertices) for p in posed.polygons])
    own = c.armature("Own", [(b.name, b.parent and b.parent.name, b.head, b.tail) for b in rig.pose.bones])
    c.deform(target, own)
    assert c.retarget(source, target, source_geometry="EVALUATED") == {"FINISHED"}
    names = c.bone_names(rig)
    assert np.abs(c.dense(target, names) - c.dense(source, names)).sum(axis=1).mean() < 0.1


def test_geometry_nodes_that_change_the_topology_are_left_out():
    ob, _ = c.source_tube()
    ob.modifiers.new("Array", "ARRAY")
    found = surface(ob, True)
    assert len(found.vertices) == len(ob.data.vertices)
    assert ob.modifiers["Array"].show_viewport
