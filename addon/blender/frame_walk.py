# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps a scene through frames, a little at a time, and leaves it as it was."""

from collections.abc import Callable, Sequence
from time import monotonic

import bpy
import numpy as np

from ..core.frame_range import FrameList, FrameRange
from .skin_handlers import paused

# Channels of a posed bone and their width.
_CHANNELS = {"location": 3, "rotation_quaternion": 4, "rotation_euler": 3, "rotation_axis_angle": 4, "scale": 3}


class FrameWalk:
    """Evaluates the scene at each sample of a range and hands it to `read(depsgraph)`.

    Live skins are not solved meanwhile. `restore` brings the scene's own frame back, with what
    was posed there and not keyed.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        frames: FrameRange | FrameList,
        armatures: Sequence[bpy.types.Object],
        read: Callable[[bpy.types.Depsgraph], None],
    ) -> None:
        self._scene, self._frames, self._read = scene, frames, read
        self._place = scene.frame_current, scene.frame_subframe
        self._poses = [(armature, _pose(armature)) for armature in armatures]
        self._next = 0
        self._restored = False

    @property
    def fraction(self) -> float:
        """Share of the samples read."""
        return self._next / max(len(self._frames), 1)

    def step(self, seconds: float) -> bool:
        """Go on for about so long; true when all was read, and the scene is back at its own frame."""
        until = monotonic() + seconds
        while self._next < len(self._frames):
            frame, subframe = self._frames.place(self._next)
            with paused():
                self._scene.frame_set(frame, subframe=subframe)
                self._read(bpy.context.evaluated_depsgraph_get())
            self._next += 1
            if monotonic() > until:
                break
        if self._next < len(self._frames):
            return False
        self.restore()
        return True

    def restore(self) -> None:
        """Back to the frame and the pose where it began."""
        if self._restored or self._next == 0:
            return
        self._restored = True
        self._scene.frame_set(self._place[0], subframe=self._place[1])
        for armature, before in self._poses:
            now = _pose(armature)
            changed = [name for name, values in before.items() if not np.array_equal(values, now[name])]
            for name in changed:
                armature.pose.bones.foreach_set(name, before[name])
            if changed:
                armature.update_tag()
                bpy.context.view_layer.update()


def _pose(armature: bpy.types.Object) -> dict[str, np.ndarray]:
    bones = armature.pose.bones
    pose = {}
    for name, width in _CHANNELS.items():
        pose[name] = np.empty(len(bones) * width, np.float32)
        bones.foreach_get(name, pose[name])
    return pose
