# SPDX-License-Identifier: GPL-3.0-or-later
"""The check: it changes nothing, finds what is wrong, and selects it in any mode."""

import json
import sys

import bmesh
import bpy
import characters as c
import numpy as np
import pytest
from layouts import draw
from scratch_profile import MODULE


def check(*objects, **options):
    c.activate(*objects)
    return bpy.ops.dermis.check(**options)


def report_of(ob):
    return sys.modules[f"{MODULE}.blender.check_reports"].kept_report(ob)


def selected(ob):
    if ob.mode == "EDIT":
        return [v.index for v in bmesh.from_edit_mesh(ob.data).verts if v.select]
    return [v.index for v in ob.data.vertices if v.select]


def faulty():
    """A painted tube: one vertex without weights, two of half weight, one that follows a far bone."""
    ob, rig = c.source_tube("Body")
    for group in ob.vertex_groups:
        group.remove([40])
        for vertex in (5, 6):
            try:
                group.add([vertex], group.weight(vertex) / 2, "REPLACE")
            except RuntimeError:
                continue
        group.remove([60])
    ob.vertex_groups["upper"].add([60], 1.0, "REPLACE")
    return ob, rig


def test_faults_are_found_and_nothing_is_changed():
    ob, _ = faulty()
    before = c.state(ob)
    texts = len(bpy.data.texts)
    assert check(ob) == {"FINISHED"}
    assert c.state(ob) == before
    assert len(bpy.data.texts) == texts
    found = report_of(ob).vertices
    assert found["unweighted"].tolist() == [40]
    assert found["totals"].tolist() == [5, 6]
    assert 60 in found["stretch"]


def test_clean_mesh():
    ob, rig = c.source_tube("Body")
    ob.vertex_groups.clear()
    c.paint(ob, rig, falloff=2.0)
    check(ob)
    assert report_of(ob).faults == 0


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT", "WEIGHT_PAINT"])
def test_select_in_each_mode(mode):
    ob, _ = faulty()
    c.activate(ob)
    bpy.ops.object.mode_set(mode=mode)
    assert bpy.ops.dermis.check() == {"FINISHED"}
    assert bpy.ops.dermis.select_problems(category="TOTALS") == {"FINISHED"}
    assert ob.mode == mode
    assert selected(ob) == [5, 6]
    bpy.ops.dermis.select_problems(category="UNWEIGHTED", extend=True)
    assert selected(ob) == [5, 6, 40]
    bpy.ops.dermis.select_problems(category="UNWEIGHTED")
    assert selected(ob) == [40]
    bpy.ops.dermis.select_problems()
    assert {5, 6, 40, 60} <= set(selected(ob))
    bpy.ops.dermis.select_problems(category="SIDES")
    assert selected(ob) == []


def test_edges_and_faces_go_with_the_vertices():
    ob, _ = faulty()
    check(ob)
    bpy.ops.dermis.select_problems(category="STRETCH")
    mesh = ob.data
    chosen = {v.index for v in mesh.vertices if v.select}
    assert all(e.select == (set(e.vertices) <= chosen) for e in mesh.edges)
    assert all(p.select == (set(p.vertices) <= chosen) for p in mesh.polygons)
    bpy.ops.object.mode_set(mode="EDIT")
    assert set(selected(ob)) == chosen


def test_undo_brings_the_selection_back():
    ob, _ = faulty()
    check(ob)
    bpy.ops.dermis.select_problems(category="TOTALS")
    bpy.ops.ed.undo_push(message="Before")
    assert bpy.ops.dermis.select_problems("EXEC_DEFAULT", True, category="UNWEIGHTED") == {"FINISHED"}
    assert selected(bpy.data.objects["Body"]) == [40]
    bpy.ops.ed.undo()
    assert selected(bpy.data.objects["Body"]) == [5, 6]
    assert report_of(bpy.data.objects["Body"]) is not None


def test_selecting_needs_a_check_of_these_vertices():
    ob, _ = faulty()
    c.activate(ob)
    with pytest.raises(RuntimeError, match="'Body' must be checked first"):
        bpy.ops.dermis.select_problems(category="TOTALS")
    check(ob)
    ob.data.vertices.add(1)
    with pytest.raises(RuntimeError, match="'Body' must be checked first"):
        bpy.ops.dermis.select_problems()


def test_filled_vertices_need_no_check():
    source, _ = c.source_tube()
    vertices, faces = c.tube(9, 16, radius=0.6)
    target = c.mesh_object("Target", [*vertices, (1, 1, 0.2)], faces)
    c.retarget(source, target)
    status = np.ones(147, np.uint8)
    status[146] = 2
    sys.modules[f"{MODULE}.blender.match_display"].keep_status(target, status)
    assert "dermis.select_problems" in draw("DERMIS_PT_retarget")
    assert bpy.ops.dermis.select_problems(category="FILLED") == {"FINISHED"}
    assert selected(source) == list(range(158)), "the source has no filled vertices and keeps its selection"
    assert 146 in selected(target)


def test_wrong_side_and_options():
    source, rig = c.biped("Body")
    c.paint(source, rig, falloff=10)
    c.deform(source, rig)
    right = [v.index for v in source.data.vertices if v.co.x < -0.6]
    for group in source.vertex_groups:
        group.remove(right)
    source.vertex_groups["hand.L"].add(right, 1.0, "REPLACE")
    check(source, most_influences=1, angle=np.radians(30), stretch=50.0)
    found = report_of(source).vertices
    assert [v for v in found["sides"].tolist() if source.data.vertices[v].co.x < -0.3] == right
    assert "stretch" not in found or len(found["stretch"]) < len(right)
    names = [bone.name for bone in rig.data.bones]
    many = (c.dense(source, names) > 0).sum(axis=1) > 1
    assert found["influences"].tolist() == np.flatnonzero(many).tolist()
    check(source, most_influences=0)
    assert "influences" not in report_of(source).vertices


@pytest.mark.parametrize(("output", "name"), [("TEXT", "Dermis Check"), ("JSON", "Dermis Check.json")])
def test_text_of_the_file(output, name):
    ob, _ = faulty()
    for _ in range(2):
        check(ob, output=output)
    assert [text.name for text in bpy.data.texts] == [name]
    content = bpy.data.texts[name].as_string()
    if output == "JSON":
        (report,) = json.loads(content)
        assert report["categories"]["totals"] == [5, 6]
        assert report["mesh"] == "Body"
    else:
        assert "'Body' with 'BodyRig': 158 vertices" in content
        assert "2 vertices with a total other than 1." in content


def test_several_meshes():
    ob, rig = faulty()
    other = c.target_tube("Other")
    c.paint(other, rig, falloff=2.0)
    c.deform(other, rig)
    check(ob, other)
    assert report_of(other).faults == 0
    assert report_of(ob).faults > 0


def test_dry_run_changes_nothing_and_tells_what_would_be():
    source, _ = c.source_tube()
    target = c.target_tube()
    c.activate(source, target)
    before = c.state(target)
    assert check(source, target, use_retarget=True, max_influences=1, most_influences=1) == {"FINISHED"}
    assert c.state(target) == before
    report = report_of(target)
    assert "unweighted" not in report.vertices
    assert "influences" not in report.vertices
    assert report_of(source) is None
    check(source, target, use_retarget=True, most_influences=1)
    assert "influences" in report_of(target).vertices
    assert c.state(target) == before


def test_dry_run_needs_a_source_and_a_target():
    source, _ = c.source_tube()
    with pytest.raises(RuntimeError, match=r"Select the target meshes too.*Nothing was changed\."):
        check(source, use_retarget=True)


def test_mesh_without_an_armature():
    ob = c.target_tube()
    with pytest.raises(RuntimeError, match="'Target' has no armature: there are no bones to check its weights by"):
        check(ob)


def test_nothing_selected():
    _, rig = c.source_tube()
    c.activate(rig)
    with pytest.raises(RuntimeError, match="Select a mesh to check"):
        bpy.ops.dermis.check()


def test_panel():
    ob, _ = faulty()
    c.activate(ob)
    assert draw("DERMIS_PT_check") == ["dermis.check"]
    check(ob)
    shown = draw("DERMIS_PT_check")
    assert shown.count("dermis.select_problems") == len(report_of(ob).vertices)
    assert "158 vertices" in " ".join(shown)


def test_linked_mesh_can_be_checked_but_not_selected(tmp_path):
    ob, _ = faulty()
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {ob})
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, names):
        names.objects = ["Body"]
    linked = names.objects[0]
    bpy.context.collection.objects.link(linked)
    assert check(linked) == {"FINISHED"}
    with pytest.raises(RuntimeError, match="'Body' is linked, its vertices cannot be selected"):
        bpy.ops.dermis.select_problems()
