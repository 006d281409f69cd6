# SPDX-License-Identifier: GPL-3.0-or-later
"""Landmark pairs: add from the selection, show, remove, clear, use."""

import sys

import bmesh
import bpy
import characters as c
import pytest
from scratch_profile import MODULE


@pytest.fixture
def pair():
    source, _ = c.source_tube()
    target = c.target_tube()
    c.activate(source, target)
    return source, target


def edit_with(*chosen):
    """Edit Mode for all selected meshes, with these vertices selected: (object, vertices)."""
    bpy.ops.object.mode_set(mode="EDIT")
    for ob, vertices in chosen:
        mesh = bmesh.from_edit_mesh(ob.data)
        mesh.select_mode = {"VERT"}
        for vertex in mesh.verts:
            vertex.select_set(vertex.index in vertices)
        mesh.select_flush_mode()
        bmesh.update_edit_mesh(ob.data)


def kept(target):
    return [(p.name, p.source_vertex, p.target_vertex) for p in target.dermis_retarget.landmarks]


def selected(ob):
    return [v.index for v in bmesh.from_edit_mesh(ob.data).verts if v.select]


def test_add_in_edit_mode(pair):
    source, target = pair
    edit_with((source, [5]), (target, [7]))
    assert bpy.ops.dermis.landmark_add() == {"FINISHED"}
    edit_with((source, [6]), (target, [8]))
    assert bpy.ops.dermis.landmark_add() == {"FINISHED"}
    assert kept(target) == [("lower", 5, 7), ("lower 2", 6, 8)]
    assert target.dermis_retarget.active_landmark == 1
    assert target.dermis_retarget.landmark_source == source
    assert kept(source) == []


def test_add_in_object_mode(pair):
    source, target = pair
    for ob, vertex in ((source, 150), (target, 3)):
        ob.data.vertices.foreach_set("select", [i == vertex for i in range(len(ob.data.vertices))])
    assert bpy.ops.dermis.landmark_add() == {"FINISHED"}
    assert kept(target) == [("upper", 150, 3)]


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        (([], [7]), "'Source' has no vertex selected instead of one"),
        (([5, 6], [7]), "'Source' has 2 vertices selected instead of one"),
        (([5], [7, 8, 9]), "'Target' has 3 vertices selected instead of one"),
    ],
)
def test_add_needs_one_vertex_of_each(pair, chosen, message):
    source, target = pair
    edit_with((source, chosen[0]), (target, chosen[1]))
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.dermis.landmark_add()
    assert kept(target) == []


def test_add_refuses_a_vertex_twice(pair):
    source, target = pair
    edit_with((source, [5]), (target, [7]))
    bpy.ops.dermis.landmark_add()
    with pytest.raises(RuntimeError, match="Vertex 5 of 'Source' already is landmark 'lower'"):
        bpy.ops.dermis.landmark_add()
    edit_with((source, [6]), (target, [7]))
    with pytest.raises(RuntimeError, match="Vertex 7 of 'Target' already is landmark 'lower'"):
        bpy.ops.dermis.landmark_add()
    assert len(kept(target)) == 1


def test_add_refuses_another_source(pair):
    source, target = pair
    target.dermis_retarget.landmarks.add().name = "old"
    target.dermis_retarget.landmark_source = c.target_tube("Other")
    edit_with((source, [5]), (target, [7]))
    with pytest.raises(RuntimeError, match="belong to 'Other'"):
        bpy.ops.dermis.landmark_add()


def test_add_needs_one_target(pair):
    source, target = pair
    c.activate(source, target, c.target_tube("Second"))
    with pytest.raises(RuntimeError, match="one target only"):
        bpy.ops.dermis.landmark_add()


def test_show_remove_clear(pair):
    source, target = pair
    c.add_landmarks(source, target, [(5, 7), (60, 70), (150, 140)])
    target.dermis_retarget.active_landmark = 1
    target.data.vertices[70].hide = True
    assert bpy.ops.dermis.landmark_show() == {"FINISHED"}
    assert (source.mode, target.mode) == ("EDIT", "EDIT")
    assert (selected(source), selected(target)) == ([60], [70])
    target.dermis_retarget.active_landmark = 2
    assert bpy.ops.dermis.landmark_show() == {"FINISHED"}
    assert (selected(source), selected(target)) == ([150], [140])
    assert bpy.ops.dermis.landmark_remove() == {"FINISHED"}
    assert [p[1] for p in kept(target)] == [5, 60]
    assert target.dermis_retarget.active_landmark == 1
    assert bpy.ops.dermis.landmark_clear() == {"FINISHED"}
    assert kept(target) == []
    assert target.dermis_retarget.landmark_source is None
    with pytest.raises(RuntimeError, match="'Target' has no landmarks"):
        bpy.ops.dermis.landmark_remove()


def test_show_a_vertex_that_is_gone(pair):
    source, target = pair
    target.dermis_retarget.landmarks.add().source_vertex = 5000
    target.dermis_retarget.landmark_source = source
    with pytest.raises(RuntimeError, match="names vertex 5000, which 'Source' does not have"):
        bpy.ops.dermis.landmark_show()
    assert source.mode == "OBJECT"


def test_show_a_hidden_mesh(pair):
    source, target = pair
    c.add_landmarks(source, target, [(1, 2)])
    selected = list(bpy.context.selected_objects)
    with bpy.context.temp_override(selected_objects=selected, active_object=source):
        target.hide_viewport = True
        with pytest.raises(RuntimeError, match="'Target' is hidden"):
            bpy.ops.dermis.landmark_show()
    assert source.mode == "OBJECT"


def test_landmarks_are_used(pair, monkeypatch):
    source, target = pair
    given = [(0, 0), (30, 20), (100, 120), (156, 144), (157, 145)]
    c.add_landmarks(source, target, given)
    module = sys.modules[f"{MODULE}.core.retarget"]
    original, received = module.retarget_weights, []

    def watched(*arguments, landmarks, **options):
        received.append(landmarks)
        return original(*arguments, landmarks=landmarks, **options)

    monkeypatch.setattr(module, "retarget_weights", watched)
    # The paper's method uses the user's pairs alone, the other one adds its own.
    assert c.retarget(source, target, method="PAPER") == {"FINISHED"}
    assert "5 landmarks" in target.dermis_retarget.result
    assert c.retarget(source, target) == {"FINISHED"}
    for pairs in received:
        assert [tuple(row) for row in pairs.tolist()] == given
    assert c.retarget(source, target, use_landmarks=False) == {"FINISHED"}
    assert received[2] is None
