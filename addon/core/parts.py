# SPDX-License-Identifier: GPL-3.0-or-later
"""Loose parts of a mesh: what the user wants to become of them, and what became of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from dermis_native import RetargetResult, TriangleMesh

from .character import Flags, Target
from .errors import InputError, counted

Policy = TypeVar("Policy", bound=str)

# How each treatment is told of: for one part and for several.
TOLD = {
    "rigid": ("rigid part", "rigid parts"),
    "surface": ("part on the surface", "parts on the surface"),
    "match": ("matched part", "matched parts"),
}


def parts_argument(mesh: TriangleMesh, policy: Policy, auto: Policy, chosen: Flags | None) -> Policy | list[Policy]:
    """`parts` of a native call: one treatment for all loose parts, or, with `chosen` vertices (V,), for the
    components that these belong to and `auto` for the others.
    """
    if policy == auto or chosen is None:
        return policy
    components: npt.NDArray[np.uint32] = mesh.components
    is_chosen = np.zeros(int(components.max()) + 1, np.bool_)
    is_chosen[components[chosen]] = True
    return [policy if each else auto for each in is_chosen.tolist()]


def check_part_vertices(policy: str, targets: Iterable[Target]) -> None:
    """Raise InputError when a treatment is for the parts with selected vertices, and there are none."""
    chosen = [target.part_vertices for target in targets]
    if policy != "auto" and chosen and all(each is not None and not each.any() for each in chosen):
        raise InputError("No part has a selected vertex: select a vertex of each loose part that is meant.")


def treatments(found: RetargetResult) -> Counter[str]:
    """How many loose parts, the body left out, were treated in which way."""
    policies = enumerate(found.part_policies)
    return Counter(policy for part, policy in policies if part != found.body)


def told(counts: Mapping[str, int]) -> list[str]:
    """The counts in words, empty without loose parts."""
    return [counted(counts[policy], *words) for policy, words in TOLD.items() if counts.get(policy)]
