# SPDX-License-Identifier: GPL-3.0-or-later
"""Switches skins of objects on and off."""

from collections.abc import Sequence
from contextlib import ExitStack

import bpy
import numpy as np

from ..core.errors import InputError
from . import placement
from .armature import find_armature, is_deformed
from .skin_checks import check_owner, check_shape_keys, skin_modifier
from .skin_key import add_key, check_no_key, find_key, remove_key
from .skin_reading import read_settings, read_skin
from .skin_state import registry
from .vertex_groups import read_groups


def meshes_of(armature: bpy.types.Object, scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Mesh objects of a scene that the armature deforms, by name; what only hangs on it is none of them."""
    found = [ob for ob in scene.objects if ob.type == "MESH" and is_deformed(ob) and find_armature(ob) == armature]
    return sorted(found, key=lambda ob: ob.name)


def rigid_meshes(objects: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    """Those of the objects that no joint bends: a single bone moves them, or none."""
    rigid = []
    for ob in objects:
        armature = find_armature(ob)
        groups = read_groups(ob)
        names = [bone.name for bone in armature.data.bones if bone.use_deform]
        weights = groups.of_bones(names)
        used = np.unique(weights.bone[weights.value > 0])
        if len(used) == 0 or (len(used) == 1 and armature.data.bones[names[used[0]]].bbone_segments == 1):
            rigid.append(ob)
    return rigid


def enable_skins(objects: Sequence[bpy.types.Object], depsgraph: bpy.types.Depsgraph) -> None:
    """Give all objects a skin, or none: an InputError leaves everything as it was.

    Builds the skins; the shape keys get their content when the scene is evaluated next. An object
    that has a skin is bound again.
    """
    bindings = [_bind(ob, depsgraph) for ob in objects]
    with ExitStack() as undo:
        for ob, (place, geometry_key) in zip(objects, bindings, strict=True):
            kept = ob.dermis_skin
            if find_key(ob) is None:
                undo.callback(_take_key, ob)
                kept.made_basis |= add_key(ob)
            placement.store(ob, place, geometry_key)
            kept.enabled = True
            find_key(ob).vertex_group = kept.mask_group
            state = registry.state(ob)
            state.suspect, state.written, state.notice, state.error = True, None, "", ""
        undo.pop_all()
    registry.rescan()


def disable_skins(objects: Sequence[bpy.types.Object]) -> None:
    """Take the skins off again; everything else stays as it is."""
    for ob in objects:
        check_owner(ob)
        _check_live(ob)
    for ob in objects:
        _take_key(ob)
        registry.forget(ob)


def _bind(ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[placement.Placement, str]:
    """Check everything and build the skin, without changing anything."""
    check_owner(ob)
    _check_live(ob)
    if ob.mode == "EDIT":
        raise InputError(f"'{ob.name}' is in Edit Mode: leave it first.")
    if not ob.dermis_skin.enabled:
        check_no_key(ob)
    check_shape_keys(ob)
    modifier = skin_modifier(ob)
    place = placement.place(ob.evaluated_get(depsgraph), modifier.object.evaluated_get(depsgraph))
    reading = read_skin(ob, modifier, read_settings(ob), depsgraph, place)
    registry.skin(reading, reading.skin_key(place), place)
    return place, reading.geometry_key


def _check_live(ob: bpy.types.Object) -> None:
    if ob.dermis_skin.baked:
        raise InputError(f"The skin of '{ob.name}' is baked: use Back to Live first.")


def _take_key(ob: bpy.types.Object) -> None:
    kept = ob.dermis_skin
    remove_key(ob, kept.made_basis)
    for name in ("enabled", "made_basis", "object_matrix", "armature_matrix", "geometry_key"):
        kept.property_unset(name)
