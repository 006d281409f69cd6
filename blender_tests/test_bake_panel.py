# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel of the bakes shows."""

import sys
from types import SimpleNamespace

import bakes as b
import bpy
import characters as c
from layouts import draw
from scratch_profile import MODULE

BUTTONS = [
    "dermis.bake", "dermis.bake_join", "dermis.bake_driven_keys", "dermis.bake_weights", "dermis.bake_shape_key",
]  # fmt: skip


def buttons(shown):
    return [name for name in shown if name.startswith("dermis.")]


def test_buttons_and_options():
    assert buttons(draw("DERMIS_PT_bake")) == BUTTONS
    shown = draw("DERMIS_PT_bake")
    assert {"use_scene_range", "directory", "file_format", "samples_per_frame"} <= set(shown)
    assert "frame_start" not in shown
    bpy.context.scene.dermis_bake.use_scene_range = False
    assert {"frame_start", "frame_end"} <= set(draw("DERMIS_PT_bake"))


def test_way_back(tmp_path):
    ob, rig = b.animated_limb()
    b.saved(tmp_path)
    c.activate(rig)
    assert "dermis.bake_remove" not in draw("DERMIS_PT_bake")
    b.bake(rig)
    shown = draw("DERMIS_PT_bake")
    assert "dermis.bake_remove" in shown
    assert "Limb: Point cache" in shown
    assert "Baked" in draw("DERMIS_PT_skin")
    b.bake(rig, operator="bake_remove")
    b.bake(ob, operator="bake_driven_keys")
    assert "Limb: Shape keys" in draw("DERMIS_PT_bake")


def test_options_are_described():
    for name in BUTTONS:
        kind = getattr(bpy.ops.dermis, name.split(".")[1]).get_rna_type()
        for prop in kind.properties:
            if prop.identifier not in ("rna_type", "files", "filter_glob"):
                assert prop.name, prop.identifier
                assert prop.description, prop.identifier
                assert not prop.description.endswith("."), prop.identifier


def test_panel_fills_the_operator():
    """A button takes over what the panel shows; what a script gave goes before."""
    kept = bpy.context.scene.dermis_bake
    kept.use_scene_range, kept.frame_start, kept.frame_end, kept.directory = False, 2, 5, "//caches"
    kind = bpy.ops.dermis.bake.get_rna_type()
    given = SimpleNamespace(bl_rna=kind, is_property_set=lambda name: name == "file_format")
    operator = SimpleNamespace(properties=given, file_format="MDD")
    sys.modules[f"{MODULE}.ui.bake_options"].fill_from_scene(operator, bpy.context.scene)
    shown = {name: value for name, value in vars(operator).items() if name != "properties"}
    assert shown == {
        "file_format": "MDD", "use_scene_range": False, "frame_start": 2, "frame_end": 5,
        "directory": "//caches", "samples_per_frame": 1,
    }  # fmt: skip
