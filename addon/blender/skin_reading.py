# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads what a skin is made of from the scene."""

import hashlib
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..core.character import Bones, Surface
from ..core.errors import InputError, counted
from ..core.skin_input import SkinInput
from ..core.skin_settings import SkinSettings
from .bone_layout import BoneLayout, read_layout, read_weights
from .mesh import read_polygons, rest_positions
from .placement import Placement
from .shape_mix import key_groups
from .vertex_groups import GroupWeights, read_groups


@dataclass(frozen=True)
class SkinReading:
    """A mesh and its armature at rest, each in its own space.

    shares (V,) is the Armature modifier's mask, None without one; key_groups holds the weights
    (V,) of the groups that limit other shape keys.
    """

    raw: SkinInput
    layout: BoneLayout
    shares: np.ndarray | None
    key_groups: dict[str, np.ndarray]
    geometry_key: str

    def placed(self, placement: Placement) -> SkinInput:
        """The input of the solver."""
        raw = self.raw
        return replace(
            raw,
            surface=placement.surface(raw.surface),
            bones=placement.bones(raw.bones),
            bone_rest=None if raw.bone_rest is None else placement.armature @ raw.bone_rest,
        )

    def skin_key(self, placement: Placement) -> str:
        """Key of the skin: equal keys mean equal skins."""
        digest = hashlib.blake2b(self.geometry_key.encode(), digest_size=16)
        digest.update(placement.object.tobytes() + placement.armature.tobytes())
        digest.update(repr((self.raw.skinning, self.raw.settings)).encode())
        if self.raw.stiffness_shares is not None:
            digest.update(self.raw.stiffness_shares.tobytes())
        if self.raw.bone_rest is not None:
            digest.update(self.raw.bone_rest.tobytes())
        return digest.hexdigest()


def read_skin(
    ob: bpy.types.Object,
    modifier: bpy.types.ArmatureModifier,
    settings: SkinSettings,
    depsgraph: bpy.types.Depsgraph,
    place: Placement,
) -> SkinReading:
    """Everything at rest; InputError when there is nothing to bend."""
    armature = modifier.object
    evaluated = armature.evaluated_get(depsgraph)
    if not ob.vertex_groups:
        raise InputError(f"'{ob.name}' has no vertex groups, so no bone has weight on it.")
    positions = rest_positions(ob.data)
    counts, corners = read_polygons(ob.data)
    layout = read_layout(armature, evaluated)
    groups = read_groups(ob)
    to_armature = place.object_to_armature
    with np.errstate(invalid="ignore"):
        in_armature = positions @ to_armature[:3, :3].T + to_armature[:3, 3]
    raw = SkinInput(
        name=ob.name,
        armature=armature.name,
        surface=Surface(positions, counts, corners),
        bones=Bones(layout.bones.names, layout.bones.heads, layout.bones.tails, layout.bones.parents),
        weights=read_weights(ob, armature, evaluated, layout, groups, in_armature),
        skinning="dual_quaternion" if modifier.use_deform_preserve_volume else "linear",
        settings=settings,
        stiffness_shares=_stiffness_shares(ob, groups),
        bone_rest=layout.rest if modifier.use_deform_preserve_volume else None,
    )
    raw.check()
    shares = None
    if modifier.vertex_group:
        shares = groups.column(modifier.vertex_group)
        if modifier.invert_vertex_group:
            shares = np.float32(1.0) - shares
    return SkinReading(
        raw, layout, shares, {name: groups.column(name) for name in key_groups(ob.data)}, raw.geometry_key()
    )


def _stiffness_shares(ob: bpy.types.Object, groups: GroupWeights) -> np.ndarray | None:
    name = ob.dermis_skin.stiffness_group
    if not name:
        return None
    if name not in groups.names:
        raise InputError(f"'{ob.name}' has no vertex group '{name}', which the stiffness of its skin asks for.")
    return np.clip(groups.column(name), 0.0, 1.0)


def read_settings(ob: bpy.types.Object) -> SkinSettings:
    """The settings that the object keeps."""
    kept = ob.dermis_skin
    return SkinSettings(
        preset=kept.preset.lower(),
        iterations=kept.iterations,
        start=kept.start.lower(),
        stretch=kept.stretch,
        volume=kept.volume,
        bind=kept.bind,
        energy=kept.energy,
        stiffness=kept.stiffness,
        self_collision=kept.self_collision,
        smoothing=kept.smoothing,
        cell_size=kept.cell_size or None,
    )


def shape_digest(mesh: bpy.types.Mesh) -> bytes:
    """Hash of the rest shape, cheap enough to be asked after every change of a shape key."""
    digest = hashlib.blake2b(rest_positions(mesh).tobytes(), digest_size=16)
    digest.update(f"{len(mesh.polygons)} {len(mesh.loops)}".encode())
    return digest.digest()


def skin_lines(stats: dict, limited: int, milliseconds: float) -> list[str]:
    """What the last frame took and what the skin consists of, line by line."""
    size = counted(stats["tetrahedra"], "tetrahedron", "tetrahedra")
    lines = [f"{milliseconds:.1f} ms per frame", f"{size}, {counted(sum(stats['constraints'].values()), 'constraint')}"]
    if limited:
        lines.append(f"{counted(limited, 'vertex', 'vertices')} limited")
    if stats["inverted"]:
        lines.append(f"{counted(stats['inverted'], 'tetrahedron', 'tetrahedra')} inverted")
    return lines
