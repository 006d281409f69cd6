# SPDX-License-Identifier: GPL-3.0-or-later
"""World space from object space."""

import bpy
import numpy as np

from ..core.errors import InputError


def world_matrix(ob: bpy.types.Object) -> np.ndarray:
    """The object's matrix (4,4) in double precision; InputError where it flattens space."""
    matrix = np.array(ob.matrix_world, np.float64)
    linear = matrix[:3, :3]
    if not np.isfinite(matrix).all():
        raise InputError(f"The transform of '{ob.name}' is not finite.")
    lengths = np.linalg.norm(linear, axis=0)
    if not lengths.all() or abs(np.linalg.det(linear / lengths)) < 1e-9:
        raise InputError(f"'{ob.name}' is scaled to zero along some axis.")
    return matrix


def to_world(ob: bpy.types.Object, points: np.ndarray) -> np.ndarray:
    """Points (n,3) of the object's space in world space, double precision.

    Points that are not finite stay so; what uses them names them.
    """
    matrix = world_matrix(ob)
    with np.errstate(invalid="ignore"):
        return points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def is_mirrored(ob: bpy.types.Object) -> bool:
    """Whether the object's transform turns surfaces inside out."""
    return bool(np.linalg.det(world_matrix(ob)[:3, :3]) < 0)
