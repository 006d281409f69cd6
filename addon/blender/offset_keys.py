# SPDX-License-Identifier: GPL-3.0-or-later
"""Shape keys that hold offsets of the Basis: added, and removed with all that moves them."""

from collections.abc import Sequence

import bpy
import numpy as np

from .mesh import rest_positions


def add_offset_key(ob: bpy.types.Object, name: str, offsets: np.ndarray, value: float) -> bpy.types.ShapeKey:
    """A shape key at the end that adds offsets (V,3) to the Basis; the active key stays active."""
    active = ob.active_shape_key_index
    key = ob.shape_key_add(name=name, from_mix=False)
    key.relative_key = ob.data.shape_keys.reference_key
    key.points.foreach_set("co", (rest_positions(ob.data) + offsets).astype(np.float32).ravel())
    key.value = value
    ob.active_shape_key_index = active
    return key


def remove_keys(ob: bpy.types.Object, names: Sequence[str]) -> None:
    """Remove keys with their drivers and keyframes; the active key stays active."""
    keys = ob.data.shape_keys
    blocks = [keys.key_blocks[name] for name in names if name in keys.key_blocks]
    paths = {block.path_from_id("value") for block in blocks}
    had_animation = keys.animation_data is not None
    active = ob.active_shape_key_index
    for block in blocks:
        block.driver_remove("value")
    if had_animation and keys.animation_data is not None:
        for curves in _curves(keys.animation_data.action):
            for curve in [curve for curve in curves if curve.data_path in paths]:
                curves.remove(curve)
    for block in blocks:
        ob.shape_key_remove(block)
    ob.active_shape_key_index = min(active, len(keys.key_blocks) - 1)
    _clear_empty(keys)


def _curves(action: bpy.types.Action | None) -> list[bpy.types.bpy_prop_collection]:
    """The collections of f-curves of an action, with layers or without."""
    if action is None:
        return []
    if not hasattr(action, "layers"):
        return [action.fcurves]
    return [bag.fcurves for layer in action.layers for strip in layer.strips for bag in strip.channelbags]


def _clear_empty(keys: bpy.types.Key) -> None:
    """Take animation data away that holds nothing, and an action of which nothing is left."""
    data = keys.animation_data
    if data is None:
        return
    if data.action is not None and not any(len(curves) for curves in _curves(data.action)):
        action = data.action
        data.action = None
        if not action.users:
            bpy.data.actions.remove(action)
    if data.action is None and not data.drivers and not data.nla_tracks:
        keys.animation_data_clear()
