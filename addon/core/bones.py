# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs the bones of two armatures by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .character import Bones, Floats, Source, Target
from .errors import InputError, listed


@dataclass(frozen=True)
class BonePairs:
    """Bones that both characters have, in the target's order, and the target's other bones."""

    source: tuple[int, ...]
    target: tuple[int, ...]
    only_in_target: tuple[str, ...]


def pair_bones(source: Source, target: Target) -> BonePairs:
    """Pair bones by name.

    A bone of the source that carries weight and is missing in the target is an InputError that
    lists what each side has alone: its weight would be lost. Bones without weight may be missing.
    """
    source_index = {name: i for i, name in enumerate(source.bones.names)}
    target_names = set(target.bones.names)
    weighted = np.unique(source.weights.bone[source.weights.value > 0])
    lost = [source.bones.names[i] for i in weighted if source.bones.names[i] not in target_names]
    only_in_target = tuple(name for name in target.bones.names if name not in source_index)
    if lost:
        other = f"only '{target.armature}' has {listed(only_in_target)}" if only_in_target else "it has no others"
        raise InputError(
            f"The bones do not match: '{target.armature}' of '{target.name}' lacks {listed(lost)}, "
            f"which '{source.name}' uses; {other}. Rename or add bones so that both have the same names."
        )
    common = [i for i, name in enumerate(target.bones.names) if name in source_index]
    return BonePairs(
        source=tuple(source_index[target.bones.names[i]] for i in common),
        target=tuple(common),
        only_in_target=only_in_target,
    )


def distances_to_bones(points: Floats, bones: Bones) -> Floats:
    """Distance of each point (n,3) to each bone's segment: (n,B)."""
    axes = bones.tails - bones.heads
    squared = np.einsum("bk,bk->b", axes, axes)
    offsets = points[:, None, :] - bones.heads[None]
    along = np.einsum("nbk,bk->nb", offsets, axes) / np.where(squared > 0, squared, 1.0)
    closest = np.clip(along, 0.0, 1.0)[..., None] * axes[None]
    distances: Floats = np.linalg.norm(offsets - closest, axis=2)
    return distances
