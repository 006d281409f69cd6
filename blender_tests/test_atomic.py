# SPDX-License-Identifier: GPL-3.0-or-later
"""A failure at any moment of the writing leaves every target as it was."""

import sys

import bpy
import characters as c
import pytest
from scratch_profile import MODULE


def rich_target(name):
    """Groups in an order that no bone list has, entries in mixed order, modifiers, a parent."""
    target = c.target_tube(name)
    for group in ("upper", "Mask", "lower"):
        target.vertex_groups.new(name=group)
    for vertex in range(60):
        order = ("lower", "upper", "Mask") if vertex % 2 else ("Mask", "lower", "upper")
        for i, group in enumerate(order[: vertex % 4]):
            target.vertex_groups[group].add([vertex], (vertex * 7 + i) % 11 / 11, "REPLACE")
    target.vertex_groups["Mask"].lock_weight = True
    target.vertex_groups.active_index = 1
    target.modifiers.new("Smooth", "SMOOTH")
    if name == "B":
        target.modifiers.new("Lost", "ARMATURE")
    target.modifiers.new("Subdivision", "SUBSURF")
    target.modifiers.active = target.modifiers["Smooth"]
    target.dermis_retarget.result = "earlier"
    return target


@pytest.mark.parametrize(
    ("function", "call"),
    [("attach_armature", 1), ("attach_armature", 2), ("write_groups", 1), ("write_groups", 2)],
)
@pytest.mark.parametrize("error", [OSError("disk"), MemoryError()], ids=["OSError", "MemoryError"])
def test_failure_while_writing(monkeypatch, function, call, error):
    source, _ = c.source_tube()
    targets = [rich_target("A"), rich_target("B")]
    c.activate(source, *targets)
    bpy.context.view_layer.update()
    before = [c.state(ob) for ob in targets]
    module = sys.modules[f"{MODULE}.blender.retarget"]
    original = getattr(module, function)
    calls = []

    def broken(*arguments):
        calls.append(arguments)
        original(*arguments)
        if len(calls) == call:
            raise error

    monkeypatch.setattr(module, function, broken)
    with pytest.raises(RuntimeError, match=f"Unexpected {type(error).__name__}.*Nothing was changed"):
        c.retarget(source, *targets)
    assert len(calls) == call
    assert [c.state(ob) for ob in targets] == before
    monkeypatch.undo()
    assert c.retarget(source, *targets) == {"FINISHED"}


def test_wrong_result_is_never_written(monkeypatch):
    source, _ = c.source_tube()
    target = rich_target("A")
    c.activate(source, target)
    bpy.context.view_layer.update()
    before = c.state(target)
    module = sys.modules[f"{MODULE}.core.retarget"]
    original = module.BoneWeights

    def halved(vertex, bone, value):
        return original(vertex, bone, value / 2)

    monkeypatch.setattr(module, "BoneWeights", halved)
    with pytest.raises(RuntimeError, match="146 vertices of 'A' got no full weight, the first is vertex 0"):
        c.retarget(source, target)
    assert c.state(target) == before


def test_groups_come_back_exactly():
    target = rich_target("A")
    module = sys.modules[f"{MODULE}.blender.vertex_groups"]
    before, snapshot = c.state(target), module.read_groups(target)
    target.vertex_groups.new(name="New").add([0, 1], 1, "REPLACE")
    target.vertex_groups["upper"].remove(range(30))
    target.vertex_groups["lower"].add(range(100), 0.125, "ADD")
    assert c.state(target) != before
    module.restore_groups(target, snapshot)
    assert c.state(target) == before


def test_every_entry_is_read_in_its_place():
    target = rich_target("A")
    read = sys.modules[f"{MODULE}.blender.vertex_groups"].read_groups(target)
    entries = [[(entry.group, entry.weight) for entry in vertex.groups] for vertex in target.data.vertices]
    assert read.counts.tolist() == [len(of_vertex) for of_vertex in entries]
    assert {0, 1, 2, 3} <= set(read.counts.tolist())
    pairs = zip(read.group.tolist(), read.value.tolist(), strict=True)
    assert list(pairs) == [entry for of_vertex in entries for entry in of_vertex]


def test_a_mesh_without_groups_has_no_entries():
    target = c.target_tube("A")
    target.vertex_groups.clear()
    read = sys.modules[f"{MODULE}.blender.vertex_groups"].read_groups(target)
    assert read.counts.tolist() == [0] * len(target.data.vertices)
    assert read.names == ()
    assert read.group.size == read.value.size == 0
