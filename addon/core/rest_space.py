# SPDX-License-Identifier: GPL-3.0-or-later
"""Offsets before skinning where a mask lets vertices follow the skinning only in part."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .character import Floats, Weights

# Singular values below this share of the largest are limited, as in the native module.
SINGULAR = 1e-2


def shared_rest_space_offsets(
    offsets: Weights, matrices: Floats, shares: npt.NDArray[np.float32]
) -> tuple[Weights, int]:
    """Offsets (V,3) taken back by ((1 - share) I + share · matrix)⁻¹, and how many were limited.

    matrices (V,3,3) are what the skinning does to a small offset, shares (V,) the mask.
    """
    result = offsets.copy()
    moved = np.flatnonzero(offsets.any(axis=1))
    share = shares[moved, None, None].astype(np.float64)
    blended = (1.0 - share) * np.eye(3) + share * matrices[moved]
    u, singular, v = np.linalg.svd(blended)
    least = np.maximum(SINGULAR * singular[:, :1], np.finfo(np.float32).tiny)
    limited = int(np.count_nonzero(singular[:, 2] < least[:, 0]))
    turned = np.einsum("nji,nj->ni", u, offsets[moved])
    # sigma / s² below the limit s, 1 / sigma above it: continuous, and bounded where sigma is zero.
    turned *= singular / np.maximum(singular, least) ** 2
    result[moved] = np.einsum("nji,nj->ni", v, turned)
    return result, limited
