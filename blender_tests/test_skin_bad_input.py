# SPDX-License-Identifier: GPL-3.0-or-later
"""What a skin cannot work with: a clear error that names it, and nothing changed; later, the plain skin."""

import bpy
import characters as c
import numpy as np
import pytest
import skins as s
from mathutils import Matrix


def everything():
    result = {}
    for ob in bpy.data.objects:
        if ob.type == "MESH":
            keys = ob.data.shape_keys
            result[ob.name] = (
                c.state(ob),
                keys and [(k.name, k.value, [repr(tuple(p.co)) for p in k.points]) for k in keys.key_blocks],
                {key: ob.dermis_skin.is_property_set(key) for key in ob.dermis_skin.bl_rna.properties.keys()},  # noqa: SIM118
            )
    return result


def refused(*objects, match):
    c.activate(*objects)
    bpy.context.view_layer.update()
    before = everything()
    with pytest.raises(RuntimeError, match=match) as caught:
        bpy.ops.dermis.skin_enable()
    assert everything() == before
    assert str(caught.value).rstrip().endswith("Nothing was changed.")


def fails_later(ob, rig, change, match):
    """A change after enabling shows the plain skin and one line; undoing it brings the skin back."""
    s.enable(rig)
    s.bend(rig, 80)
    good = s.shown(ob)
    change(True)
    bpy.context.view_layer.update()
    bpy.context.scene.frame_set(2)
    assert match in s.state(ob).error
    assert "\n" not in s.state(ob).error
    assert not s.correction(ob).any()
    change(False)
    bpy.context.view_layer.update()
    assert s.state(ob).error == ""
    np.testing.assert_array_equal(s.shown(ob), good)


def test_nothing_selected():
    with pytest.raises(RuntimeError, match="Make an armature active, or select its meshes"):
        bpy.ops.dermis.skin_enable()


def test_disabling_what_is_not_enabled():
    _, rig = s.limb()
    c.activate(rig)
    with pytest.raises(RuntimeError, match="No mesh here has a PBD skin"):
        bpy.ops.dermis.skin_disable()


def test_armature_without_meshes():
    rig = c.armature("Alone", c.tube_bones())
    refused(rig, match="No mesh follows the armature 'Alone'")


def test_no_armature():
    refused(c.target_tube(), match="'Target' has no armature")


def test_armature_modifier_without_armature():
    ob, _ = s.limb()
    ob.modifiers["Armature"].object = None
    refused(ob, match="'Limb' has no armature")


def test_no_vertex_groups():
    ob, _ = s.limb()
    ob.vertex_groups.clear()
    refused(ob, match="'Limb' has no vertex groups")


def test_no_weights():
    ob, _ = s.limb()
    for group in ob.vertex_groups:
        group.remove(range(len(ob.data.vertices)))
    refused(ob, match="No vertex of 'Limb' has weight on a deforming bone of 'LimbRig'")


def test_single_bone():
    ob, _ = s.limb()
    for name in ("lower", "upper"):
        ob.vertex_groups.remove(ob.vertex_groups[name])
    refused(ob, match="'Limb' follows the single bone 'middle'")


def test_no_deforming_bone():
    ob, rig = s.limb()
    for bone in rig.data.bones:
        bone.use_deform = False
    refused(ob, match="no deforming bone")


def test_several_armature_modifiers():
    ob, rig = s.limb()
    ob.modifiers.new("Second", "ARMATURE").object = rig
    refused(ob, match="several Armature modifiers \\('Armature', 'Second'\\)")
    ob.modifiers["Second"].show_viewport = ob.modifiers["Second"].show_render = False
    s.enable(ob)


def test_parent_by_armature_deform():
    ob, rig = s.limb()
    ob.parent, ob.parent_type = rig, "ARMATURE"
    refused(ob, match="parented to 'LimbRig' by Armature Deform")


def test_no_faces():
    ob, rig = s.limb()
    dot = c.mesh_object("Dot", [(0, 0, 1)], [])
    for name, weight in (("lower", 0.5), ("middle", 0.5)):
        dot.vertex_groups.new(name=name).add([0], weight, "REPLACE")
    c.deform(dot, rig)
    refused(dot, match="'Dot' has 1 vertex and no faces")
    assert not ob.dermis_skin.enabled


def test_one_bad_mesh_among_good_ones():
    ob, rig = s.limb()
    other = c.mesh_object("Other", *c.tube(8, 5))
    c.deform(other, rig)
    refused(ob, other, match="'Other' has no vertex groups")
    assert not ob.dermis_skin.enabled


def test_not_finite_coordinates():
    ob, _ = s.limb()
    ob.data.vertices[3].co.x = float("nan")
    refused(ob, match="'Limb' has coordinates that are not finite at 1 vertex, the first is vertex 3")


def test_shared_mesh():
    ob, rig = s.limb()
    twin = bpy.data.objects.new("Twin", ob.data)
    bpy.context.collection.objects.link(twin)
    refused(ob, match="The mesh 'Limb' is used by 'Limb', 'Twin'.*Make Single User")
    bpy.data.objects.remove(twin)
    s.enable(rig)
    twin = bpy.data.objects.new("Twin", ob.data)
    bpy.context.collection.objects.link(twin)
    s.bend(rig, 60)
    assert "is used by 'Limb', 'Twin'" in s.state(ob).error


def test_linked_and_overridden(tmp_path):
    ob, rig = s.limb()
    s.bend(rig, 60)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.objects = ["Limb", "LimbRig"]
    for ob in wanted.objects:
        bpy.context.collection.objects.link(ob)
    refused(bpy.data.objects["Limb"], match="The object 'Limb' is linked from .*bake the skin")
    override = bpy.data.objects["Limb"].override_create(remap_local_usages=True)
    refused(override, match="The object 'Limb' is a library override.*Bake Point Cache")


def test_linked_skin_shows_why_it_stands_still(tmp_path):
    _, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 60)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.objects = ["Limb", "LimbRig"]
    for ob in wanted.objects:
        bpy.context.collection.objects.link(ob)
    ob, rig = wanted.objects
    bpy.context.view_layer.update()
    bpy.context.scene.frame_set(2)
    assert "is linked from" in s.state(ob).error
    assert ob.data.shape_keys.key_blocks["Dermis"].mute


@pytest.mark.parametrize("kind", ["MIRROR", "SUBSURF", "LATTICE"])
def test_modifier_before_the_armature(kind):
    ob, rig = s.limb()
    modifier = ob.modifiers.new("First", kind)
    ob.modifiers.move(1, 0)
    refused(ob, match="'First' before its Armature modifier 'Armature': move 'Armature' to the first place")
    modifier.show_viewport = modifier.show_render = False

    def change(bad):
        modifier.show_viewport = bad

    fails_later(ob, rig, change, "before its Armature modifier")


@pytest.mark.parametrize(
    ("setting", "bad", "match"),
    [
        ("use_bone_envelopes", True, "switch Bone Envelopes off"),
        ("use_vertex_groups", False, "switch Vertex Groups on"),
        ("use_multi_modifier", True, "uses Multi Modifier"),
    ],
)
def test_modifier_settings(setting, bad, match):
    ob, rig = s.limb()
    modifier = ob.modifiers["Armature"]
    setattr(modifier, setting, bad)
    refused(ob, match=match)
    setattr(modifier, setting, not bad)
    fails_later(ob, rig, lambda wrong: setattr(modifier, setting, wrong == bad), match)


def test_bones_that_multiply_by_envelopes():
    ob, rig = s.limb()
    rig.data.bones["upper"].use_envelope_multiply = True
    refused(ob, match="multiply their weights on 'Limb' by envelopes: 'upper'")


def test_pinned_shape_key():
    ob, rig = s.limb()
    ob.shape_key_add(name="Basis")
    ob.show_only_shape_key = True
    refused(ob, match="'Limb' shows one shape key alone")
    ob.show_only_shape_key = False
    fails_later(ob, rig, lambda bad: setattr(ob, "show_only_shape_key", bad), "shows one shape key alone")


def test_absolute_shape_keys():
    ob, rig = s.limb()
    ob.shape_key_add(name="Basis")
    ob.data.shape_keys.use_relative = False
    refused(ob, match="The shape keys of 'Limb' are absolute")
    ob.data.shape_keys.use_relative = True
    fails_later(ob, rig, lambda bad: setattr(ob.data.shape_keys, "use_relative", not bad), "are absolute")


def test_a_shape_key_of_that_name():
    ob, _ = s.limb()
    ob.shape_key_add(name="Basis")
    ob.shape_key_add(name="Dermis")
    refused(ob, match="'Limb' already has a shape key named 'Dermis'")


def test_removed_shape_key():
    ob, rig = s.limb()
    s.enable(rig)
    ob.shape_key_remove(ob.data.shape_keys.key_blocks["Dermis"])
    s.bend(rig, 60)
    assert "The shape key 'Dermis' of 'Limb' is gone" in s.state(ob).error
    s.enable(rig)
    assert s.state(ob).error == ""
    assert s.correction(ob).any()
    s.disable(rig)
    assert ob.data.shape_keys is None, "the Basis came with the skin and goes with it"


def test_flattened_object():
    ob, _ = s.limb()
    ob.scale.z = 0.0
    refused(ob, match="'Limb' is scaled to zero along some axis")


def test_pose_that_is_not_finite():
    ob, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 60)
    good = s.shown(ob)
    rig.pose.bones["upper"].location.x = float("nan")
    bpy.context.view_layer.update()
    assert "1 bone has a pose in 'LimbRig' that is not finite: 'upper'" in s.state(ob).error
    assert not s.correction(ob).any()
    rig.pose.bones["upper"].location.x = 0.0
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(s.shown(ob), good)


@pytest.mark.parametrize("scale", [(0.0, 0.0, 0.0), (-1.0, 1.0, 1.0), (3.0, 0.2, 1.0), (1e-30, 1e30, 1.0)])
def test_scaled_bones(scale):
    ob, rig = s.limb()
    s.enable(rig)
    rig.pose.bones["middle"].scale = scale
    s.bend(rig, 60)
    assert np.isfinite(s.correction(ob)).all()
    s.bend(rig, 0)
    rig.pose.bones["middle"].scale = (1, 1, 1)
    s.bend(rig, 60)
    np.testing.assert_allclose(s.shown(ob), s.solved(ob, rig), atol=1e-5 * s.HEIGHT)


def test_short_bones_and_open_messy_meshes():
    """A bone of almost no length, an open tube with a stray face and a double vertex."""
    rig = c.armature("Rig", [*c.tube_bones(), ("tip", "upper", (0, 0, 3), (0, 0, 3.00001))])
    vertices, faces = c.tube(10, 13)
    count = len(vertices)
    vertices += [vertices[0], (0.2, 0.1, 1.5), (0.3, 0.1, 1.5)]
    ob = c.mesh_object("Messy", vertices, [*faces[:-20], (count, count + 1, count + 2), (3, 40, 90)])
    c.paint(ob, rig)
    c.deform(ob, rig)
    s.enable(rig)
    rig.pose.bones["middle"].rotation_mode = "XYZ"
    s.bend(rig, 70)
    assert s.state(ob).error == ""
    assert np.isfinite(s.shown(ob)).all()


def test_thin_sheet():
    rig = c.armature("Rig", c.tube_bones())
    vertices = [(x, 0, z) for z in np.linspace(0, 3, 31) for x in np.linspace(-0.5, 0.5, 5)]
    faces = [(r * 5 + i, r * 5 + i + 1, r * 5 + i + 6, r * 5 + i + 5) for r in range(30) for i in range(4)]
    ob = c.mesh_object("Sheet", vertices, faces)
    c.paint(ob, rig, falloff=2.0)
    c.deform(ob, rig)
    s.enable(rig)
    rig.pose.bones["middle"].rotation_mode = "XYZ"
    s.bend(rig, 70)
    assert s.state(ob).error == ""
    assert np.isfinite(s.shown(ob)).all()


def test_unexpected_failure_is_one_line(monkeypatch):
    import sys

    from scratch_profile import MODULE

    ob, rig = s.limb()
    s.enable(rig)

    def broken(*_):
        raise ZeroDivisionError("no such thing")

    monkeypatch.setattr(sys.modules[f"{MODULE}.blender.skin_update"], "conjugated", broken)
    s.bend(rig, 60)
    assert s.state(ob).error == "Unexpected ZeroDivisionError: No such thing."
    assert not s.correction(ob).any()
    monkeypatch.undo()
    s.bend(rig, 61)
    assert s.state(ob).error == ""


def test_moving_the_mesh_away_from_its_bones():
    """The Armature modifier goes on with the object's own place; so does the skin."""
    ob, rig = s.limb()
    s.enable(rig)
    s.bend(rig, 60)
    ob.matrix_world = Matrix.Translation((0.4, 0, 0))
    bpy.context.view_layer.update()
    assert s.state(ob).error == ""
    assert np.isfinite(s.shown(ob)).all()
    assert s.correction(ob).any()
