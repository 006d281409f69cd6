# SPDX-License-Identifier: GPL-3.0-or-later
"""The PBD skin under a live Armature modifier: what Blender shows is what the solver says."""

import sys
from types import SimpleNamespace

import bpy
import characters as c
import numpy as np
import pytest
import skins as s
from mathutils import Matrix
from scratch_profile import MODULE

TOLERANCE = 1e-5 * s.HEIGHT


def keys_of(ob):
    keys = ob.data.shape_keys
    if keys is None:
        return None
    return [
        (k.name, k.value, k.mute, k.relative_key.name, k.vertex_group, [tuple(p.co) for p in k.points])
        for k in keys.key_blocks
    ], (ob.active_shape_key_index, keys.use_relative, keys.name)


def everything(ob):
    ours = {name: ob.dermis_skin.is_property_set(name) for name in ob.dermis_skin.bl_rna.properties.keys()}  # noqa: SIM118
    return c.state(ob), keys_of(ob), ours


def test_bending_keeps_volume_and_equals_the_solver():
    ob, rig = s.limb()
    s.enable(rig)
    for degrees, bone, axis in ((90, "middle", 0), (-60, "upper", 2), (120, "middle", 1)):
        s.bend(rig, degrees, bone, axis)
        wanted = s.solved(ob, rig)
        assert np.abs(wanted - s.plain(ob)).max() > 0.01, "the solver corrects this pose"
        np.testing.assert_allclose(s.shown(ob), wanted, atol=TOLERANCE)
    assert s.state(ob).error == ""
    assert s.state(ob).stats["tetrahedra"] > 0


def test_rest_pose_keeps_its_bits():
    ob, rig = s.limb()
    before = s.shown(ob).tobytes()
    s.enable(rig)
    assert s.shown(ob).tobytes() == before
    s.bend(rig, 80)
    assert s.shown(ob).tobytes() != before
    s.bend(rig, 0)
    assert s.shown(ob).tobytes() == before
    assert not s.correction(ob).any()


def test_preserve_volume():
    ob, rig = s.limb()
    ob.modifiers["Armature"].use_deform_preserve_volume = True
    s.enable(rig)
    s.bend(rig, 100)
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig, skinning="dual_quaternion"), atol=TOLERANCE)
    ob.modifiers["Armature"].use_deform_preserve_volume = False
    bpy.context.view_layer.update()
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig), atol=TOLERANCE)


@pytest.mark.parametrize("preserve", [False, True])
@pytest.mark.parametrize("segments", [1, 4])
@pytest.mark.parametrize("size", [1.0, 0.02])
def test_scaled_bones(preserve, segments, size):
    """Evenly, unevenly and against a parent's turn; the bones lie at any roll, the armature is scaled too."""
    ob, rig = s.limb()
    rig.scale = (size, size, size)
    c.activate(rig)
    bpy.ops.object.mode_set(mode="EDIT")
    for bone, roll in zip(rig.data.edit_bones, (0.3, -0.8, 1.1), strict=True):
        bone.roll = roll
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.data.bones["middle"].bbone_segments = segments
    ob.modifiers["Armature"].use_deform_preserve_volume = preserve
    bpy.context.view_layer.update()
    s.enable(rig)
    rig.pose.bones["lower"].scale = (1.2, 1.1, 0.9)
    rig.pose.bones["middle"].scale = (0.8, 1.3, 1.0)
    rig.pose.bones["upper"].scale = (1.5, 1.5, 1.5)
    s.bend(rig, 70)
    s.bend(rig, -50, "upper", 2)
    state = s.state(ob)
    deltas = state.reading.layout.deltas(rig.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    to_solver = state.place.armature
    transforms = to_solver @ deltas @ np.linalg.inv(to_solver)
    linear = state.place.object[:3, :3]
    np.testing.assert_allclose(s.plain(ob) @ linear.T, state.skin.plain(transforms), atol=TOLERANCE * size)
    np.testing.assert_allclose(s.shown(ob) @ linear.T, state.skin.solved(transforms), atol=TOLERANCE * size)
    assert np.abs(s.shown(ob) - s.plain(ob)).max() > 0.005
    if segments == 1 and size == 1.0:
        skinning = "dual_quaternion" if preserve else "linear"
        np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig, skinning=skinning), atol=TOLERANCE)


TURN = Matrix.Rotation(0.7, 4, (1, 2, 3))
PLACES = {
    "turned": (TURN, TURN),
    "scaled": (Matrix.Diagonal((0.1, 0.1, 0.1, 1)) @ TURN, Matrix.Identity(4)),
    "stretched": (Matrix.Diagonal((1, 2, 0.5, 1)), Matrix.Diagonal((1, 2, 0.5, 1))),
    "mirrored": (Matrix.Diagonal((-1, 1, 1, 1)), Matrix.Diagonal((-1, 1, 1, 1))),
    "sheared": (Matrix.Shear("XY", 4, (0.3, 0.2)) @ TURN, Matrix.Shear("XY", 4, (0.3, 0.2))),
}


@pytest.mark.parametrize("preserve", [False, True])
@pytest.mark.parametrize("place", PLACES)
def test_transforms(place, preserve):
    """Object and armature anywhere: the mesh lies on the bones in world space, whatever its own space is."""
    ob, rig = s.limb()
    ob.parent = None
    mesh_matrix, rig_matrix = PLACES[place]
    rig.matrix_world = rig_matrix
    bpy.context.view_layer.update()
    ob.data.transform(mesh_matrix.inverted() @ rig_matrix)
    ob.parent = rig
    ob.matrix_parent_inverse = rig_matrix.inverted() @ mesh_matrix
    bpy.context.view_layer.update()
    ob.modifiers["Armature"].use_deform_preserve_volume = preserve
    s.enable(rig)
    s.bend(rig, 80)
    size = np.abs(np.array(rig_matrix)[:3, :3]).max()
    wanted = s.solved(ob, rig, skinning="dual_quaternion" if preserve else "linear")
    np.testing.assert_allclose(s.in_world(ob, s.shown(ob)), wanted, atol=TOLERANCE * size)


def test_a_walking_character_does_not_change_its_skin():
    ob, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 80)
    before = s.correction(ob)
    assert before.any()
    rig.matrix_world = Matrix.Translation((12, -7, 3)) @ Matrix.Rotation(1.1, 4, "Z")
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(s.correction(ob), before)


def test_unnormalised_missing_and_foreign_weights():
    ob, rig = s.limb()
    everyone = range(len(ob.data.vertices))
    ob.vertex_groups["upper"].add(list(everyone)[::3], 2.0 / 3.0, "ADD")
    for group in ob.vertex_groups:
        group.remove([5, 6, 7])
    ob.vertex_groups.new(name="Not a bone").add(everyone, 0.5, "REPLACE")
    rig.data.bones["upper"].use_deform = False
    s.enable(rig)
    s.bend(rig, 80)
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig), atol=TOLERANCE)


@pytest.mark.parametrize("invert", [False, True])
@pytest.mark.parametrize("preserve", [False, True])
def test_modifier_mask(invert, preserve):
    """The mask of the Armature modifier lets vertices follow the skin in part."""
    ob, rig = s.limb()
    weights = np.linspace(0, 1, len(ob.data.vertices), dtype=np.float32)
    mask = ob.vertex_groups.new(name="Mask")
    for vertex, weight in enumerate(weights):
        mask.add([vertex], float(weight), "REPLACE")
    modifier = ob.modifiers["Armature"]
    modifier.vertex_group, modifier.invert_vertex_group = "Mask", invert
    modifier.use_deform_preserve_volume = preserve
    s.enable(rig)
    s.bend(rig, 80)
    share = (1 - weights if invert else weights)[:, None]
    rest = np.array([v.co for v in ob.data.vertices])
    wanted = rest + share * (s.solved(ob, rig, skinning="dual_quaternion" if preserve else "linear") - rest)
    np.testing.assert_allclose(s.shown(ob), wanted, atol=TOLERANCE)


def test_influence_and_mask_of_the_correction():
    ob, rig = s.limb()
    half = ob.vertex_groups.new(name="Half")
    half.add(range(len(ob.data.vertices)), 0.5, "REPLACE")
    s.enable(rig)
    s.bend(rig, 80)
    full, none = s.shown(ob), s.plain(ob)
    key = ob.data.shape_keys.key_blocks["Dermis"]
    key.value = 0.5
    bpy.context.view_layer.update()
    np.testing.assert_allclose(s.shown(ob), (full + none) / 2, atol=TOLERANCE)
    key.value = 1.0
    ob.dermis_skin.mask_group = "Half"
    bpy.context.view_layer.update()
    np.testing.assert_allclose(s.shown(ob), (full + none) / 2, atol=TOLERANCE)
    ob.dermis_skin.mask_group = ""
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(s.shown(ob), full)


def test_bendy_bones_follow_their_segments():
    """What the skin adds is what the solver adds to its own plain skin of the segments."""
    ob, rig = s.limb()
    rig.data.bones["middle"].bbone_segments = 6
    bpy.context.view_layer.update()
    s.enable(rig)
    s.bend(rig, 70)
    s.bend(rig, 50, "upper")
    state = s.state(ob)
    assert len(state.reading.layout.bones) == 3 - 1 + 7
    deltas = state.reading.layout.deltas(rig.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    # The object stands at the origin: its space is the solver's.
    np.testing.assert_allclose(s.plain(ob), state.skin.plain(deltas), atol=TOLERANCE)
    np.testing.assert_allclose(s.shown(ob), state.skin.solved(deltas), atol=TOLERANCE)
    assert np.abs(s.shown(ob) - s.plain(ob)).max() > 0.005


def test_other_shape_keys_act_before_the_skin():
    ob, rig = s.limb()
    ob.shape_key_add(name="Basis")
    fat = ob.shape_key_add(name="Fat")
    for point in fat.points:
        point.co.x *= 1.3
        point.co.y *= 1.3
    ob.vertex_groups.new(name="Top").add(range(200, len(ob.data.vertices)), 0.5, "REPLACE")
    fat.vertex_group = "Top"
    driver = fat.driver_add("value").driver
    driver.expression = "0.7"
    s.enable(rig)
    s.bend(rig, 80)
    rest = np.array([v.co for v in ob.data.vertices])
    share = np.where(np.arange(len(rest)) >= 200, 0.5, 0.0)[:, None]
    shape = rest + 0.7 * share * (np.array([p.co for p in fat.points]) - rest)
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig, vertices=shape), atol=TOLERANCE)
    assert ob.active_shape_key_index == 1 or ob.active_shape_key.name in ("Basis", "Fat")
    # A key of full value that is muted does nothing.
    fat.mute = True
    bpy.context.view_layer.update()
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig), atol=TOLERANCE)


def test_later_modifiers_keep_working():
    ob, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 80)
    before = s.shown(ob)
    ob.modifiers.new("Subdivision", "SUBSURF")
    bpy.context.view_layer.update()
    assert len(s.shown(ob)) > len(before)
    assert s.state(ob).error == ""


@pytest.mark.parametrize("with_keys", [False, True])
def test_disabling_leaves_the_file_as_it_was(with_keys):
    ob, rig = s.limb()
    if with_keys:
        ob.shape_key_add(name="Basis")
        ob.shape_key_add(name="Other").value = 0.25
        ob.active_shape_key_index = 1
    before, rig_before = everything(ob), c.activate(ob)
    s.enable(ob)
    s.bend(rig, 80)
    s.bend(rig, 0)
    assert everything(ob) != before
    s.disable(ob)
    assert everything(ob) == before
    assert s.state(ob) is None
    assert rig_before is None


def test_the_selected_meshes_alone():
    first, rig = s.limb()
    second = c.mesh_object("Second", *c.tube(12, 13))
    c.paint(second, rig)
    c.deform(second, rig)
    bpy.context.view_layer.update()
    s.enable(second)
    assert (first.dermis_skin.enabled, second.dermis_skin.enabled) == (False, True)
    s.enable(rig)
    assert first.dermis_skin.enabled
    s.bend(rig, 80)
    assert s.correction(first).any()
    assert s.correction(second).any()
    s.disable(rig)
    assert not first.dermis_skin.enabled
    assert not second.dermis_skin.enabled


def test_rigid_meshes_of_an_armature_are_left_out():
    ob, rig = s.limb()
    button = c.mesh_object("Button", *c.tube(6, 3, 0.2, 0.1))
    button.vertex_groups.new(name="upper").add(range(len(button.data.vertices)), 1, "REPLACE")
    c.deform(button, rig)
    s.enable(rig)
    assert ob.dermis_skin.enabled
    assert not button.dermis_skin.enabled
    assert button.data.shape_keys is None


def test_meshes_that_only_hang_on_the_armature():
    """A hat without a modifier and a mesh without weights are no reason to refuse the body."""
    ob, rig = s.limb()
    hat = c.mesh_object("Hat", *c.tube(6, 3, 0.2, 0.1))
    hat.parent = rig
    bare = c.mesh_object("Bare", *c.tube(6, 3, 0.2, 0.1))
    c.deform(bare, rig)
    s.enable(rig)
    assert [mesh.dermis_skin.enabled for mesh in (ob, hat, bare)] == [True, False, False]


def test_rest_position_of_the_armature():
    ob, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 80)
    bent = s.shown(ob)
    rig.data.pose_position = "REST"
    bpy.context.view_layer.update()
    assert not s.correction(ob).any()
    rig.data.pose_position = "POSE"
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(s.shown(ob), bent)


def test_settings_rebuild_the_skin():
    ob, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 100)
    first = s.shown(ob)
    ob.dermis_skin.iterations = 40
    bpy.context.view_layer.update()
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig, iterations=40), atol=TOLERANCE)
    assert np.abs(s.shown(ob) - first).max() > 1e-4
    ob.dermis_skin.preset = "RUMMAN_FRATARCANGELI"
    bpy.context.view_layer.update()
    assert ob.dermis_skin.self_collision is False
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig, preset="rumman_fratarcangeli"), atol=TOLERANCE)
    ob.dermis_skin.preset = "DEFAULT"
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(s.shown(ob), first)
    tetrahedra = s.state(ob).stats["tetrahedra"]
    ob.dermis_skin.cell_size = 0.125
    bpy.context.view_layer.update()
    assert s.state(ob).stats["tetrahedra"] != tetrahedra
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig, cell_size=0.125), atol=TOLERANCE)


def test_stiffness_group():
    ob, rig = s.limb()
    share = np.linspace(0, 1, len(ob.data.vertices), dtype=np.float32)
    group = ob.vertex_groups.new(name="Firm")
    for vertex, weight in enumerate(share):
        group.add([vertex], float(weight), "REPLACE")
    settings = ob.dermis_skin
    settings.energy, settings.volume, settings.stiffness = 1.0, 0.0, 50.0
    s.enable(rig)
    s.bend(rig, 100)
    even = s.shown(ob)
    settings.stiffness_group = "Firm"
    bpy.context.view_layer.update()
    wanted = s.solved(ob, rig, energy=1.0, volume=0.0, stiffness=50.0, stiffness_shares=share)
    np.testing.assert_allclose(s.shown(ob), wanted, atol=TOLERANCE)
    assert np.abs(s.shown(ob) - even).max() > 1e-3
    settings.stiffness_group = "Missing"
    bpy.context.view_layer.update()
    assert "no vertex group 'Missing'" in s.state(ob).error
    settings.stiffness_group = ""
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(s.shown(ob), even)


def test_a_setting_that_is_being_dragged_waits(monkeypatch):
    """In a window a skin is built when the value has settled, and a render does not wait."""
    ob, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 100)
    module = sys.modules[f"{MODULE}.ui.skin_properties"]
    timers = []
    app = SimpleNamespace(
        background=False,
        timers=SimpleNamespace(is_registered=timers.__contains__, register=lambda f, **_: timers.append(f)),
    )
    monkeypatch.setattr(module, "bpy", SimpleNamespace(app=app))
    first, skin = s.shown(ob), s.state(ob).skin
    for iterations in (12, 25, 40):
        ob.dermis_skin.iterations = iterations
        bpy.context.view_layer.update()
        assert s.state(ob).skin is skin
    (settle,) = timers
    assert settle() > 0, "the last value is too young"
    np.testing.assert_array_equal(s.shown(ob), first)
    s.state(ob).hold_until = 1e-9
    assert settle() is None
    bpy.context.view_layer.update()
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig, iterations=40), atol=TOLERANCE)


def test_near_singular_vertices_are_limited_and_counted():
    ob, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 180, "middle", 1)
    assert s.state(ob).limited > 0
    assert np.isfinite(s.shown(ob)).all()
    s.bend(rig, 60, "middle", 1)
    assert s.state(ob).limited == 0
