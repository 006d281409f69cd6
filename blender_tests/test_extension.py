# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension as installed: where it comes from, what it registers, what it draws."""

import sys

import bpy
import characters as c
import pytest
from layouts import Drawn, Layout, draw
from scratch_profile import MODULE, PROFILE

OPERATORS = (
    "retarget_weights",
    "fit_skeleton",
    "bind_weights",
    "check",
    "select_problems",
    "map_bones",
    "bone_map_add",
    "bone_map_remove",
    "bone_map_clear",
    "landmark_add",
    "landmark_remove",
    "landmark_show",
    "landmark_clear",
    "skin_enable",
    "skin_disable",
)
PANELS = (
    "DERMIS_PT_retarget",
    "DERMIS_PT_landmarks",
    "DERMIS_PT_fit",
    "DERMIS_PT_bind",
    "DERMIS_PT_check",
    "DERMIS_PT_bone_map",
    "DERMIS_UL_bone_map",
    "DERMIS_UL_landmarks",
    "DERMIS_PT_skin",
    "DERMIS_PT_skin_settings",
)
MENUS = {
    "VIEW3D_MT_make_links": ("dermis.retarget_weights",),
    "VIEW3D_MT_paint_weight": ("dermis.retarget_weights", "dermis.check"),
    "VIEW3D_MT_object_parent": ("dermis.fit_skeleton", "dermis.bind_weights"),
    "VIEW3D_MT_edit_armature": ("dermis.fit_skeleton",),
    "VIEW3D_MT_pose": ("dermis.fit_skeleton",),
}


def test_everything_comes_from_the_zip():
    assert sys.modules[MODULE].__file__.startswith(PROFILE)
    assert sys.modules["dermis_native"].__file__.startswith(PROFILE)


def entries(menu):
    return [f for f in getattr(bpy.types, menu).draw._draw_funcs if f.__module__.startswith(MODULE)]


def handlers():
    for name in dir(bpy.app.handlers):
        found = getattr(bpy.app.handlers, name)
        if isinstance(found, list):
            yield from (f for f in found if f.__module__.startswith(MODULE))


def test_register_and_unregister_twice():
    for _ in range(2):
        assert bpy.ops.preferences.addon_disable(module=MODULE) == {"FINISHED"}
        assert not any(hasattr(bpy.types, panel) for panel in PANELS)
        assert not hasattr(bpy.types.Object, "dermis_retarget")
        assert not hasattr(bpy.types.Object, "dermis_skin")
        assert not any(handlers())
        assert not any("dermis" in dir(bpy.ops) and name in dir(bpy.ops.dermis) for name in OPERATORS)
        assert not any(entries(menu) for menu in MENUS)
        assert bpy.ops.preferences.addon_enable(module=MODULE) == {"FINISHED"}
        assert all(name in dir(bpy.ops.dermis) for name in OPERATORS)
        assert all(hasattr(bpy.types, panel) for panel in PANELS)
        # Blender drops handlers that are not persistent when it opens a file.
        assert len(list(handlers())) == 7
        assert all(hasattr(handler, "_bpy_persistent") for handler in handlers())
    source, _ = c.source_tube()
    assert c.retarget(source, c.target_tube()) == {"FINISHED"}


def test_menus():
    for menu, operators in MENUS.items():
        stand_in = Drawn()
        for entry in entries(menu):
            entry(stand_in, bpy.context)
        drawn = [item for item in stand_in.layout.drawn if str(item).startswith("dermis.")]
        assert drawn == list(operators)


def test_operators_undo_and_have_descriptions():
    for name in OPERATORS:
        operator = getattr(bpy.ops.dermis, name).get_rna_type()
        assert operator.description
        for prop in operator.properties:
            assert prop.identifier == "rna_type" or prop.description, prop.identifier
        assert {"REGISTER", "UNDO"} <= getattr(bpy.ops.dermis, name).bl_options


def test_panel_without_anything():
    assert "dermis.retarget_weights" in draw("DERMIS_PT_retarget")
    assert "Select one source and one target" in draw("DERMIS_PT_landmarks")


def test_panel_with_source_and_targets():
    source, _ = c.source_tube()
    target = c.target_tube()
    c.retarget(source, target)
    shown = draw("DERMIS_PT_retarget")
    assert {"Source", "SourceRig", "Target"} <= set(shown)
    assert "146 vertices" in " ".join(shown)
    assert "DERMIS_UL_landmarks" in draw("DERMIS_PT_landmarks")
    c.activate(source, target, c.target_tube("Second"))
    assert "2 meshes" in draw("DERMIS_PT_retarget")


def test_landmark_list_draws_a_pair():
    target = c.target_tube()
    pair = target.dermis_retarget.landmarks.add()
    drawn = []
    bpy.types.DERMIS_UL_landmarks.draw_item(None, bpy.context, Layout(drawn), target, pair, 0, target, "", 0, 0)
    assert drawn == ["name", "source_vertex", "target_vertex"]


@pytest.mark.parametrize("problem", ["missing", "old"])
def test_native_module_that_cannot_be_used(monkeypatch, problem):
    """The add-on shows what to do instead of a traceback, and recovers."""
    assert bpy.ops.preferences.addon_disable(module=MODULE) == {"FINISHED"}
    if problem == "missing":
        monkeypatch.setitem(sys.modules, "dermis_native", None)
    else:
        monkeypatch.setattr(sys.modules["dermis_native"], "__version__", "0.0.1")
    assert bpy.ops.preferences.addon_enable(module=MODULE) == {"FINISHED"}
    assert not hasattr(bpy.types, "DERMIS_PT_retarget")
    lines = " ".join(draw("DERMIS_PT_missing_native"))
    assert ("could not be loaded" if problem == "missing" else "found the native module 0.0.1") in lines
    assert bpy.ops.preferences.addon_disable(module=MODULE) == {"FINISHED"}
    assert not hasattr(bpy.types, "DERMIS_PT_missing_native")
    monkeypatch.undo()
    assert bpy.ops.preferences.addon_enable(module=MODULE) == {"FINISHED"}
    assert hasattr(bpy.types, "DERMIS_PT_retarget")
