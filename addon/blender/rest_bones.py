# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads and moves the rest bones of an armature, which Blender allows in Edit Mode only."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from ..core.errors import InputError
from ..core.fit import check_lengths
from ..core.roll import turned_axes

# Edit Mode removes bones up to this length when it is left; twice that is safe in single precision.
SHORTEST = 2e-6


@dataclass(frozen=True)
class RestBones:
    """All bones of an armature at rest, in its own space.

    heads, tails and axes (B,3): joints and the bones' Z axes, which hold the roll; parents (B,), -1
    for a root; deform, connected, locked and selected (B,): flags of the bones in Edit Mode.
    """

    names: tuple[str, ...]
    heads: np.ndarray
    tails: np.ndarray
    axes: np.ndarray
    parents: np.ndarray
    deform: np.ndarray
    connected: np.ndarray
    locked: np.ndarray
    selected: np.ndarray

    def same_rest(self, other: "RestBones") -> bool:
        """Whether both have the same bones at the same places."""
        return self.names == other.names and all(
            np.array_equal(getattr(self, each), getattr(other, each)) for each in ("heads", "tails", "axes", "parents")
        )


@contextmanager
def edit_bones(armature: bpy.types.Object) -> Iterator[bpy.types.ArmatureEditBones]:
    """The edit bones of the active armature, without mirroring; mode and selection come back afterwards."""
    layer = bpy.context.view_layer
    if layer.objects.active != armature:
        raise InputError(f"Armature '{armature.name}' is no longer the active object.")
    mirrored, armature.data.use_mirror_x = armature.data.use_mirror_x, False
    try:
        with _edit_mode(armature, layer):
            yield armature.data.edit_bones
    finally:
        armature.data.use_mirror_x = mirrored


def read_rest(bones: bpy.types.ArmatureEditBones) -> RestBones:
    """The bones of an armature in Edit Mode."""
    index = {bone.name: place for place, bone in enumerate(bones)}

    def flags(name: str) -> np.ndarray:
        return np.array([getattr(bone, name) for bone in bones], np.bool_)

    def points(values) -> np.ndarray:
        return np.array(list(values), np.float64).reshape(-1, 3)

    return RestBones(
        names=tuple(index),
        heads=points(bone.head for bone in bones),
        tails=points(bone.tail for bone in bones),
        axes=points(bone.z_axis for bone in bones),
        parents=np.array([-1 if bone.parent is None else index[bone.parent.name] for bone in bones], np.int32),
        deform=flags("use_deform"),
        connected=flags("use_connect") & np.array([bone.parent is not None for bone in bones], np.bool_),
        locked=flags("lock"),
        selected=flags("select"),
    )


def move_rest(
    name: str, bones: bpy.types.ArmatureEditBones, rest: RestBones, heads: np.ndarray, tails: np.ndarray
) -> None:
    """Put the bones that `rest` describes at new joints (B,3), all or none.

    A bone's roll goes along with the smallest rotation from its old direction to the new one. A
    connected bone begins at its parent's tail. `name` is the armature's, for errors.
    """
    heads = heads.astype(np.float32)
    tails = tails.astype(np.float32)
    heads[rest.connected] = tails[rest.parents[rest.connected]]
    lengths = np.linalg.norm(tails.astype(np.float64) - heads, axis=1)
    check_lengths(name, rest.names, lengths, SHORTEST)
    moved = (heads != rest.heads).any(axis=1) | (tails != rest.tails).any(axis=1)
    axes = turned_axes(rest.axes, rest.tails - rest.heads, (tails - heads).astype(np.float64))
    before = [(bone, bone.head.copy(), bone.tail.copy(), bone.roll) for bone in bones]
    try:
        for place, bone in enumerate(bones):
            bone.head, bone.tail = Vector(heads[place]), Vector(tails[place])
        for place in np.flatnonzero(moved):
            bones[int(place)].align_roll(Vector(axes[place]))
    except BaseException:
        for bone, head, tail, _ in before:
            bone.head, bone.tail = head, tail
        for bone, _, _, roll in before:
            bone.roll = roll
        raise


@contextmanager
def _edit_mode(armature: bpy.types.Object, layer: bpy.types.ViewLayer) -> Iterator[None]:
    mode = armature.mode
    if mode == "EDIT":
        yield
        return
    # Blender takes all selected armatures along from mode to mode.
    together = [ob for ob in layer.objects if ob.type == "ARMATURE" and ob != armature]
    selected = [ob for ob in together if ob.select_get(view_layer=layer)]
    in_mode = [ob for ob in together if ob.mode == mode != "OBJECT"]
    own = armature.select_get(view_layer=layer)
    for ob in selected:
        ob.select_set(False, view_layer=layer)
    try:
        bpy.ops.object.mode_set(mode="EDIT")
        try:
            yield
        finally:
            if mode == "OBJECT":
                bpy.ops.object.mode_set(mode="OBJECT")
            else:
                for ob in in_mode:
                    ob.select_set(True, view_layer=layer)
                bpy.ops.object.mode_set(mode=mode)
    finally:
        for ob in together:
            ob.select_set(ob in selected, view_layer=layer)
        armature.select_set(own, view_layer=layer)
