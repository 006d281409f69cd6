# SPDX-License-Identifier: GPL-3.0-or-later
"""The shape key that holds the skin's correction of the pose shown."""

import bpy
import numpy as np

from ..core.errors import InputError
from .mesh import rest_positions

KEY_NAME = "Dermis"


def find_key(ob: bpy.types.Object) -> bpy.types.ShapeKey | None:
    """The key, where the object has it."""
    keys = ob.data.shape_keys
    return None if keys is None else keys.key_blocks.get(KEY_NAME)


def check_no_key(ob: bpy.types.Object) -> None:
    """Raise InputError where someone else's key has the name."""
    if find_key(ob) is not None:
        raise InputError(f"'{ob.name}' already has a shape key named '{KEY_NAME}': rename or remove it.")


def add_key(ob: bpy.types.Object) -> bool:
    """Add the key, at full value and without effect; true where it needed a Basis of its own."""
    active = ob.active_shape_key_index
    needs_basis = ob.data.shape_keys is None
    if needs_basis:
        ob.shape_key_add(name="Basis", from_mix=False)
    key = ob.shape_key_add(name=KEY_NAME, from_mix=False)
    key.relative_key = ob.data.shape_keys.reference_key
    key.slider_min, key.slider_max, key.value = 0.0, 1.0, 1.0
    write_offsets(ob, None)
    ob.active_shape_key_index = active
    return needs_basis


def remove_key(ob: bpy.types.Object, with_basis: bool) -> None:
    """Remove the key, and the Basis where nothing else needs it."""
    active = ob.active_shape_key_index
    key = find_key(ob)
    if key is not None:
        ob.shape_key_remove(key)
    keys = ob.data.shape_keys
    if with_basis and keys is not None and len(keys.key_blocks) == 1:
        ob.shape_key_remove(keys.reference_key)
    keys = ob.data.shape_keys
    if keys is not None:
        ob.active_shape_key_index = min(active, len(keys.key_blocks) - 1)


def write_offsets(ob: bpy.types.Object, offsets: np.ndarray | None) -> None:
    """Set the key to the rest shape plus offsets (V,3) float32 in the object's space, none of them for None."""
    positions = rest_positions(ob.data)
    if offsets is not None:
        positions += offsets
    find_key(ob).points.foreach_set("co", positions.ravel())
    ob.data.update_tag()
