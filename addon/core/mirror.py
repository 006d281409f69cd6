# SPDX-License-Identifier: GPL-3.0-or-later
"""The source mirrored by its left and right bones, and both halves of a target from one of its sides."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from .character import Bones, BoneWeights, Floats, Source, Target
from .errors import InputError, listed
from .sides import mirror_partners, symmetry_plane

Mirror = Literal["none", "flip", "left", "right"]

# Half the width of the band in which the two halves blend, as a share of the target's largest extent.
BLEND_BAND = 0.01


def mirrored_source(source: Source) -> Source:
    """The source seen in a mirror: what followed a left bone follows the right one and the other way round.

    Raises InputError when no bones are named left and right, or one with weight has no counterpart.
    """
    bones = source.bones
    plane = symmetry_plane(bones)
    if plane is None:
        raise InputError(
            f"'{source.armature}' has no bones that are named left and right, such as 'hand.L' and 'hand.R': "
            "there is nothing to mirror by."
        )
    partners = mirror_partners(bones.names)
    weighted = np.unique(source.weights.bone[source.weights.value > 0])
    alone = [bones.names[i] for i in weighted if partners[i] < 0]
    if alone:
        raise InputError(f"Bones of '{source.armature}' have no counterpart on the other side: {listed(alone)}.")
    own = np.arange(len(bones), dtype=np.int32)
    partners = np.where(partners < 0, own, partners)
    heads, tails = plane.reflected(bones.heads)[partners], plane.reflected(bones.tails)[partners]
    above = bones.parents[partners]
    parents = np.where(above < 0, -1, partners[above]).astype(np.int32)
    surface = replace(source.surface, vertices=plane.reflected(source.surface.vertices)).flipped()
    weights = replace(source.weights, bone=partners[source.weights.bone].astype(np.int32))
    other = mirror_partners(source.boneless_groups)
    other = np.where(other < 0, np.arange(len(other)), other).astype(np.int32)
    boneless = replace(source.boneless, bone=other[source.boneless.bone])
    mirrored = Bones(bones.names, heads, tails, parents)
    return replace(source, surface=surface, bones=mirrored, weights=weights, boneless=boneless)


def left_shares(target: Target) -> Floats:
    """How much of each vertex (V,) belongs to the left half: 1 on the left, 0 on the right, a ramp between."""
    plane = symmetry_plane(target.bones)
    if plane is None:
        raise InputError(f"'{target.armature}' of '{target.name}' has no bones that are named left and right.")
    vertices = target.surface.vertices
    band = BLEND_BAND * float(np.ptp(vertices, axis=0).max())
    shares: Floats = np.clip(0.5 + plane.heights(vertices) / (2.0 * band), 0.0, 1.0)
    return shares


def blended(first: BoneWeights, second: BoneWeights, share: Floats) -> BoneWeights:
    """Weights (share) · first + (1 - share) · second, share (V,); bones may repeat in a vertex."""
    parts = []
    for weights, factor in ((first, share), (second, 1.0 - share)):
        value = (weights.value * factor[weights.vertex]).astype(np.float32)
        parts.append(replace(weights, value=value).where(value > 0))
    vertex = np.concatenate([part.vertex for part in parts])
    bone = np.concatenate([part.bone for part in parts])
    value = np.concatenate([part.value for part in parts])
    return BoneWeights(vertex, bone, value).summed()
