# SPDX-License-Identifier: GPL-3.0-or-later
"""A skin opened for baking: its poses frame by frame, without its shape key.

So an object whose mesh is linked or overridden, which cannot keep a key, can be baked too.
"""

import bpy
import numpy as np

from ..core.errors import InputError
from ..core.pose import affine_inverse, conjugated
from ..core.skin import Skin
from ..core.skin_frames import PoseSample, SkinFrames
from ..core.skin_input import check_finite_pose
from . import placement
from .mesh import rest_positions
from .shape_mix import acting_keys, key_offsets
from .skin_checks import check_shape_keys, skin_modifier
from .skin_key import find_key
from .skin_reading import SkinReading, read_settings, read_skin
from .skin_state import is_live, registry
from .vertex_groups import read_groups


def keeps_no_key(ob: bpy.types.Object) -> bool:
    """Whether the object's mesh could not keep a live skin's shape key: linked, overridden or shared."""
    data = ob.data
    return (
        data.library is not None
        or ob.override_library is not None
        or data.override_library is not None
        or data.users - data.use_fake_user > 1
    )


class BakeSource:
    """Reads and checks the object in the constructor and changes nothing."""

    def __init__(self, ob: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> None:
        if ob.mode == "EDIT":
            raise InputError(f"'{ob.name}' is in Edit Mode: leave it first.")
        if ob.dermis_skin.baked:
            raise InputError(f"'{ob.name}' is baked already: use Back to Live first.")
        check_shape_keys(ob)
        self.ob = ob
        self.name = ob.name
        self.is_live = is_live(ob) and find_key(ob) is not None and not keeps_no_key(ob)
        self.modifier = skin_modifier(ob)
        self.armature = self.modifier.object
        if not ob.evaluated_get(depsgraph).is_evaluated:
            raise InputError(f"'{ob.name}' is not evaluated in this view layer: show it first.")
        self.place, self.reading = self._bound(depsgraph)
        self.skin: Skin = registry.skin(self.reading, self.reading.skin_key(self.place), self.place)
        self.samples: list[PoseSample] = []
        self._placed: placement.PlacedArmature | None = None

    def _bound(self, depsgraph: bpy.types.Depsgraph) -> tuple[placement.Placement, SkinReading]:
        settings = read_settings(self.ob)
        if self.ob.dermis_skin.geometry_key:
            place = placement.stored(self.ob)
            reading = read_skin(self.ob, self.modifier, settings, depsgraph, place)
            if reading.geometry_key == self.ob.dermis_skin.geometry_key:
                return place, reading
        place = placement.place(self.ob.evaluated_get(depsgraph), self.armature.evaluated_get(depsgraph))
        return place, read_skin(self.ob, self.modifier, settings, depsgraph, place)

    def read(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Add the pose of an evaluated scene to the samples."""
        evaluated, armature = self.ob.evaluated_get(depsgraph), self.armature.evaluated_get(depsgraph)
        deltas = self.reading.layout.deltas(armature)
        if deltas is None:
            raise InputError(f"The bones of '{self.armature.name}' changed while its meshes were being baked.")
        check_finite_pose(self.armature.name, self.reading.layout.bones, deltas)
        self._placed = placement.placed_armature(self.place, evaluated, armature, self._placed)
        values, own = acting_keys(self.ob, depsgraph)
        self.samples.append(
            PoseSample(
                transforms=conjugated(deltas, self._placed.matrix).astype(np.float32),
                values=values,
                influence=own if self.is_live and own is not None else 1.0,
                deformed=_is_shown(evaluated.modifiers[self.modifier.name]),
            )
        )

    def frames(self) -> SkinFrames:
        """The skin with what the samples need."""
        linear = self.place.object[:3, :3]
        turned = not np.array_equal(linear, np.eye(3))
        used = {name for sample in self.samples for name in sample.values}
        key = find_key(self.ob)
        group = key.vertex_group if self.is_live else self.ob.dermis_skin.mask_group
        return SkinFrames(
            name=self.name,
            skin=self.skin,
            rest=rest_positions(self.ob.data),
            to_solver=linear if turned else None,
            to_object=affine_inverse(self.place.object)[:3, :3] if turned else None,
            shape_keys=key_offsets(self.ob, used, self.reading.key_groups),
            shares=self.reading.shares,
            mask=read_groups(self.ob).column(group) if group else None,
        )


def _is_shown(modifier: bpy.types.Modifier) -> bool:
    return modifier.show_viewport or modifier.show_render
