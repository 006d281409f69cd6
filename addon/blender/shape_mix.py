# SPDX-License-Identifier: GPL-3.0-or-later
"""The shape that the other shape keys make before the Armature modifier acts."""

import bpy
import numpy as np

from .skin_key import KEY_NAME


def key_groups(mesh: bpy.types.Mesh) -> tuple[str, ...]:
    """Names of the vertex groups that limit shape keys other than the skin's."""
    keys = mesh.shape_keys
    if keys is None:
        return ()
    return tuple(sorted({key.vertex_group for key in keys.key_blocks if key.vertex_group and key.name != KEY_NAME}))


def mixed_positions(
    ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph, groups: dict[str, np.ndarray]
) -> tuple[np.ndarray | None, float]:
    """Positions (V,3) float64 in the object's space, None where no other key acts; and the skin key's value.

    Values are those of the evaluated scene, drivers and animation included. `groups` holds the
    weights (V,) of the groups that `key_groups` names.
    """
    keys = ob.data.shape_keys
    blocks = keys.key_blocks
    values = np.empty(len(blocks), np.float32)
    keys.evaluated_get(depsgraph).key_blocks.foreach_get("value", values)
    muted = np.empty(len(blocks), np.bool_)
    blocks.foreach_get("mute", muted)
    values[muted] = 0.0
    reference = keys.reference_key
    own = blocks.find(KEY_NAME)
    mix = None
    for index in np.flatnonzero(values).tolist():
        key = blocks[index]
        if index == own or key == reference:
            continue
        if mix is None:
            mix = _points(reference)
        offset = float(values[index]) * (_points(key) - _points(key.relative_key))
        if key.vertex_group:
            offset *= groups[key.vertex_group][:, None]
        mix += offset
    return mix, float(values[own])


def _points(key: bpy.types.ShapeKey) -> np.ndarray:
    flat = np.empty(len(key.points) * 3, np.float32)
    key.points.foreach_get("co", flat)
    return flat.reshape(-1, 3).astype(np.float64)


def acting_keys(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[dict[str, float], float | None]:
    """Values of the shape keys other than the skin's that act in an evaluated scene, and the skin key's value.

    The latter is None where the object has no such key.
    """
    keys = ob.data.shape_keys
    if keys is None:
        return {}, None
    values = np.empty(len(keys.key_blocks), np.float32)
    keys.evaluated_get(depsgraph).key_blocks.foreach_get("value", values)
    acting = {key.name: 0.0 if key.mute else float(value) for key, value in zip(keys.key_blocks, values, strict=True)}
    own = acting.pop(KEY_NAME, None)
    acting.pop(keys.reference_key.name, None)
    return {name: value for name, value in acting.items() if value}, own


def key_offsets(ob: bpy.types.Object, names: set[str], groups: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Offsets (V,3) float64 of the named shape keys, limited by their groups, in the order of the keys."""
    offsets = {}
    for key in ob.data.shape_keys.key_blocks if names else ():
        if key.name in names:
            offset = _points(key) - _points(key.relative_key)
            offsets[key.name] = offset * groups[key.vertex_group][:, None] if key.vertex_group else offset
    return offsets
