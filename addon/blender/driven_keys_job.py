# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake of pose-driven corrective keys: read poses and joints, choose in a thread, write."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import bpy
import numpy as np

from ..core.driven_keys_task import DrivenKeys, DrivenKeysOrder, DrivenKeysTask, Joint, range_of_motion
from ..core.errors import InputError, counted
from ..core.frame_range import FrameList, FrameRange
from .bake_source import BakeSource
from .bake_state import back_to_live, switch_off
from .driven_keys import add_driven_keys
from .frame_walk import FrameWalk
from .lengths import length_text
from .sampled_task import SampledTask
from .skin_checks import check_owner


@dataclass(frozen=True)
class DrivenKeysSettings:
    """frames are None where the range of motion alone counts, motion (radians) is None where the frames alone do."""

    frames: FrameRange | None
    motion: float | None
    kept: float
    most_keys: int
    most_poses: int
    as_keyframes: bool


@dataclass
class _Read:
    """A mesh's skin and its bones' local rotations, frame by frame."""

    source: BakeSource
    rotations: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)

    def read(self, depsgraph: bpy.types.Depsgraph) -> None:
        self.source.read(depsgraph)
        armature = self.source.armature.evaluated_get(depsgraph)
        for name in self.bones:
            bone = armature.pose.bones[name]
            # What a driver reads in Local Space.
            local = armature.convert_space(pose_bone=bone, matrix=bone.matrix, from_space="POSE", to_space="LOCAL")
            self.rotations.setdefault(name, []).append(tuple(local.to_quaternion()))

    @property
    def bones(self) -> list[str]:
        """Names of the deforming bones, segmented ones once."""
        return [bone.name for bone in self.source.armature.data.bones if bone.name in self._columns]

    @property
    def _columns(self) -> dict[str, tuple[int, int]]:
        """First and last column of each bone."""
        layout = self.source.reading.layout
        columns = {name: (i, i) for i, name in enumerate(layout.bones.names)}
        for bone in layout.segmented:
            columns[bone.name] = bone.first, bone.first + len(bone.joints_inverse) - 1
        return columns

    def joints(self, motion: float | None) -> list[Joint]:
        """All bones as joints."""
        layout, place = self.source.reading.layout, self.source.place
        rests = {bone.name: bone.rest for bone in layout.segmented}
        more = np.empty((0, 4)) if motion is None else range_of_motion(motion)
        found = []
        for name, (first, last) in self._columns.items():
            if name not in self.source.armature.data.bones:
                continue
            carried = np.zeros(len(layout.bones), np.bool_)
            for column, parent in enumerate(layout.bones.parents.tolist()):
                carried[column] = first <= column <= last or (parent >= 0 and carried[parent])
            rest = place.armature @ rests.get(name, layout.rest[first])
            rotations = np.array(self.rotations.get(name, []), np.float64).reshape(-1, 4)
            found.append(Joint(name, carried, rest, rotations, more))
        return found


class DrivenKeysJob:
    """Reads and checks everything in the constructor; `finish` changes the scene."""

    def __init__(
        self, objects: Sequence[bpy.types.Object], scene: bpy.types.Scene, settings: DrivenKeysSettings
    ) -> None:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for ob in objects:
            check_owner(ob)
        self._scene, self._settings = scene, settings
        self._reads = [_Read(BakeSource(ob, depsgraph)) for ob in objects]
        armatures = {read.source.armature.name_full: read.source.armature for read in self._reads}
        frames = settings.frames or FrameList(())
        # Keyframes lie on the time that animation sees, after the scene's own stretching.
        stretch = scene.render.frame_map_old / scene.render.frame_map_new
        self._places = [stretch * sum(frames.place(index)) for index in range(len(frames))]
        self.task = SampledTask(FrameWalk(scene, frames, list(armatures.values()), self._read), self._choose)

    def _read(self, depsgraph: bpy.types.Depsgraph) -> None:
        for read in self._reads:
            read.read(depsgraph)

    def _choose(self) -> DrivenKeysTask:
        settings = self._settings
        orders = [
            DrivenKeysOrder(
                read.source.frames(), read.source.samples, read.joints(settings.motion), settings.most_poses
            )
            for read in self._reads
        ]
        return DrivenKeysTask(orders, settings.kept, settings.most_keys)

    def finish(self) -> str:
        """Add the keys and switch the live skins off; one line about them."""
        found: list[DrivenKeys] = self.task.result()
        frames = self._places if self._settings.as_keyframes else None
        try:
            for read, result in zip(self._reads, found, strict=True):
                if not result.keys:
                    raise InputError(f"No joint of '{result.name}' turns so that its skin needs a correction.")
                if len(result.keys[0].offsets) != len(read.source.ob.data.vertices):
                    raise InputError(f"'{result.name}' was edited while it was being baked.")
            with ExitStack() as undo:
                for read, result in zip(self._reads, found, strict=True):
                    ob = read.source.ob
                    switch_off(ob, "KEYS")
                    undo.callback(back_to_live, [ob])
                    names = add_driven_keys(ob, read.source.armature, result, frames)
                    ob.dermis_skin.baked_keys = "\n".join(names)
                undo.pop_all()
        except ReferenceError as error:
            raise InputError("A mesh was removed while it was being baked.") from error
        return " ".join(self._line(result) for result in found)

    def _line(self, result: DrivenKeys) -> str:
        largest, before = (length_text(value, self._scene) for value in (result.largest, result.before))
        return (
            f"'{result.name}': {counted(len(result.keys), 'key')} keep {result.kept:.0%} of the correction; "
            f"a vertex is off by {largest} at most, by {before} without them."
        )
