# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad input: a clear error that names the element, and nothing changed."""

import bpy
import characters as c
import numpy as np
import pytest


def painted_target(name="Target"):
    """A target with groups, weights and a modifier, so that a change would show."""
    target = c.target_tube(name)
    target.vertex_groups.new(name="Mask").add([2, 4], 0.25, "REPLACE")
    target.vertex_groups.new(name="upper").add([1, 3, 4], 0.75, "REPLACE")
    target.vertex_groups["upper"].lock_weight = True
    target.modifiers.new("Smooth", "SMOOTH")
    target.vertex_groups.active_index = 0
    return target


def refused(source, *targets, match, **options):
    """The operator fails with the message and leaves all objects as they were."""
    c.activate(source, *targets)
    bpy.context.view_layer.update()
    before = {ob.name: c.state(ob) for ob in bpy.data.objects if ob.type == "MESH"}
    with pytest.raises(RuntimeError, match=match) as caught:
        c.retarget(source, *targets, **options)
    assert {ob.name: c.state(ob) for ob in bpy.data.objects if ob.type == "MESH"} == before
    return str(caught.value)


def failed(source, *targets, match, **options):
    message = refused(source, *targets, match=match, **options)
    assert message.rstrip().endswith("Nothing was changed.")
    return message


def test_no_target():
    source, _ = c.source_tube()
    refused(source, match="Select the target meshes too")


def test_active_object_is_no_mesh():
    _, rig = c.source_tube()
    c.activate(rig, c.target_tube())
    with pytest.raises(RuntimeError, match="active object must be a mesh"):
        bpy.ops.dermis.retarget_weights()


def test_source_without_armature():
    source = c.target_tube("Source")
    source.vertex_groups.new(name="lower").add([0], 1, "REPLACE")
    failed(source, painted_target(), match="The source 'Source' has no armature")


def test_source_without_groups():
    source, _ = c.source_tube()
    source.vertex_groups.clear()
    failed(source, painted_target(), match="The source 'Source' has no vertex groups")


def test_source_with_groups_of_no_bone():
    source, _ = c.source_tube()
    for group in source.vertex_groups:
        group.name = f"Old {group.name}"
    failed(
        source, painted_target(), match=r"No vertex group of 'Source' \('Old lower', .* deforming bone of 'SourceRig'"
    )


def test_source_without_any_weight():
    source, _ = c.source_tube()
    for group in source.vertex_groups:
        group.remove(range(len(source.data.vertices)))
    failed(source, painted_target(), match="No vertex of 'Source' has weight on a bone")


def test_armature_without_deforming_bones():
    source, rig = c.source_tube()
    for bone in rig.data.bones:
        bone.use_deform = False
    failed(source, painted_target(), match="deforming bone of 'SourceRig'")


def test_target_without_faces():
    source, _ = c.source_tube()
    target = c.mesh_object("Target", [(0, 0, 0), (0, 0, 1), (0, 0, 2)], [])
    failed(source, target, match="'Target' has 3 vertices and no faces")


@pytest.mark.parametrize("count", [0, 1, 2])
def test_almost_no_vertices(count):
    source, _ = c.source_tube()
    target = c.mesh_object("Target", [(0, 0, i) for i in range(count)], [])
    words = "1 vertex" if count == 1 else f"{count} vertices"
    failed(source, target, match=f"'Target' has {words} and no faces")


def test_source_without_faces():
    _, rig = c.source_tube()
    bare = c.mesh_object("Bare", [(0, 0, 0), (0, 0, 1)], [])
    c.paint(bare, rig)
    c.deform(bare, rig)
    failed(bare, painted_target(), match="'Bare' has 2 vertices and no faces")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize("side", ["Source", "Target"])
def test_coordinates_that_are_not_finite(side, value):
    source, _ = c.source_tube()
    target = painted_target()
    position = bpy.data.objects[side].data.attributes["position"].data
    points = np.empty(3 * len(position), np.float32)
    position.foreach_get("vector", points)
    points[3 * 7 + 1] = value
    position.foreach_set("vector", points)
    failed(source, target, match=f"'{side}' has coordinates that are not finite at 1 vertex, the first is vertex 7")


def test_target_with_a_scale_of_zero():
    source, _ = c.source_tube()
    target = painted_target()
    target.scale.x = 0
    failed(source, target, match="'Target' is scaled to zero along some axis")


def test_mesh_used_by_several_objects():
    source, _ = c.source_tube()
    target = painted_target()
    bpy.context.collection.objects.link(bpy.data.objects.new("Twin", target.data))
    failed(source, target, match=r"used by 'Target', 'Twin', which .* use .*Make Single User")


def test_target_shares_the_mesh_of_the_source():
    source, _ = c.source_tube()
    twin = bpy.data.objects.new("Twin", source.data)
    bpy.context.collection.objects.link(twin)
    failed(source, twin, match="used by 'Source', 'Twin'")


def test_fake_user_is_no_second_user():
    source, _ = c.source_tube()
    target = painted_target()
    target.data.use_fake_user = True
    assert c.retarget(source, target) == {"FINISHED"}


def library_with_target(tmp_path):
    target = painted_target("Linked")
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {target})
    bpy.data.objects.remove(target)
    with bpy.data.libraries.load(path, link=True) as (_, names):
        names.objects = ["Linked"]
    return names.objects[0]


def test_linked_target(tmp_path):
    source, _ = c.source_tube()
    target = library_with_target(tmp_path)
    bpy.context.collection.objects.link(target)
    failed(source, target, match="The object 'Linked' is linked from .*library.blend.*Make Local")


def test_linked_mesh_of_a_local_target(tmp_path):
    source, _ = c.source_tube()
    mesh = library_with_target(tmp_path).data
    target = bpy.data.objects.new("Local", mesh)
    bpy.context.collection.objects.link(target)
    failed(source, target, match="The mesh '.*' is linked from")


def test_library_override(tmp_path):
    source, _ = c.source_tube()
    target = library_with_target(tmp_path).override_create(remap_local_usages=True)
    bpy.context.collection.objects.link(target)
    failed(source, target, match="The object 'Linked' is a library override")


def test_linked_source_is_fine(tmp_path):
    source, _ = c.source_tube()
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {source})
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, names):
        names.objects = ["Source"]
    bpy.context.collection.objects.link(names.objects[0])
    target = c.target_tube()
    assert c.retarget(names.objects[0], target) == {"FINISHED"}
    assert target.parent.library is not None


def test_edit_mode():
    source, _ = c.source_tube()
    target = painted_target()
    c.activate(source, target)
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Leave Edit Mode first"):
        bpy.ops.dermis.retarget_weights()
    assert (source.mode, target.mode) == ("EDIT", "EDIT")


def test_target_parented_to_a_bone():
    source, rig = c.source_tube()
    target = painted_target()
    target.parent, target.parent_type, target.parent_bone = rig, "BONE", "upper"
    failed(source, target, match="parented to the bone 'upper'")


def test_armature_below_the_target():
    source, rig = c.source_tube()
    target = painted_target()
    rig.parent = target
    failed(source, target, match="Armature 'SourceRig' is a child of 'Target'")


def test_one_bad_target_of_several_stops_all():
    source, _ = c.source_tube()
    good, bad = painted_target("A"), c.mesh_object("B", [(0, 0, 0)], [])
    failed(source, good, bad, match="'B' has 1 vertex and no faces")


@pytest.mark.parametrize("side", [0, 1])
def test_landmark_out_of_range(side):
    source, _ = c.source_tube()
    target = painted_target()
    c.add_landmarks(source, target, [(9999, 0) if side == 0 else (0, 9999)])
    name = ("Source", "Target")[side]
    failed(source, target, match=f"Landmark 1 names vertex 9999 of '{name}'")


def test_landmarks_of_another_source():
    source, _ = c.source_tube()
    target = painted_target()
    target.dermis_retarget.landmarks.add()
    target.dermis_retarget.landmark_source = c.target_tube("Other")
    failed(source, target, match="The landmarks of 'Target' belong to 'Other'")
    assert c.retarget(source, target, use_landmarks=False) == {"FINISHED"}


def usable(target, names=("lower", "middle", "upper")):
    weights = c.dense(target, names)
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    return weights


def test_parts_that_touch_nothing_get_weights():
    source, _ = c.source_tube()
    vertices, faces = c.tube(9, 16, radius=0.6)
    count = len(vertices)
    ball = np.add(c.tube(5, 3, height=0.2, radius=0.1)[0], (0.9, 0, 2.6))
    faces += [tuple(count + i for i in face) for face in c.tube(5, 3)[1]]
    target = c.mesh_object("Target", [*vertices, *map(tuple, ball), (1, 1, 0.2)], faces)
    assert c.retarget(source, target) == {"FINISHED"}
    weights = usable(target)
    assert (weights[count:-1].argmax(axis=1) == 2).all()


def test_surfaces_that_are_no_manifold():
    source, _ = c.source_tube()
    vertices, faces = c.tube(9, 16, radius=0.6)
    count = len(vertices)
    fin = [(1.2, 0, 1.0), (1.2, 0.1, 1.2), (1.3, 0, 1.1)]
    faces += [(27, 36, count), (27, 36, count + 1), (27, 36, count + 2)]  # five faces at one edge
    faces += [(0, 1, 2), (0, 2, 1)]  # the same face twice, turned over
    usable_target = c.mesh_object("Target", [*vertices, *fin], faces)
    assert c.retarget(source, usable_target) == {"FINISHED"}
    usable(usable_target)


def test_zero_area_faces_and_duplicate_vertices():
    source, _ = c.source_tube()
    vertices, faces = c.tube(9, 16, radius=0.6)
    count = len(vertices)
    twins = [vertices[40], vertices[40], vertices[41]]
    faces += [(40, count, count + 1), (40, 41, count + 2)]
    target = c.mesh_object("Target", [*vertices, *twins], faces)
    assert c.retarget(source, target) == {"FINISHED"}
    usable(target)


def test_landmark_on_another_component():
    source, _ = c.source_tube()
    vertices, faces = c.tube(9, 16, radius=0.6)
    count = len(vertices)
    target = c.mesh_object(
        "Target", [*vertices, (2, 0, 0), (2, 1, 0), (2, 0, 1)], [*faces, (count, count + 1, count + 2)]
    )
    c.add_landmarks(source, target, [(0, 0), (80, 60), (150, 140), (100, count)])
    failed(source, target, match=f"landmark .* target vertex {count} lies on another piece of the mesh", method="PAPER")
