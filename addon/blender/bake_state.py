# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts something baked in the place of a live skin, and the live skin back."""

from collections.abc import Sequence
from pathlib import Path

import bpy

from ..core.errors import InputError
from .baked_weights import check_kept_weights, restore_kept_weights
from .mesh_cache import find_cache
from .offset_keys import remove_keys
from .skin_key import find_key, write_offsets
from .skin_state import registry


def is_baked(ob: bpy.types.Object) -> bool:
    """Whether something stands in for the object's skin. Of an overridden object only the modifier tells it."""
    return bool(ob.dermis_skin.baked) or find_cache(ob) is not None


def switch_off(ob: bpy.types.Object, kind: str) -> None:
    """Let something baked stand in for the live skin: it is not solved any more, and its key does nothing.

    The key is muted, and emptied too: exporters write muted keys with their values.
    """
    kept = ob.dermis_skin
    key = find_key(ob)
    kept.key_was_muted = key.mute
    key.mute = True
    write_offsets(ob, None)
    kept.baked = kind
    registry.forget(ob)


def back_to_live(objects: Sequence[bpy.types.Object]) -> list[Path]:
    """Remove what was baked and switch live skins on again; the cache files that nothing uses any more.

    InputError leaves everything as it was.
    """
    for ob in objects:
        if ob.mode == "EDIT":
            raise InputError(f"'{ob.name}' is in Edit Mode: leave it first.")
        if ob.dermis_skin.baked == "WEIGHTS":
            check_kept_weights(ob)
    files = set()
    for ob in objects:
        cache = find_cache(ob)
        if cache is not None:
            files.add(_path(cache))
            ob.modifiers.remove(cache)
        kept = ob.dermis_skin
        if kept.baked == "KEYS":
            remove_keys(ob, kept.baked_keys.split("\n"))
        elif kept.baked == "WEIGHTS":
            restore_kept_weights(ob)
        key = find_key(ob)
        if kept.baked and key is not None:
            key.mute = kept.key_was_muted
        for name in ("baked", "baked_keys", "key_was_muted"):
            kept.property_unset(name)
        registry.forget(ob)
        ob.update_tag(refresh={"OBJECT"})
    used = {_path(m) for ob in bpy.data.objects for m in ob.modifiers if m.type == "MESH_CACHE"}
    return sorted(files - used)


def _path(cache: bpy.types.MeshCacheModifier) -> Path:
    return Path(bpy.path.abspath(cache.filepath))
