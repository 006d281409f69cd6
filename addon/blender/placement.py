# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the solver's space lies: the world's axes and unit, with the object's origin in its centre.

It is chosen when a skin is bound and kept in the file, so that every process, at whatever frame it
starts, solves in the same space and gets the same bits.
"""

from dataclasses import dataclass
from functools import cached_property

import bpy
import numpy as np

from ..core.character import Bones, Surface
from ..core.pose import affine_inverse, settled
from .transform import world_matrix


@dataclass(frozen=True)
class Placement:
    """object and armature (4,4) take the spaces of the mesh and of its armature to the solver's."""

    object: np.ndarray
    armature: np.ndarray

    @property
    def object_to_armature(self) -> np.ndarray:
        """Matrix (4,4) from the object's space to the armature's when the skin was bound."""
        return affine_inverse(self.armature) @ self.object

    def surface(self, surface: Surface) -> Surface:
        """A surface of the object's space in the solver's, turned right side out where that mirrors."""
        linear = self.object[:3, :3]
        with np.errstate(invalid="ignore"):
            vertices = surface.vertices.astype(np.float64) @ linear.T
        placed = Surface(vertices, surface.loop_counts, surface.loop_indices)
        return placed.flipped() if np.linalg.det(linear) < 0 else placed

    def bones(self, bones: Bones) -> Bones:
        """Bones of the armature's space in the solver's."""
        linear, origin = self.armature[:3, :3], self.armature[:3, 3]
        return Bones(bones.names, bones.heads @ linear.T + origin, bones.tails @ linear.T + origin, bones.parents)

    def in_object(self, offsets: np.ndarray) -> np.ndarray:
        """Offsets (V,3) float32 of the solver's space in the object's."""
        return offsets if self._to_object is None else offsets @ self._to_object

    @cached_property
    def _to_object(self) -> np.ndarray | None:
        """Matrix (3,3) float32 for rows of offsets, None where the two spaces have the same axes."""
        if np.array_equal(self.object[:3, :3], np.eye(3)):
            return None
        return np.ascontiguousarray(affine_inverse(self.object)[:3, :3].T, np.float32)


@dataclass(frozen=True)
class PlacedArmature:
    """Matrix (4,4) from an armature's space to the solver's, for world matrices of both objects, row by row."""

    worlds: tuple[float, ...]
    matrix: np.ndarray


def placed_armature(
    place: Placement, ob: bpy.types.Object, armature: bpy.types.Object, last: PlacedArmature | None
) -> PlacedArmature:
    """Where an armature lies in the solver's space as it stands to its object in an evaluated scene.

    `last` is given back where neither has moved. InputError where one is flattened or not finite.
    """
    # As plain numbers: making an array of them takes several times as long as all else here.
    worlds = tuple(x for owner in (armature, ob) for row in owner.matrix_world for x in row)
    if last is not None and worlds == last.worlds:
        return last
    to_armature = _object_to_armature(ob, armature, np.reshape(worlds, (2, 4, 4)))
    return PlacedArmature(worlds, settled(place.object @ affine_inverse(to_armature), place.armature))


def _object_to_armature(ob: bpy.types.Object, armature: bpy.types.Object, worlds: np.ndarray) -> np.ndarray:
    """Matrix (4,4) from the object's space to the armature's; InputError as above."""
    try:
        matrix = affine_inverse(worlds[0]) @ worlds[1]
        affine_inverse(matrix)
    except ZeroDivisionError:
        matrix = np.full((4, 4), np.nan)
    if not np.isfinite(matrix).all():
        # These name the object and what is wrong with it.
        world_matrix(ob), world_matrix(armature)
    return matrix


def place(ob: bpy.types.Object, armature: bpy.types.Object) -> Placement:
    """The placement of an object and its armature as they stand now in an evaluated scene."""
    linear = np.eye(4)
    linear[:3, :3] = world_matrix(ob)[:3, :3]
    worlds = np.array((armature.matrix_world, ob.matrix_world))
    armature_matrix = linear @ affine_inverse(_object_to_armature(ob, armature, worlds))
    # In the precision that a file keeps, so that it is the same before and after saving.
    return Placement(*(m.astype(np.float32).astype(np.float64) for m in (linear, armature_matrix)))


def store(ob: bpy.types.Object, placement: Placement, geometry_key: str) -> None:
    """Keep the placement, and the geometry it was chosen for, on the object."""
    kept = ob.dermis_skin
    kept.object_matrix = placement.object.ravel()
    kept.armature_matrix = placement.armature.ravel()
    kept.geometry_key = geometry_key


def stored(ob: bpy.types.Object) -> Placement:
    """The placement that `store` kept."""
    kept = ob.dermis_skin
    return Placement(*(np.array(m, np.float64).reshape(4, 4) for m in (kept.object_matrix, kept.armature_matrix)))
