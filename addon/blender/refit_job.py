# SPDX-License-Identifier: GPL-3.0-or-later
"""One refit of weights to live skins: read, fit in a thread, write."""

from collections.abc import Sequence
from contextlib import ExitStack

import bpy
import numpy as np

from ..core.errors import InputError, listed
from ..core.frame_range import FrameList
from ..core.refit_task import Refit, RefitOrder, RefitTask
from .bake_source import BakeSource
from .bake_state import back_to_live, switch_off
from .baked_weights import keep_weights
from .frame_walk import FrameWalk
from .lengths import length_text
from .sampled_task import SampledTask
from .skin_checks import check_owner
from .vertex_groups import GroupWeights, read_groups, write_groups


class RefitJob:
    """Reads and checks everything in the constructor; `finish` changes the scene."""

    def __init__(
        self, objects: Sequence[bpy.types.Object], scene: bpy.types.Scene, frames: FrameList, limit: int, least: float
    ) -> None:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for ob in objects:
            check_owner(ob)
        self._scene, self._limit, self._least = scene, limit, least
        self._sources = [BakeSource(ob, depsgraph) for ob in objects]
        for source in self._sources:
            _check_linear(source)
        self._groups = [read_groups(ob) for ob in objects]
        armatures = {source.armature.name_full: source.armature for source in self._sources}
        self.task = SampledTask(FrameWalk(scene, frames, list(armatures.values()), self._read), self._fit)

    def _read(self, depsgraph: bpy.types.Depsgraph) -> None:
        for source in self._sources:
            source.read(depsgraph)

    def _fit(self) -> RefitTask:
        orders = []
        for source, groups in zip(self._sources, self._groups, strict=True):
            edges = np.empty(2 * len(source.ob.data.edges), np.int32)
            source.ob.data.edges.foreach_get("vertices", edges)
            bones = source.reading.raw.bones
            orders.append(
                RefitOrder(
                    frames=source.frames(),
                    samples=source.samples,
                    weights=source.reading.raw.weights,
                    bones=bones,
                    locked=groups.locked_bones(bones.names),
                    edges=edges.reshape(-1, 2),
                )
            )
        return RefitTask(orders, self._limit)

    def finish(self) -> str:
        """Write the weights and switch the live skins off; one line about them."""
        found: list[Refit] = self.task.result()
        worth = [refit.kept >= self._least for refit in found]
        if not any(worth):
            raise InputError(
                " ".join(self._line(refit) for refit in found)
                + f" That is less than the {self._least:.0%} asked for: bake shape keys or a point cache instead."
            )
        try:
            for source, groups in zip(self._sources, self._groups, strict=True):
                if len(groups.counts) != len(source.ob.data.vertices):
                    raise InputError(f"'{source.name}' was edited while its weights were being fitted.")
            with ExitStack() as undo:
                for source, groups, refit, wanted in zip(self._sources, self._groups, found, worth, strict=True):
                    if wanted:
                        undo.callback(back_to_live, [source.ob])
                        _write(source, groups, refit)
                undo.pop_all()
        except ReferenceError as error:
            raise InputError("A mesh was removed while its weights were being fitted.") from error
        left = [refit.name for refit, wanted in zip(found, worth, strict=True) if not wanted]
        lines = [self._line(refit) for refit in found]
        return " ".join(lines + ([f"Left live, as too little would be kept: {listed(left)}."] if left else []))

    def _line(self, refit: Refit) -> str:
        largest, before = (length_text(value, self._scene) for value in (refit.largest, refit.before))
        return (
            f"'{refit.name}': plain weights keep {refit.kept:.0%} of the correction; "
            f"a vertex is off by {largest} at most, by {before} with the old weights."
        )


def _write(source: BakeSource, groups: GroupWeights, refit: Refit) -> None:
    keep_weights(source.ob, groups)
    switch_off(source.ob, "WEIGHTS")
    names = source.reading.raw.bones.names
    write_groups(source.ob, names, refit.weights, refit.changed, np.unique(refit.weights.bone).tolist())
    source.ob.data.update_tag()


def _check_linear(source: BakeSource) -> None:
    if source.modifier.use_deform_preserve_volume:
        raise InputError(
            f"'{source.modifier.name}' of '{source.name}' uses Preserve Volume, which has no plain weights: "
            "switch it off first."
        )
    if source.reading.layout.segmented:
        names = ", ".join(f"'{bone.name}'" for bone in source.reading.layout.segmented)
        raise InputError(f"B-Bones of '{source.armature.name}' have no plain weights: {names}.")
