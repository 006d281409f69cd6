# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrections of chosen poses as shape keys: read, solve, write."""

from collections.abc import Sequence

import bpy

from ..core.errors import InputError, counted, listed
from ..core.frame_range import FrameList
from ..core.offsets_task import OffsetsTask
from .bake_source import BakeSource
from .bake_state import switch_off
from .frame_walk import FrameWalk
from .offset_keys import add_offset_key
from .sampled_task import SampledTask
from .skin_checks import check_owner


class ShapeKeyJob:
    """Reads and checks everything in the constructor; `finish` changes the scene.

    names are those of the keys, one for each place of `frames`; without `frames` the pose shown now is taken.
    """

    def __init__(
        self,
        objects: Sequence[bpy.types.Object],
        scene: bpy.types.Scene,
        names: Sequence[str],
        frames: FrameList | None,
        *,
        value: float,
        off: bool,
    ) -> None:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for ob in objects:
            check_owner(ob)
        self._names, self._value, self._off = tuple(names), value, off
        self._sources = [BakeSource(ob, depsgraph) for ob in objects]
        if frames is None:
            self._read(depsgraph)
        armatures = {source.armature.name_full: source.armature for source in self._sources}
        walk = FrameWalk(scene, frames or FrameList(()), list(armatures.values()), self._read)
        self.task = SampledTask(walk, self._solve)

    def _read(self, depsgraph: bpy.types.Depsgraph) -> None:
        for source in self._sources:
            source.read(depsgraph)

    def _solve(self) -> OffsetsTask:
        return OffsetsTask([(source.frames(), source.samples) for source in self._sources])

    def finish(self) -> str:
        """Add the keys; one line about them."""
        solved = self.task.result()
        made: list[str] = []
        try:
            for source, offsets in zip(self._sources, solved, strict=True):
                if len(offsets[0]) != len(source.ob.data.vertices):
                    raise InputError(f"'{source.name}' was edited while it was being baked.")
            for source, offsets in zip(self._sources, solved, strict=True):
                for name, offset in zip(self._names, offsets, strict=True):
                    made.append(add_offset_key(source.ob, name, offset, self._value).name)
                if self._off:
                    switch_off(source.ob, "KEYS")
        except ReferenceError as error:
            raise InputError("A mesh was removed while it was being baked.") from error
        return f"Saved {counted(len(made), 'shape key')}: {listed(made)}."
