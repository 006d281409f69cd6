# SPDX-License-Identifier: GPL-3.0-or-later
"""FBX and glTF: what comes back from the file is within a millimetre on a body of 1.8 m."""

import addon_utils
import bakes as b
import bpy
import characters as c
import numpy as np
import pytest
import skins as s

HEIGHT = 1.8
MILLIMETRE = 1e-3
POSED = (1, 4, 7, 10, 13)


@pytest.fixture
def figure():
    """A biped of 1.8 m with bent and twisted joints, its skin live."""
    ob, rig = c.biped("Body", voxel=0.05)
    for bone in rig.pose.bones:
        bone.rotation_mode = "XYZ"
    c.paint(ob, rig, falloff=30.0)
    c.deform(ob, rig)
    s.animate(rig, ((1, 0.0), (7, 80.0), (13, 20.0)), "hand.L", 0)
    s.animate(rig, ((1, 0.0), (13, 60.0)), "hand.R", 1)
    s.animate(rig, ((1, 0.0), (7, 90.0), (13, 10.0)), "shin.L", 0)
    s.animate(rig, ((1, 0.0), (13, 50.0)), "thigh.R", 0)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 13
    s.enable(rig)
    points = np.array([v.co for v in ob.data.vertices])
    assert np.ptp(points[:, 2]) == pytest.approx(HEIGHT, abs=0.15)
    return ob, rig


def in_world(ob):
    return s.in_world(ob, s.shown(ob))


def round_trip(kind, path, objects):
    """Export the objects, forget them, import the file; the mesh that came back."""
    # Blender as a module enables its own exchange add-ons only when asked.
    addon_utils.enable("io_scene_fbx" if kind == "fbx" else "io_scene_gltf2")
    c.activate(*objects)
    if kind == "fbx":
        bpy.ops.export_scene.fbx(
            filepath=str(path), use_selection=True, bake_anim=True, bake_anim_simplify_factor=0.0,
            add_leaf_bones=False, use_mesh_modifiers=False, bake_anim_use_all_actions=False,
            bake_anim_use_nla_strips=False,
        )  # fmt: skip
    else:
        bpy.ops.export_scene.gltf(
            filepath=str(path), use_selection=True, export_format="GLB", export_morph=True,
            export_morph_animation=True, export_force_sampling=True, export_animation_mode="SCENE",
            export_all_influences=True, export_anim_scene_split_object=False,
        )  # fmt: skip
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if kind == "fbx":
        bpy.ops.import_scene.fbx(filepath=str(path), anim_offset=0.0)
    else:
        bpy.ops.import_scene.gltf(filepath=str(path))
    return next(ob for ob in bpy.data.objects if ob.type == "MESH" and ob.find_armature())


def matched(points, others):
    """For each point the nearest other one at rest: exporters may split and reorder vertices."""
    distance = np.linalg.norm(points[:, None] - others[None], axis=2)
    assert distance.min(axis=1).max() < 1e-4
    return distance.argmin(axis=1)


@pytest.mark.parametrize("output", ["DRIVERS", "KEYFRAMES"])
# Of Blender's own exporters.
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("kind", ["fbx", "glb"])
def test_driven_keys_come_back(figure, tmp_path, kind, output):
    ob, rig = figure
    bpy.context.scene.frame_set(7)
    assert b.bake(rig, operator="bake_driven_keys", output=output) == {"FINISHED"}
    bpy.context.scene.frame_set(1)
    rest = in_world(ob)
    expected = {}
    for frame in POSED:
        bpy.context.scene.frame_set(frame)
        expected[frame] = in_world(ob)
    back = round_trip(kind, tmp_path / f"figure.{kind}", (ob, rig))
    scene = bpy.context.scene
    scene.frame_set(1)
    order = matched(rest, in_world(back))
    moved = 0.0
    for frame, wanted in expected.items():
        scene.frame_set(frame)
        shown = in_world(back)[order]
        assert np.abs(shown - wanted).max() < MILLIMETRE, frame
        moved = max(moved, np.abs(wanted - rest).max())
    assert moved > 0.3
    values = [key.value for key in back.data.shape_keys.key_blocks[1:]]
    assert any(value > 0.05 for value in values), "the keys came along and act"
