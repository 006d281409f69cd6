# SPDX-License-Identifier: GPL-3.0-or-later
"""What a fit refuses, and that it then changes nothing."""

import math
import sys
from types import SimpleNamespace

import bpy
import characters as c
import fits
import numpy as np
import pytest
from odd_bodies import ODD_BODIES
from scratch_profile import MODULE
from windows import stand_in_for


@pytest.fixture
def body():
    return fits.bare_body()


def test_a_failed_write_leaves_everything_as_it_was(body, monkeypatch):
    module = sys.modules[f"{MODULE}.blender.rest_bones"]

    def fails(_):
        raise OSError("disk on fire")

    original = module.Vector
    made = []

    def vector(values):
        made.append(values)
        return original(values) if len(made) < 9 else fails(values)

    monkeypatch.setattr(module, "Vector", vector)
    rig = fits.template()
    c.activate(rig, body)
    before = fits.everything()
    with pytest.raises(RuntimeError, match="Disk on fire"):
        bpy.ops.dermis.fit_skeleton()
    assert len(made) == 9
    assert fits.everything() == before


def test_bones_that_blender_would_remove(body, monkeypatch):
    module = sys.modules[f"{MODULE}.core.fit"]
    original = module.fit_skeleton

    def collapsed(*arguments, **options):
        fitted = original(*arguments, **options)
        skeleton = fitted.skeleton
        tails = skeleton.tails.copy()
        place = skeleton.names.index("head")
        tails[place] = skeleton.heads[place]
        return SimpleNamespace(
            skeleton=SimpleNamespace(heads=skeleton.heads, tails=tails),
            **{name: getattr(fitted, name) for name in ("method", "score", "message", "found", "symmetric")},
        )

    monkeypatch.setattr(module, "fit_skeleton", collapsed)
    fits.failed(fits.template(), body, match="Bones of 'Rig' would be too short for Blender: 'head'")


def test_refusals(body):
    rig = fits.template()
    with pytest.raises(RuntimeError, match="Select the meshes too"):
        fits.fit(rig)
    with pytest.raises(RuntimeError, match="Make the armature active: click 'Rig' last"):
        fits.fit(body, rig)
    with pytest.raises(RuntimeError, match="so that the armature is active"):
        fits.fit(body)
    c.activate(rig)
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = None
    with pytest.raises(RuntimeError, match="so that the armature is active"):
        bpy.ops.dermis.fit_skeleton()

    points = c.mesh_object("Points", [(0, 0, 0), (1, 0, 0)], [])
    fits.failed(rig, body, points, match="'Points' has 2 vertices and no faces")
    broken = c.mesh_object("Broken", [(0, 0, 0), (1, 0, 0), (0, math.nan, 0)], [(0, 1, 2)])
    fits.failed(rig, broken, match="'Broken' has coordinates that are not finite at 1 vertex, the first is vertex 2")
    flattened = c.mesh_object("Flattened", *c.tube(5, 4))
    flattened.scale.y = 0
    fits.failed(rig, flattened, match="'Flattened' is scaled to zero along some axis")
    carried = c.mesh_object("Carried", *c.tube(5, 4))
    carried.parent, carried.parent_type, carried.parent_bone = rig, "BONE", "head"
    fits.failed(rig, body, carried, match="'Carried' is parented to the bone 'head' of 'Rig'")
    for bone in rig.data.bones:
        bone.select = False
    fits.failed(rig, body, keep_selected=True, match="No bone of 'Rig' is selected")
    for bone in rig.data.bones:
        bone.select = True
    fits.failed(rig, body, keep_selected=True, match="All bones of 'Rig' are kept where they are")
    for bone in rig.data.bones:
        bone.use_deform = bone.name == "head"
    fits.failed(rig, body, match="Armature 'Rig' has one bone to fit, 'head'")
    rig.data.bones["head"].use_deform = False
    fits.failed(rig, body, match="Armature 'Rig' has no deforming bone")
    fits.failed(c.armature("Empty", []), body, match="Armature 'Empty' has no deforming bone")
    shared = fits.template("Shared")
    twin = bpy.data.objects.new("Twin", shared.data)
    bpy.context.collection.objects.link(twin)
    fits.failed(shared, body, match="The armature data 'Shared' is used by 'Shared', 'Twin', which would all change")
    shrunk = fits.template("Shrunk")
    shrunk.scale.x = 0
    fits.failed(shrunk, body, match="'Shrunk' is scaled to zero along some axis")


def test_a_linked_armature(body, tmp_path):
    fits.template("Linked")
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {bpy.data.objects["Linked"]}, fake_user=True)
    bpy.data.objects.remove(bpy.data.objects["Linked"])
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["Linked"]
    rig = wanted.objects[0]
    bpy.context.collection.objects.link(rig)
    fits.failed(rig, body, match="The object 'Linked' is linked from .* and cannot be changed")
    override = rig.override_create(remap_local_usages=True)
    fits.failed(override, body, match="is linked from|is a library override")


# Each gives an error that changes nothing, or the scaled template with a warning.
@pytest.mark.parametrize("name", ODD_BODIES)
def test_odd_bodies(name):
    rig = fits.template()
    ob = c.mesh_object("Odd", *ODD_BODIES[name])
    c.activate(rig, ob)
    bpy.context.view_layer.update()
    before = fits.everything()
    operator = stand_in_for("fit_skeleton")
    status = operator.execute(bpy.context)
    ((kind, text),) = operator.reports
    if status == {"CANCELLED"}:
        assert kind == "ERROR"
        assert text.startswith("'Rig' cannot be fitted into 'Odd': ")
        assert text.endswith("Nothing was changed.")
        assert fits.everything() == before
    else:
        assert (status, kind) == ({"FINISHED"}, "WARNING")
        vertices = np.array([v.co for v in ob.data.vertices])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        points = np.concatenate([fits.joints(rig)[bone] for bone in c.bone_names(rig)])
        size = np.linalg.norm(high - low)
        assert (points > low - 0.5 * size).all()
        assert (points < high + 0.5 * size).all()


def test_several_roots(body):
    bones = [*c.biped_bones(), ("hat", None, (0, 0, 1.85), (0, 0, 2.0)), ("tool", None, (1, 0, 0), (1, 0, 0.3))]
    rig = c.armature("Rig", bones)
    assert fits.fit(rig, body) == {"FINISHED"}
    assert len(rig.data.bones) == len(bones)
