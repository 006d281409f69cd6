# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel of the PBD skin shows, and that its settings are described."""

import bpy
import characters as c
import pytest
import skins as s
from layouts import draw


def test_without_anything():
    *reason, button = draw("DERMIS_PT_skin")
    assert " ".join(reason) == "Make an armature active, or select its meshes."
    assert button == "dermis.skin_enable"
    assert not bpy.types.DERMIS_PT_skin_settings.poll(bpy.context)


def test_switch_influence_statistics_and_settings():
    ob, rig = s.limb()
    c.activate(rig)
    assert draw("DERMIS_PT_skin") == ["dermis.skin_enable"]
    s.enable(rig)
    s.bend(rig, 80)
    shown = draw("DERMIS_PT_skin")
    assert shown[:3] == ["dermis.skin_enable", "dermis.skin_disable", "value"]
    line = " ".join(shown[3:])
    stats = s.state(ob).stats
    assert f"{stats['tetrahedra']:,} tetrahedra" in line
    assert f"{sum(stats['constraints'].values()):,} constraints" in line
    assert "ms per frame" in line
    assert "use_lock_interface" in shown
    bpy.context.scene.render.use_lock_interface = True
    assert "use_lock_interface" not in draw("DERMIS_PT_skin")
    settings = draw("DERMIS_PT_skin_settings")
    for name in ("preset", "cell_size", "iterations", "stiffness", "volume", "self_collision", "smoothing"):
        assert name in settings
    s.bend(rig, 180, axis=1)
    assert "limited" in " ".join(draw("DERMIS_PT_skin"))


def test_one_line_for_an_error():
    ob, rig = s.limb()
    s.enable(rig)
    ob.modifiers["Armature"].use_bone_envelopes = True
    bpy.context.view_layer.update()
    assert "switch Bone Envelopes off" in " ".join(draw("DERMIS_PT_skin"))
    assert "constraints" not in " ".join(draw("DERMIS_PT_skin"))


def test_several_meshes_show_their_own_influence():
    _, rig = s.limb()
    other = c.mesh_object("Other", *c.tube(12, 13))
    c.paint(other, rig)
    c.deform(other, rig)
    s.enable(rig)
    assert draw("DERMIS_PT_skin").count("value") == 2
    assert not bpy.types.DERMIS_PT_skin_settings.poll(bpy.context)
    c.activate(other)
    assert bpy.types.DERMIS_PT_skin_settings.poll(bpy.context)


def test_settings_are_described_and_bounded():
    ob, _ = s.limb()
    for prop in ob.dermis_skin.bl_rna.properties:
        if prop.identifier not in ("rna_type", "name"):
            assert prop.description, prop.identifier
            assert prop.is_hidden or not prop.is_animatable, prop.identifier
            if prop.type in ("INT", "FLOAT") and not prop.is_hidden:
                assert prop.hard_min >= 0, prop.identifier


@pytest.mark.parametrize("preset", ["default", "paper", "rumman_fratarcangeli"])
def test_presets_fill_the_settings(preset):
    import dermis_native as native

    ob, _ = s.limb()
    ob.dermis_skin.preset = "PAPER"
    ob.dermis_skin.preset = preset.upper()
    for name, value in native.pbd_preset(preset).items():
        shown = getattr(ob.dermis_skin, name, None)
        if isinstance(shown, str):
            assert shown == value.upper()
        elif shown is not None and name != "cell_size":
            assert shown == pytest.approx(value)
