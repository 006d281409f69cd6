# SPDX-License-Identifier: GPL-3.0-or-later
"""Binding where hardly anything is as it should be: weights for every vertex, or an error that changes nothing."""

import bpy
import characters as c
import fits
import numpy as np
import pytest
from odd_bodies import ODD_BODIES
from windows import stand_in_for


def bound(ob, rig):
    """Bind; true when it went, and then every vertex has weights."""
    c.activate(rig, ob)
    bpy.context.view_layer.update()
    before = c.state(ob), fits.rest(rig), fits.settings(rig)
    operator = stand_in_for("bind_weights")
    status = operator.execute(bpy.context)
    [(kind, text)] = operator.reports
    if status == {"FINISHED"}:
        assert kind == "INFO"
        np.testing.assert_allclose(c.dense(ob, c.bone_names(rig)).sum(axis=1), 1, atol=1e-5)
        return True
    assert (status, kind) == ({"CANCELLED"}, "ERROR")
    assert "'Odd'" in text
    assert text.endswith("Nothing was changed.")
    assert (c.state(ob), fits.rest(rig), fits.settings(rig)) == before
    return False


@pytest.mark.parametrize("name", ODD_BODIES)
def test_odd_bodies(name):
    ob = c.mesh_object("Odd", *ODD_BODIES[name])
    assert bound(ob, fits.template())


@pytest.mark.parametrize(
    "bones",
    [
        [("only", None, (0, 0, 1), (0, 0, 2))],
        [("one", None, (0, 0, 0), (0, 0, 1)), ("two", None, (0, 0, 2), (0, 0, 3))],
        [("tiny", None, (0, 0, 1), (0, 0, 1.00001)), ("long", "tiny", (0, 0, 1), (0, 0, 3))],
        [("outside", None, (9, 0, 1), (9, 0, 2)), ("far", None, (0, -80, 0), (0, -90, 0))],
        [("twin", None, (0, 0, 0), (0, 0, 3)), ("same place", None, (0, 0, 0), (0, 0, 3))],
    ],
    ids=lambda bones: bones[0][0],
)
def test_odd_skeletons(bones):
    assert bound(c.mesh_object("Odd", *c.tube(12, 13)), c.armature("Rig", bones))


def test_a_linked_mesh(tmp_path):
    c.mesh_object("Odd", *c.tube(12, 13))
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {bpy.data.objects["Odd"]}, fake_user=True)
    bpy.data.objects.remove(bpy.data.objects["Odd"])
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["Odd"]
    bpy.context.collection.objects.link(wanted.objects[0])
    assert not bound(wanted.objects[0], c.armature("Rig", c.tube_bones()))


def test_a_flattened_armature():
    rig = c.armature("Odd", c.tube_bones())
    rig.scale.z = 0
    assert not bound(c.mesh_object("Tube", *c.tube(12, 13)), rig)
