# SPDX-License-Identifier: GPL-3.0-or-later
"""Characters that live in another file: a point cache plays on a library override, where no key can be kept."""

import bakes as b
import bpy
import numpy as np
import pytest
import skins as s

TOLERANCE = 1e-5 * s.HEIGHT


@pytest.fixture(params=[True, False], ids=["live in the library", "plain in the library"])
def linked(tmp_path, request):
    """What the skin shows at frame 7 in its own file, and the overriding objects in another."""
    ob, rig = b.animated_limb()
    collection = bpy.data.collections.new("Character")
    bpy.context.scene.collection.children.link(collection)
    for item in (ob, rig):
        collection.objects.link(item)
    wanted = b.at(ob, 7)
    bpy.context.scene.frame_set(1)
    if not request.param:
        s.disable(rig)
    b.saved(tmp_path, "library.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, to):
        to.collections = ["Character"]
    bpy.context.scene.collection.children.link(to.collections[0])
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 13
    b.saved(tmp_path, "shot.blend")
    return wanted


def overridden():
    bpy.data.collections["Character"].override_hierarchy_create(bpy.context.scene, bpy.context.view_layer)
    local = [ob for ob in bpy.data.objects if ob.override_library is not None]
    return {ob.type: ob for ob in local}


def test_an_override_is_baked_and_stays_so(linked, tmp_path):
    found = overridden()
    assert b.bake(found["MESH"]) == {"FINISHED"}
    np.testing.assert_allclose(b.at(found["MESH"], 7), linked, atol=TOLERANCE)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    found = {ob.type: ob for ob in bpy.data.objects if ob.override_library is not None}
    np.testing.assert_allclose(b.at(found["MESH"], 7), linked, atol=TOLERANCE)
    assert s.state(found["MESH"]) is None, "no skin is tried where the cache plays"
    with pytest.raises(RuntimeError, match="Back to Live"):
        b.bake(found["ARMATURE"])
    assert b.bake(found["ARMATURE"], operator="bake_remove") == {"FINISHED"}
    assert [m.name for m in found["MESH"].modifiers] == ["Armature"]


@pytest.mark.usefixtures("linked")
def test_what_is_only_linked_gets_a_clear_message():
    ob = next(ob for ob in bpy.data.objects if ob.type == "MESH")
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="Library Override"):
        b.bake(ob)


def test_meshes_shared_by_objects(tmp_path):
    """A key would show on both; each has a cache of its own."""
    ob, rig = s.limb()
    s.animate(rig, b.FRAMES)
    s.enable(rig)
    wanted = b.at(ob, 7)
    s.disable(rig)
    twin = ob.copy()
    bpy.context.collection.objects.link(twin)
    b.saved(tmp_path)
    assert b.bake(ob, twin, use_scene_range=False, frame_start=1, frame_end=13) == {"FINISHED"}
    for each in (ob, twin):
        np.testing.assert_allclose(b.at(each, 7), wanted, atol=TOLERANCE)
