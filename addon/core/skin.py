# SPDX-License-Identifier: GPL-3.0-or-later
"""The PBD skin of one mesh: built once, then from poses to offsets of a shape key."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dermis_native import (
    DermisError,
    PbdSkin,
    Skeleton,
    SkinWeights,
    TriangleMesh,
    dual_quaternion_skinning,
    linear_blend_skinning,
)

from .character import Floats, Weights
from .errors import InputError
from .skin_input import SkinInput

# Skins that no object shows at the moment and that are kept for undo and for changes of mind.
SPARE_SKINS = 4


@dataclass(frozen=True)
class Correction:
    """What a pose needs.

    offsets (V,3) in solver space, to be added to the vertices before they are skinned; limited
    counts the vertices whose matrix is near singular; stats are those of `PbdSkin`.
    """

    offsets: Weights
    limited: int
    stats: dict[str, Any]


class Skin:
    """A solver and what is needed to take its result back before the Armature modifier."""

    def __init__(self, source: SkinInput) -> None:
        """Build; InputError when that is impossible."""
        source.check()
        self._source = source
        self._skinning = source.skinning
        surface = source.surface
        self._rest = surface.vertices.astype(np.float32)
        self._bone_rest = source.bone_rest
        try:
            mesh = TriangleMesh.from_polygons(surface.vertices, surface.loop_counts, surface.loop_indices)
            bones = source.bones
            skeleton = Skeleton(bones.heads, bones.tails, bones.parents, list(bones.names))
            self._weights = SkinWeights.from_triplets(
                source.weights.vertex, source.weights.bone, source.weights.value, len(self._rest), len(bones)
            )
            self._solver = PbdSkin(
                mesh,
                skeleton,
                self._weights,
                skinning=source.skinning,
                stiffness_shares=source.stiffness_shares,
                rest=source.bone_rest,
                **source.settings.native_arguments(),
            )
        except (DermisError, ValueError) as error:
            raise InputError(f"'{source.name}' cannot have a PBD skin: {_plain(error)}.") from error

    def __reduce__(self) -> tuple[type[Skin], tuple[SkinInput]]:
        """Elsewhere it is built again from its input: the solver is not data."""
        return Skin, (self._source,)

    @property
    def stats(self) -> dict[str, Any]:
        """Counts and times of the solver."""
        return self._solver.stats

    def solved(self, transforms: Floats, vertices: Floats | None = None) -> Weights:
        """Skin (V,3) of a pose in solver space; see `correction`."""
        try:
            return self._solver.solve(transforms, vertices)
        except (DermisError, ValueError) as error:
            raise InputError(f"The pose cannot be solved: {_plain(error)}.") from error

    def plain(self, transforms: Floats, vertices: Floats | None = None) -> Weights:
        """What the Armature modifier makes of the vertices (V,3)."""
        places = self._rest if vertices is None else vertices
        if self._skinning == "linear":
            return linear_blend_skinning(places, self._weights, transforms)
        return dual_quaternion_skinning(places, self._weights, transforms, rest=self._bone_rest)

    def correction(
        self, transforms: Floats, vertices: Floats | None = None, shares: npt.NDArray[np.float32] | None = None
    ) -> Correction:
        """Offsets that the Armature modifier turns into the solved skin.

        transforms (B,4,4) are pose · rest⁻¹ of the input's bones; vertices (V,3) stand in for the
        rest positions where other shape keys act; shares (V,) are the modifier's vertex-group mask.
        """
        try:
            offsets, limited = self._solver.solve_offsets(transforms, vertices, shares)
        except (DermisError, ValueError) as error:
            raise InputError(f"The pose cannot be solved: {_plain(error)}.") from error
        return Correction(offsets, limited, self._solver.stats)


class SkinStore:
    """Skins by the key of their input.

    A skin is a pure function of its input, so it outlives undo, renaming, duplication and the
    objects that showed it.
    """

    def __init__(self, spare: int = SPARE_SKINS) -> None:
        self._skins: OrderedDict[str, Skin] = OrderedDict()
        self._spare = spare

    def __len__(self) -> int:
        return len(self._skins)

    def get(self, key: str, source: SkinInput, in_use: set[str]) -> Skin:
        """The skin of an input, built when it is new; `in_use` are the keys that must stay."""
        skin = self._skins.get(key)
        if skin is None:
            skin = Skin(source)
            self._skins[key] = skin
        self._skins.move_to_end(key)
        spare = [old for old in self._skins if old != key and old not in in_use]
        for old in spare[: max(len(spare) - self._spare, 0)]:
            del self._skins[old]
        return skin

    def clear(self) -> None:
        """Forget all."""
        self._skins.clear()


def _plain(error: Exception) -> str:
    return str(error).strip().rstrip(".")
