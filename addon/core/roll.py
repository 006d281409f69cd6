# SPDX-License-Identifier: GPL-3.0-or-later
"""Carries the roll of bones over to new directions."""

from __future__ import annotations

import numpy as np

from .character import Flags, Floats

# Vectors whose cosine is this near to -1 are taken as opposite.
OPPOSITE = 1e-9


def turned_axes(axes: Floats, before: Floats, after: Floats) -> Floats:
    """Axes (n,3), each turned by the smallest rotation that takes `before` (n,3) to the direction `after` (n,3).

    Where both are opposite, the bone turns about the axis itself, which stays. An axis stays too
    where one of the directions has no length.
    """
    old, old_known = _directions(before)
    new, new_known = _directions(after)
    cosine = np.einsum("nk,nk->n", old, new)
    normal = np.cross(old, new)
    turns = old_known & new_known & (cosine > OPPOSITE - 1.0)
    # Rodrigues' formula with the sine in the normal's length.
    share = np.einsum("nk,nk->n", normal, axes) / np.where(turns, 1.0 + cosine, 1.0)
    turned = axes * cosine[:, None] + np.cross(normal, axes) + normal * share[:, None]
    result: Floats = np.where(turns[:, None], turned, axes)
    return result


def _directions(vectors: Floats) -> tuple[Floats, Flags]:
    lengths = np.linalg.norm(vectors, axis=1)
    known = lengths > 0
    return vectors / np.where(known, lengths, 1.0)[:, None], known
