# SPDX-License-Identifier: GPL-3.0-or-later
"""Animated limbs to bake, and what the tests of all bakes ask of them."""

import bpy
import characters as c
import numpy as np
import skins as s

FRAMES = ((1, 0.0), (7, 100.0), (13, 20.0))


def animated_limb(name="Limb", **sizes):
    """A limb with a live skin whose middle bone bends and whose upper bone twists over frames 1 to 13."""
    ob, rig = s.limb(name, **sizes)
    s.animate(rig, FRAMES)
    s.animate(rig, ((1, 0.0), (13, 70.0)), "upper", 1)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 13
    s.enable(rig)
    return ob, rig


def saved(tmp_path, name="shot.blend"):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / name))
    return tmp_path


def bake(*objects, operator="bake", **options):
    c.activate(*objects)
    return getattr(bpy.ops.dermis, operator)(**options)


def at(ob, frame, subframe=0.0):
    bpy.context.scene.frame_set(frame, subframe=subframe)
    return s.shown(ob)


def everything(ob):
    """What a bake changes and the way back restores."""
    keys = ob.data.shape_keys
    blocks = [] if keys is None else [(k.name, k.value, k.mute, k.vertex_group) for k in keys.key_blocks]
    skin = {name: ob.dermis_skin.is_property_set(name) for name in ob.dermis_skin.bl_rna.properties.keys()}  # noqa: SIM118
    drivers = 0 if keys is None or keys.animation_data is None else len(keys.animation_data.drivers)
    scene = bpy.context.scene
    return (
        c.state(ob), blocks, skin, drivers, ob.active_shape_key_index,
        [(m.name, m.show_viewport, m.show_render) for m in ob.modifiers],
        (scene.frame_current, scene.frame_subframe),
    )  # fmt: skip


def kept_share(live, plain, baked):
    """How much of the correction is kept, over all frames and vertices."""
    lost, whole = (np.sqrt(np.mean((np.array(x) - np.array(live)) ** 2)) for x in (baked, plain))
    return 1.0 - lost / whole
