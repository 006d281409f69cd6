# SPDX-License-Identifier: GPL-3.0-or-later
"""Which vertex groups and vertices of a target an operator may write to."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import bpy
import numpy as np

from ..core.errors import InputError
from .selected_vertices import selected_vertices
from .vertex_groups import GroupWeights

Subset = Literal["ALL", "DEFORM", "SELECTED", "UNLOCKED"]


@dataclass(frozen=True)
class Scope:
    """What the user chose to be written; locked groups never are.

    Vertices of the protected group keep their weights. A treatment of loose parts is for those with selected
    vertices alone where `parts_of_selection`.
    """

    subset: Subset = "DEFORM"
    only_selected_vertices: bool = False
    protected_group: str = ""
    parts_of_selection: bool = False

    def bones(
        self, ob: bpy.types.Object, armature: bpy.types.Object, groups: GroupWeights, names: tuple[str, ...]
    ) -> np.ndarray | None:
        """Which of the bones (B,) are chosen, None for all; InputError where that is none."""
        if self.subset == "UNLOCKED":
            unlocked = {name for name, locked in zip(groups.names, groups.locked, strict=True) if not locked}
            chosen = np.array([name in unlocked for name in names], np.bool_)
            if not chosen.any():
                raise InputError(f"'{ob.name}' has no unlocked group of a deforming bone of '{armature.name}'.")
            return chosen
        if self.subset == "SELECTED":
            selected = selected_bones(armature)
            chosen = np.array([name in selected for name in names], np.bool_)
            if not chosen.any():
                raise InputError(f"No deforming bone of '{armature.name}' is selected: select some in Pose Mode.")
            return chosen
        return None

    def check(self, objects: Sequence[bpy.types.Object]) -> None:
        """Raise InputError when none of the objects has the protected group."""
        if self.protected_group and not any(self.protected_group in ob.vertex_groups for ob in objects):
            raise InputError(f"There is no vertex group '{self.protected_group}' of vertices to protect.")

    def vertices(self, ob: bpy.types.Object, groups: GroupWeights) -> np.ndarray | None:
        """Which vertices (V,) are chosen, None for all."""
        if not self.only_selected_vertices and not self.protected_group:
            return None
        chosen = _selected(ob) if self.only_selected_vertices else np.ones(len(ob.data.vertices), np.bool_)
        protected = groups.column(self.protected_group) > 0
        if chosen.any() and not (chosen & ~protected).any():
            raise InputError(f"All vertices of '{ob.name}' to write to are in the group '{self.protected_group}'.")
        return chosen & ~protected

    def part_vertices(self, ob: bpy.types.Object) -> np.ndarray | None:
        """The vertices (V,) whose loose parts are meant, None for all."""
        return _selected(ob) if self.parts_of_selection else None

    def boneless_groups(
        self, source_groups: tuple[str, ...], target: GroupWeights, bone_names: tuple[str, ...]
    ) -> tuple[str, ...]:
        """The source's groups without a bone that go to the target too."""
        if self.subset not in ("ALL", "UNLOCKED"):
            return ()
        state = dict(zip(target.names, target.locked, strict=True))
        missing_is_locked = self.subset == "UNLOCKED"
        return tuple(
            name for name in source_groups if name not in bone_names and not state.get(name, missing_is_locked)
        )


def _selected(ob: bpy.types.Object) -> np.ndarray:
    selected = np.zeros(len(ob.data.vertices), np.bool_)
    selected[selected_vertices(ob)] = True
    return selected


def selected_bones(armature: bpy.types.Object) -> set[str]:
    """Names of the selected bones; where none is selected, of the active one."""
    active = armature.data.bones.active
    return marked_bones(armature) or ({active.name} if active is not None else set())


def marked_bones(armature: bpy.types.Object) -> set[str]:
    """Names of the bones that are selected, outside Edit Mode."""
    # Blender 5.0 keeps the selection on the bones of the pose.
    bones = armature.pose.bones if "select" in bpy.types.PoseBone.bl_rna.properties else armature.data.bones
    return {bone.name for bone in bones if bone.select}
