# SPDX-License-Identifier: GPL-3.0-or-later
"""Which target bones stand for each source bone: found, or as the user's list says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from dermis_native import BoneMap, DermisError, Skeleton, map_bones

from .character import BonePair, Bones, Floats, Source, Target
from .errors import InputError, listed

# How a pair was found, with what is said of it, in the order of the report.
HOW = {
    "name": "by name",
    "scheme": "by naming scheme",
    "structure": "by structure",
    "user": "by hand",
}


@dataclass(frozen=True)
class BoneMapping:
    """Bones of two armatures: `native.targets` indexes `target` for each bone of `source`, `how` tells how each
    of these was found.
    """

    native: BoneMap
    source: tuple[str, ...]
    target: tuple[str, ...]
    how: tuple[str, ...]

    @property
    def mapped(self) -> tuple[int, ...]:
        """Target bones that stand for some source bone, in the target's order."""
        return tuple(sorted({bone for bones in self.native.targets for bone in bones}))

    @property
    def only_in_target(self) -> tuple[str, ...]:
        """Target bones that stand for none."""
        mapped = set(self.mapped)
        return tuple(name for bone, name in enumerate(self.target) if bone not in mapped)

    def counts(self) -> dict[str, int]:
        """How many source bones were mapped in which way, without ways that were not used."""
        return {way: self.how.count(way) for way in HOW if way in self.how}

    def heirs(self) -> tuple[tuple[str, str], ...]:
        """Source bones without a counterpart, each with the source bone that takes its weight along."""
        carriers = self.native.carriers
        return tuple(
            (self.source[bone], self.source[carriers[bone]])
            for bone, targets in enumerate(self.native.targets)
            if not targets
        )

    def rows(self) -> list[BonePair]:
        """One row for each target bone of each source bone, one with none where there is none."""
        rows = []
        for name, targets, how in zip(self.source, self.native.targets, self.how, strict=True):
            rows += [BonePair(name, self.target[bone], how) for bone in targets] or [BonePair(name, "", how)]
        return rows


def map_characters(source: Source, target: Target) -> BoneMapping:
    """The target's own list of bones if it has one, else what is found.

    Raises InputError that names the bones at fault.
    """
    if target.bone_map is not None:
        return listed_bones(source.armature, source.bones, target.armature, target.bones, target.bone_map)
    return found_bones(source.armature, source.bones, target.armature, target.bones)


def found_bones(source_name: str, source: Bones, target_name: str, target: Bones) -> BoneMapping:
    """Map bones by name, by naming scheme, and the rest by structure; InputError when nothing is in common."""
    try:
        found = map_bones(native_skeleton(source), native_skeleton(target))
    except DermisError as error:
        raise InputError(
            f"No bone of '{source_name}' has a counterpart in '{target_name}'. '{source_name}' has "
            f"{listed(source.names)}; '{target_name}' has {listed(target.names)}. Map the bones by hand."
        ) from error
    return BoneMapping(found, source.names, target.names, tuple(found.how))


def listed_bones(
    source_name: str, source: Bones, target_name: str, target: Bones, rows: Sequence[BonePair]
) -> BoneMapping:
    """The map of a list; a source bone may have several rows, or an empty target.

    The rows of one source bone may be in any order. Raises InputError that names the bone at fault.
    """
    place = {name: bone for bone, name in enumerate(source.names)}
    target_place = {name: bone for bone, name in enumerate(target.names)}
    depth = _depths(target)
    targets: list[list[int]] = [[] for _ in source.names]
    for bone, counterpart, _ in rows:
        if not counterpart:
            continue
        for name, names, armature in ((bone, place, source_name), (counterpart, target_place, target_name)):
            if name not in names:
                raise InputError(
                    f"The bone list pairs '{bone}' with '{counterpart}', "
                    f"but '{armature}' has no deforming bone '{name}'."
                )
        targets[place[bone]].append(target_place[counterpart])
    for chain in targets:
        chain.sort(key=depth.__getitem__)
    try:
        native = BoneMap(native_skeleton(source), native_skeleton(target), targets)
    except (DermisError, ValueError) as error:
        raise InputError(f"The bone list from '{source_name}' to '{target_name}' cannot be used: {error}.") from error
    found = {pair.source: pair.how for pair in rows if pair.target}
    found |= {pair.source: pair.how for pair in rows if pair.target and pair.how == "user"}
    how = tuple(found.get(name, "none") for name in source.names)
    return BoneMapping(native, source.names, target.names, how)


def native_skeleton(bones: Bones) -> Skeleton:
    """The bones for the native module."""
    return Skeleton(bones.heads, bones.tails, bones.parents, list(bones.names))


def distances_to_bones(points: Floats, bones: Bones) -> Floats:
    """Distance of each point (n,3) to each bone's segment: (n,B)."""
    axes = bones.tails - bones.heads
    squared = np.einsum("bk,bk->b", axes, axes)
    offsets = points[:, None, :] - bones.heads[None]
    along = np.einsum("nbk,bk->nb", offsets, axes) / np.where(squared > 0, squared, 1.0)
    closest = np.clip(along, 0.0, 1.0)[..., None] * axes[None]
    distances: Floats = np.linalg.norm(offsets - closest, axis=2)
    return distances


def _depths(bones: Bones) -> list[int]:
    """Number of ancestors of each bone."""
    depths = []
    for bone in range(len(bones)):
        depth, ancestor = 0, int(bones.parents[bone])
        while ancestor >= 0:
            depth, ancestor = depth + 1, int(bones.parents[ancestor])
        depths.append(depth)
    return depths
