# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that a skin is made of, as arrays, and the key under which it is kept."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .character import Bones, BoneWeights, Floats, Surface, Weights
from .errors import InputError, counted, listed
from .skin_settings import SkinSettings

Skinning = Literal["linear", "dual_quaternion"]


@dataclass(frozen=True)
class SkinInput:
    """A mesh, its bones and weights in solver space, and how to solve them.

    Columns of `weights` are `bones`, which may be segments of a bone; they need not total 1.
    stiffness_shares (V,) lets the stiffness vary over the surface, None makes it even. bone_rest
    (B,4,4) are the bones' rest matrices, which dual quaternions need where bones are scaled.
    """

    name: str
    armature: str
    surface: Surface
    bones: Bones
    weights: BoneWeights
    skinning: Skinning
    settings: SkinSettings
    stiffness_shares: Weights | None = None
    bone_rest: Floats | None = None

    def check(self) -> None:
        """Raise InputError when no skin can be made of it."""
        self.surface.check(self.name)
        self.bones.check(self.armature)
        bad = np.flatnonzero(~np.isfinite(self.weights.value) | (self.weights.value < 0))
        if len(bad):
            vertex, bone = self.weights.vertex[bad[0]], self.weights.bone[bad[0]]
            raise InputError(
                f"The weight of vertex {vertex} of '{self.name}' on '{self.bones.names[bone]}' is "
                f"{self.weights.value[bad[0]]}."
            )
        used = np.unique(self.weights.bone[self.weights.value > 0])
        if len(used) == 0:
            raise InputError(f"No vertex of '{self.name}' has weight on a deforming bone of '{self.armature}'.")
        if len(used) == 1:
            name = self.bones.names[used[0]]
            raise InputError(f"'{self.name}' follows the single bone '{name}': it has no joint that could bend.")

    def geometry_key(self) -> str:
        """Hash of what an edit of the mesh or of the armature's rest pose changes."""
        digest = hashlib.blake2b(digest_size=16)
        for array in (
            self.surface.vertices,
            self.surface.loop_counts,
            self.surface.loop_indices,
            self.bones.heads,
            self.bones.tails,
            self.bones.parents,
            self.weights.vertex,
            self.weights.bone,
            self.weights.value,
        ):
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update("\0".join(self.bones.names).encode())
        return digest.hexdigest()


def check_finite_pose(name: str, bones: Bones, transforms: Floats) -> None:
    """Raise InputError naming the bones whose transforms (B,4,4) are not finite."""
    finite = np.isfinite(transforms)
    if finite.all():
        return
    names = [bones.names[i] for i in np.flatnonzero(~finite.all(axis=(1, 2)))]
    verb = counted(len(names), "bone has", "bones have")
    raise InputError(f"{verb} a pose in '{name}' that is not finite: {listed(names)}.")
