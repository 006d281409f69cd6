# SPDX-License-Identifier: GPL-3.0-or-later
"""Loose parts as the user wants them, and protected vertices, through both operators that write weights."""

import bpy
import characters as c
import numpy as np
import pytest
from test_retarget_options import NAMES, select_vertices, undoable

# What the retargeting can do to a part that moves as one, and what it tells of two of them.
TOLD = {"RIGID": "2 rigid parts", "SURFACE": "2 parts on the surface"}


def with_cuffs(name="Target"):
    """A tube with two short tubes around its joints, in one object; the vertices of each of them."""
    vertices, faces = c.tube(9, 16, radius=0.6)
    cuffs = []
    for height in (1.0, 2.0):
        ring, ring_faces = c.tube(9, 5, height=0.8, radius=0.66)
        faces += [tuple(len(vertices) + i for i in face) for face in ring_faces]
        cuffs.append(list(range(len(vertices), len(vertices) + len(ring))))
        vertices = [*vertices, *((x, y, z + height - 0.4) for x, y, z in ring)]
    return c.mesh_object(name, vertices, faces), cuffs


def rigid(ob, cuffs):
    """Whether the rows of each cuff are one; those of the tube never are, and all totals are 1."""
    weights = c.dense(ob, NAMES)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    body, *rows = (weights[part] for part in (range(cuffs[0][0]), *cuffs))
    assert (body != body[0]).any()
    return [bool((each == each[0]).all()) for each in rows]


def bind(rig, *meshes, **options):
    c.activate(rig, *meshes)
    return bpy.ops.dermis.bind_weights(**options)


def refused(operator, *objects, match, **options):
    """The operator fails with the message and leaves the target as it was."""
    ob = bpy.data.objects["Target"]
    bpy.context.view_layer.update()
    before = c.state(ob)
    with pytest.raises(RuntimeError, match=match + r".*Nothing was changed"):
        operator(*objects, **options)
    assert c.state(ob) == before


@pytest.mark.parametrize("policy", TOLD)
def test_parts_of_a_retargeting(policy):
    source, _ = c.source_tube()
    target, cuffs = with_cuffs()
    undoable(source, target, loose_parts=policy)
    target = bpy.data.objects["Target"]
    assert TOLD[policy] in target.dermis_retarget.result
    assert rigid(target, cuffs) == [policy == "RIGID"] * 2


def test_parts_with_selected_vertices():
    source, _ = c.source_tube()
    target, cuffs = with_cuffs()
    select_vertices(target, [cuffs[1][5]])
    undoable(source, target, loose_parts="SURFACE", parts_of_selection=True)
    source, target = bpy.data.objects["Source"], bpy.data.objects["Target"]
    assert rigid(target, cuffs)[1] is False
    c.retarget(source, target, loose_parts="RIGID", parts_of_selection=True)
    assert rigid(target, cuffs)[1] is True
    select_vertices(target, [])
    nothing = "No part has a selected vertex: select a vertex of each loose part that is meant"
    refused(c.retarget, source, target, match=nothing, loose_parts="SURFACE", parts_of_selection=True)
    # The paper's method knows no parts, so the choice is not asked.
    c.retarget(source, target, method="PAPER", loose_parts="RIGID", parts_of_selection=True)


@pytest.mark.parametrize("policy", ["RIGID", "SURFACE", "OWN"])
def test_parts_of_a_bind(policy):
    rig = c.armature("Rig", c.tube_bones())
    target, cuffs = with_cuffs()
    assert bind(rig, target, loose_parts=policy) == {"FINISHED"}
    assert rigid(target, cuffs) == [policy == "RIGID"] * 2
    select_vertices(target, [cuffs[1][3]])
    bind(rig, target, loose_parts="RIGID", parts_of_selection=True)
    assert rigid(target, cuffs) == [False, True]


def test_parts_of_several_meshes_bound_as_one_body():
    rig = c.armature("Rig", c.tube_bones())
    body = c.mesh_object("Body", *c.tube(12, 13))
    target = c.mesh_object("Target", *c.tube(9, 5, height=0.8, radius=0.6))
    target.location.z = 0.6
    select_vertices(body, [])
    select_vertices(target, [3])
    bpy.context.view_layer.update()
    for together in (True, False):
        bind(rig, body, target, loose_parts="RIGID", parts_of_selection=True, use_together=together)
        rows = c.dense(target, NAMES)
        assert (rows == rows[0]).all()
        assert (c.dense(body, NAMES) != c.dense(body, NAMES)[0]).any()


def test_no_part_of_a_bind_is_selected():
    rig = c.armature("Rig", c.tube_bones())
    target, _ = with_cuffs()
    select_vertices(target, [])
    nothing = "No part has a selected vertex: select a vertex of each loose part that is meant"
    refused(bind, rig, target, match=nothing, loose_parts="RIGID", parts_of_selection=True)
    assert bind(rig, target, method="PAPER", loose_parts="RIGID", parts_of_selection=True) == {"FINISHED"}


@pytest.mark.parametrize("name", ["retarget", "bind"])
def test_protected_vertices_keep_all_their_groups(name):
    source, rig = c.source_tube()
    target = c.target_tube()
    c.paint(target, rig, falloff=1.5)
    finished = target.vertex_groups.new(name="Finished")
    finished.add(list(range(40, 80)), 0.5, "REPLACE")
    finished.add([100], 0.0, "REPLACE")
    giver, operator = (source, c.retarget) if name == "retarget" else (rig, bind)
    before = c.state(target)["weights"]
    assert operator(giver, target, protected_group="Finished") == {"FINISHED"}
    after = c.state(target)["weights"]
    assert after[40:80] == before[40:80]
    changed = {i for i in range(len(before)) if before[i] != after[i]}
    assert 100 in changed
    assert len(changed) > 90
    np.testing.assert_allclose(c.dense(target, NAMES).sum(axis=1), 1, atol=1e-6)
    missing = "There is no vertex group 'Done' of vertices to protect"
    refused(operator, giver, target, match=missing, protected_group="Done")
    select_vertices(target, range(50, 60))
    all_of_them = "All vertices of 'Target' to write to are in the group 'Finished'"
    refused(operator, giver, target, match=all_of_them, protected_group="Finished", only_selected=True)
