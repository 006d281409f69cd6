# SPDX-License-Identifier: GPL-3.0-or-later
"""Every option of the operator: what is written, what stays bit for bit, and undo."""

import sys

import bpy
import characters as c
import numpy as np
import pytest
from scratch_profile import MODULE

NAMES = ("lower", "middle", "upper")


def painted_target(name="Target"):
    """A target with full weights of its own, by another falloff than the source's."""
    target = c.target_tube(name)
    c.paint(target, bpy.data.objects["SourceRig"], falloff=1.5)
    return target


def named(value):
    """A state without references to objects, which undo replaces."""
    if isinstance(value, bpy.types.ID):
        return value.name
    return [named(each) for each in value] if isinstance(value, list | tuple) else value


def snapshot(name):
    ob = bpy.data.objects[name]
    return {key: named(value) for key, value in c.state(ob).items()} | {"attributes": sorted(ob.data.attributes.keys())}


def undoable(source, *targets, **options):
    """Run the operator; undo must bring back exactly what was there, redo what it wrote."""
    c.activate(source, *targets)
    bpy.ops.ed.undo_push(message="Before")
    names = [ob.name for ob in targets]
    before = {name: snapshot(name) for name in names}
    assert bpy.ops.dermis.retarget_weights("EXEC_DEFAULT", True, **options) == {"FINISHED"}
    after = {name: snapshot(name) for name in names}
    bpy.ops.ed.undo()
    assert {name: snapshot(name) for name in names} == before
    bpy.ops.ed.redo()
    assert {name: snapshot(name) for name in names} == after
    return before, after


def column(state, name):
    """Entries of one group in a state, as they were."""
    index = next(group[1] for group in state["groups"] if group[0] == name)
    return [[entry for entry in entries if entry[0] == index] for entries in state["weights"]]


def select_bones(rig, *names):
    for bone in rig.data.bones:
        bone.select = bone.name in names


def select_vertices(ob, vertices):
    flags = np.zeros(len(ob.data.vertices), np.bool_)
    flags[vertices] = True
    ob.data.vertices.foreach_set("select", flags)


def totals(ob):
    return c.dense(ob, NAMES).sum(axis=1)


def test_only_selected_vertices():
    source, _ = c.source_tube()
    target = painted_target()
    select_vertices(target, range(40, 80))
    before, after = undoable(source, target, only_selected=True)
    old, new = before["Target"]["weights"], after["Target"]["weights"]
    changed = [i for i in range(len(old)) if old[i] != new[i]]
    assert changed
    assert set(changed) <= set(range(40, 80))
    np.testing.assert_allclose(totals(bpy.data.objects["Target"]), 1, atol=1e-6)
    assert "106 vertices left as they were" in after["Target"]["result"]


def test_no_vertex_selected():
    source, _ = c.source_tube()
    target = painted_target()
    select_vertices(target, [])
    with pytest.raises(RuntimeError, match=r"No vertex of 'Target' is selected. Nothing was changed"):
        c.retarget(source, target, only_selected=True)


def test_selected_bones_keep_the_others_bit_for_bit():
    source, rig = c.source_tube()
    painted_target()
    select_bones(rig, "lower", "middle")
    before, after = undoable(source, bpy.data.objects["Target"], subset="SELECTED")
    before, after = before["Target"], after["Target"]
    assert column(before, "upper") == column(after, "upper")
    assert column(before, "lower") != column(after, "lower")
    np.testing.assert_allclose(totals(bpy.data.objects["Target"]), 1, atol=1e-6)


def test_selected_bone_gets_its_full_weight_where_others_give_way():
    source, rig = c.source_tube()
    target = painted_target()
    whole = c.target_tube("Whole")
    c.retarget(source, whole)
    select_bones(rig, "middle")
    undoable(source, target, subset="SELECTED", other_groups="SCALE")
    target, whole = bpy.data.objects["Target"], bpy.data.objects["Whole"]
    np.testing.assert_allclose(c.dense(target, NAMES)[:, 1], c.dense(whole, NAMES)[:, 1], atol=1e-6)
    np.testing.assert_allclose(totals(target), 1, atol=1e-6)


def test_one_bone_onto_a_bare_target():
    source, rig = c.source_tube()
    target, whole = c.target_tube(), c.target_tube("Whole")
    c.retarget(source, whole)
    select_bones(rig, "middle")
    c.retarget(source, target, subset="SELECTED")
    assert [g.name for g in target.vertex_groups] == ["middle"]
    np.testing.assert_allclose(c.dense(target, NAMES)[:, 1], c.dense(whole, NAMES)[:, 1], atol=1e-6)


def test_no_bone_selected():
    source, rig = c.source_tube()
    select_bones(rig)
    rig.data.bones.active = None
    with pytest.raises(RuntimeError, match="No deforming bone of 'SourceRig' is selected: select some in Pose Mode"):
        c.retarget(source, painted_target(), subset="SELECTED")


def test_all_selected_bones_are_locked():
    source, rig = c.source_tube()
    target = painted_target()
    target.vertex_groups["upper"].lock_weight = True
    select_bones(rig, "upper")
    with pytest.raises(RuntimeError, match=r"All chosen bone groups of 'Target' are locked. Nothing was changed"):
        c.retarget(source, target, subset="SELECTED")


def masks(source):
    """Two groups of the source that no bone has: its upper half, and nothing."""
    mask = source.vertex_groups.new(name="Mask")
    mask.add([v.index for v in source.data.vertices if v.co.z > 1.6], 0.75, "REPLACE")
    source.vertex_groups.new(name="Pin")


def test_all_groups():
    source, _ = c.source_tube()
    masks(source)
    target = painted_target()
    target.vertex_groups.new(name="Pin").add([0, 1], 0.5, "REPLACE")
    target.vertex_groups["Pin"].lock_weight = True
    before, after = undoable(source, target, subset="ALL")
    target = bpy.data.objects["Target"]
    heights = np.array([v.co.z for v in target.data.vertices])
    copied = c.dense(target, ["Mask"])[:, 0]
    assert (copied[heights > 2] == 0.75).all()
    assert (copied[heights < 1.2] == 0).all()
    assert column(before["Target"], "Pin") == column(after["Target"], "Pin")
    assert "ignored" not in target.dermis_retarget.result


def test_no_unlocked_group():
    source, _ = c.source_tube()
    with pytest.raises(RuntimeError, match="'Target' has no unlocked group of a deforming bone of 'SourceRig'"):
        c.retarget(source, c.target_tube(), subset="UNLOCKED")


def test_unlocked_groups_makes_none():
    source, _ = c.source_tube()
    masks(source)
    target = c.target_tube()
    target.vertex_groups.new(name="lower").add(range(146), 0.5, "REPLACE")
    target.vertex_groups.new(name="upper").add(range(146), 0.5, "REPLACE")
    target.vertex_groups["upper"].lock_weight = True
    before, after = undoable(source, target, subset="UNLOCKED")
    assert [name for name, _, _ in after["Target"]["groups"]] == ["lower", "upper"]
    assert column(before["Target"], "upper") == column(after["Target"], "upper")
    np.testing.assert_allclose(totals(bpy.data.objects["Target"]), 1, atol=1e-6)


def test_mix_factor():
    source, rig = c.source_tube()
    old, full = painted_target("Old"), painted_target("Full")
    half, none = painted_target("Half"), painted_target("None")
    c.retarget(source, full)
    c.retarget(source, half, mix_factor=0.25)
    before = c.state(none)
    c.retarget(source, none, mix_factor=0.0)
    assert c.state(none)["weights"] == before["weights"]
    expected = 0.75 * c.dense(old, NAMES) + 0.25 * c.dense(full, NAMES)
    np.testing.assert_allclose(c.dense(half, NAMES), expected, atol=1e-5)
    assert c.bone_names(rig) == list(NAMES)
    undoable(source, bpy.data.objects["Old"], mix_factor=0.5)


def test_bones_of_the_target_alone_are_kept():
    source, _ = c.source_tube()
    target = c.target_tube()
    own = c.armature("Own", [*c.tube_bones(), ("skirt", "lower", (2, 0, 0), (2, 0, 1))])
    c.deform(target, own)
    target.vertex_groups.new(name="skirt").add([3, 4], 0.625, "REPLACE")
    c.activate(source, target)
    bpy.ops.dermis.map_bones()
    for row in target.dermis_retarget.bone_map:
        row.target = row.source
    before, after = undoable(source, target, keep_unmapped=True)
    assert column(before["Target"], "skirt") == column(after["Target"], "skirt")
    target = bpy.data.objects["Target"]
    np.testing.assert_allclose(c.dense(target, [*NAMES, "skirt"]).sum(axis=1), 1, atol=1e-6)
    assert "kept their weights: 'skirt'" in target.dermis_retarget.result
    c.retarget(bpy.data.objects["Source"], target)
    assert c.dense(target, ["skirt"]).max() == 0


@pytest.mark.parametrize("limit", [1, 2, 4, 8])
def test_limit_with_undo(limit):
    source, rig = c.biped("Source")
    c.paint(source, rig, falloff=3.0)
    c.deform(source, rig)
    target, _ = c.biped("Target", voxel=0.06)
    undoable(source, target, max_influences=limit)
    target = bpy.data.objects["Target"]
    weights = c.dense(target, c.bone_names(bpy.data.objects["SourceRig"]))
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert (weights > 0).sum(axis=1).max() <= limit
    if limit < 4:
        assert "vertices limited" in target.dermis_retarget.result


def sided(names):
    return np.array([1 if n.endswith(".L") else -1 if n.endswith(".R") else 0 for n in names])


@pytest.fixture
def lopsided():
    """A biped whose left limbs are painted rightly and whose right ones follow the hips alone; and a target."""
    source, rig = c.biped("Source")
    c.paint(source, rig)
    c.deform(source, rig)
    for name in [bone.name for bone in rig.data.bones if bone.name.endswith(".R")]:
        source.vertex_groups[name].remove(range(len(source.data.vertices)))
    right = [v.index for v in source.data.vertices if v.co.x < -0.1]
    for group in source.vertex_groups:
        group.remove(right)
    source.vertex_groups["hips"].add(right, 1.0, "REPLACE")
    target, own = c.biped("Target", arm=0.95, leg=0.9, voxel=0.06, seed=3)
    c.deform(target, own)
    return source, target, own


def followed(target, rig, side):
    """Mean weight of the limbs' vertices of one side (1 left, -1 right) on bones of that side."""
    names = c.bone_names(rig)
    x = np.array([v.co.x for v in target.data.vertices])
    weights = c.dense(target, names)
    return weights[x * side > 0.3][:, sided(names) == side].sum(axis=1).mean()


def test_flip(lopsided):
    source, target, own = lopsided
    c.retarget(source, target)
    assert followed(target, own, 1) > 0.8
    assert followed(target, own, -1) < 0.1
    undoable(source, target, mirror="FLIP")
    target, own = bpy.data.objects["Target"], bpy.data.objects["TargetRig"]
    assert followed(target, own, 1) < 0.1
    assert followed(target, own, -1) > 0.8


@pytest.mark.parametrize("mirror", ["LEFT", "RIGHT"])
def test_both_sides_from_one(lopsided, mirror):
    source, target, _ = lopsided
    undoable(source, target, mirror=mirror)
    target, own = bpy.data.objects["Target"], bpy.data.objects["TargetRig"]
    for side in (1, -1):
        share = followed(target, own, side)
        assert share > 0.8 if mirror == "LEFT" else share < 0.1
    np.testing.assert_allclose(c.dense(target, c.bone_names(own)).sum(axis=1), 1, atol=1e-6)


def test_mirror_needs_left_and_right_bones():
    source, _ = c.source_tube()
    with pytest.raises(
        RuntimeError, match=r"'SourceRig' has no bones that are named left and right.*Nothing was changed"
    ):
        c.retarget(source, c.target_tube(), mirror="FLIP")


def cut_tube():
    """The target tube in two objects that share the ring at half its height."""
    whole = c.target_tube()
    faces = [tuple(p.vertices) for p in whole.data.polygons]
    heights = np.array([v.co.z for v in whole.data.vertices])
    halves = []
    for name, mine in (("Low", lambda z: max(z) < 1.61), ("High", lambda z: min(z) > 1.59)):
        kept = [face for face in faces if mine(heights[list(face)])]
        used = sorted({v for face in kept for v in face})
        place = {v: i for i, v in enumerate(used)}
        points = [whole.data.vertices[v].co for v in used]
        halves.append(c.mesh_object(name, points, [tuple(place[v] for v in face) for face in kept]))
    bpy.data.objects.remove(whole)
    return halves


@pytest.mark.parametrize("close", [True, False])
def test_seams_between_targets(close):
    source, _ = c.source_tube()
    low, high = cut_tube()
    undoable(source, low, high, close_seams=close, max_influences=2)
    low, high = bpy.data.objects["Low"], bpy.data.objects["High"]
    rim = {tuple(round(x, 5) for x in v.co): c.dense(low, NAMES)[v.index] for v in low.data.vertices}
    pairs = [(rim[key], c.dense(high, NAMES)[v.index]) for v in high.data.vertices
             if (key := tuple(round(x, 5) for x in v.co)) in rim]  # fmt: skip
    assert len(pairs) == 9
    largest = max(np.abs(a - b).max() for a, b in pairs)
    assert largest < 1e-6 if close else largest > 1e-3
    assert ("18 seam vertices" in low.dermis_retarget.result) == close


def filled_case():
    """A target with a speck that lies on another piece, which cannot be matched by the surface."""
    source, _ = c.source_tube()
    vertices, faces = c.tube(9, 16, radius=0.6)
    return source, c.mesh_object("Target", [*vertices, (1, 1, 0.2)], faces)


def status(ob):
    return sys.modules[f"{MODULE}.blender.match_display"].kept_status(ob)


def test_filled_vertices_are_counted_selected_and_shown():
    source, target = filled_case()
    undoable(source, target, select_filled=True, show_match=True)
    target = bpy.data.objects["Target"]
    kept = status(target)
    assert len(kept) == 147
    filled = np.flatnonzero(kept == 2)
    assert kept[146] == 3, "a speck apart is a loose part"
    assert f"{len(filled)} filled" in target.dermis_retarget.result
    assert [v.index for v in target.data.vertices if v.select] == filled.tolist()
    colors = target.data.color_attributes["Dermis Match"]
    assert (colors.domain, colors.data_type) == ("POINT", "BYTE_COLOR")
    shown = np.array([entry.color for entry in colors.data])
    assert all(len(np.unique(shown[kept == code], axis=0)) == 1 for code in np.unique(kept))
    assert (shown[146] != shown[np.flatnonzero(kept == 1)[0]]).any()
    assert target.data.color_attributes.active_color.name == "Dermis Match"


def test_colors_follow_later_runs_and_are_not_made_unasked():
    source, target = filled_case()
    c.retarget(source, target)
    assert "Dermis Match" not in target.data.attributes
    c.retarget(source, target, show_match=True)
    select_vertices(target, [3])
    c.retarget(source, target, only_selected=True)
    shown = np.array([entry.color for entry in target.data.color_attributes["Dermis Match"].data])
    gray = np.abs(np.ptp(shown[:, :3], axis=1)) < 1e-3
    assert not gray[3]
    assert gray.sum() == 146


def test_another_attribute_of_that_name():
    source, target = filled_case()
    target.data.attributes.new("Dermis Match", "FLOAT", "FACE")
    before = c.state(target)
    with pytest.raises(RuntimeError, match=r"another attribute 'Dermis Match'.*Nothing was changed"):
        c.retarget(source, target, show_match=True)
    assert c.state(target) == before
    assert c.retarget(source, target) == {"FINISHED"}


@pytest.mark.parametrize("geometry", ["REST", "EVALUATED"])
def test_report_says_which_shape_of_the_source_was_used(geometry):
    source, rig = c.source_tube()
    rig.pose.bones["upper"].location = (0.3, 0, 0)
    target = c.target_tube()
    c.retarget(source, target, source_geometry=geometry)
    expected = "as it is shown, with pose" if geometry == "EVALUATED" else "at rest, its pose left aside"
    assert expected in target.dermis_retarget.result
    rig.pose.bones["upper"].location = (0, 0, 0)
    c.retarget(source, target)
    assert "The source was taken" not in target.dermis_retarget.result
