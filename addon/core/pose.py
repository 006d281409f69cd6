# SPDX-License-Identifier: GPL-3.0-or-later
"""Transforms of the bones in the space of the solver."""

from __future__ import annotations

import numpy as np

from .character import Floats

# Relative change of a placement that is only rounding of single-precision matrices.
STILL = 4e-6


def affine_inverse(matrix: Floats) -> Floats:
    """Inverse of an affine matrix (4,4); ZeroDivisionError where it flattens space.

    In plain numbers: for one small matrix numpy's calls, let alone LAPACK's threads, take far longer.
    """
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = matrix[:3].tolist()
    ca, cb, cc = e * i - f * h, f * g - d * i, d * h - e * g
    scale = 1.0 / (a * ca + b * cb + c * cc)
    rows = (
        (ca * scale, (c * h - b * i) * scale, (b * f - c * e) * scale),
        (cb * scale, (a * i - c * g) * scale, (c * d - a * f) * scale),
        (cc * scale, (b * g - a * h) * scale, (a * e - b * d) * scale),
    )
    return np.array([(p, q, r, -(p * x + q * y + r * z)) for p, q, r in rows] + [(0.0, 0.0, 0.0, 1.0)])


def conjugated(deltas: Floats, to_solver: Floats) -> Floats:
    """Transforms (B,4,4) in solver space of `deltas` (B,4,4) = pose · rest⁻¹ in armature space.

    `to_solver` (4,4) takes armature space there. Written on the difference from the identity, so
    that a bone at rest gives the exact identity.
    """
    identity = np.eye(4)
    if np.array_equal(to_solver, identity):
        return deltas
    transforms: Floats = identity + to_solver @ (deltas - identity) @ affine_inverse(to_solver)
    return transforms


def settled(current: Floats, bound: Floats) -> Floats:
    """`bound` where `current` (4,4) differs from it by rounding only, so that a moving character does not tremble."""
    size = np.abs(bound[:3, :3]).max() + np.abs(bound[:3, 3]).max()
    return bound if np.abs(current - bound).max() <= STILL * size else current
