# SPDX-License-Identifier: GPL-3.0-or-later
"""All or nothing: what a failed write leaves behind is what was there before."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from .match_display import read_colors, restore_colors
from .vertex_groups import GroupWeights, read_groups, restore_groups


@dataclass(frozen=True)
class _State:
    """What retargeting may change on an object."""

    ob: bpy.types.Object
    groups: GroupWeights
    armatures: dict[str, bpy.types.Object | None]
    modifiers: tuple[str, ...]
    active_modifier: str | None
    parent: bpy.types.Object | None
    parent_type: str
    parent_bone: str
    parent_inverse: Matrix
    colors: np.ndarray | None
    active_color: str

    @classmethod
    def of(cls, ob: bpy.types.Object) -> "_State":
        active = ob.modifiers.active
        return cls(
            ob=ob,
            groups=read_groups(ob),
            armatures={modifier.name: modifier.object for modifier in ob.modifiers if modifier.type == "ARMATURE"},
            modifiers=tuple(modifier.name for modifier in ob.modifiers),
            active_modifier=None if active is None else active.name,
            parent=ob.parent,
            parent_type=ob.parent_type,
            parent_bone=ob.parent_bone,
            parent_inverse=ob.matrix_parent_inverse.copy(),
            colors=read_colors(ob.data),
            active_color=ob.data.color_attributes.active_color_name,
        )

    def restore(self) -> None:
        ob = self.ob
        for modifier in list(ob.modifiers):
            if modifier.name not in self.modifiers:
                ob.modifiers.remove(modifier)
        for name, armature in self.armatures.items():
            ob.modifiers[name].object = armature
        if self.active_modifier is not None:
            ob.modifiers.active = ob.modifiers[self.active_modifier]
        if ob.parent != self.parent:
            ob.parent = self.parent
            ob.parent_type = self.parent_type
            ob.parent_bone = self.parent_bone
        ob.matrix_parent_inverse = self.parent_inverse
        restore_groups(ob, self.groups)
        restore_colors(ob.data, self.colors, self.active_color)


@contextmanager
def restored_on_failure(objects: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Bring vertex groups, modifiers, parents and match colors of the objects back when the block raises."""
    with ExitStack() as undo:
        for ob in objects:
            undo.callback(_State.of(ob).restore)
        yield
        undo.pop_all()
