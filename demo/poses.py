# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses that mean the same on any body of the rig: rotations about world axes, keyed over the frames."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Quaternion, Vector

# A rotation in degrees about an axis of the world, in the rest pose: X to the character's left,
# Y backwards, Z up. For "_l" bones; "_r" and ".R" bones mirror it.
LEFT, BACK, UP = Vector((1, 0, 0)), Vector((0, 1, 0)), Vector((0, 0, 1))
Turn = tuple[Vector, float]
FRAMES_BETWEEN = 24

POSES: dict[str, dict[str, list[Turn]]] = {
    "rest": {},
    "arms": {
        "clavicle_l": [(BACK, -14)],
        "upperarm_l": [(BACK, -62)],
        "lowerarm_l": [(BACK, -48)],
        "clavicle_r": [(BACK, -14)],
        "upperarm_r": [(BACK, -62)],
        "lowerarm_r": [(BACK, -48)],
        "head": [(LEFT, -10)],
    },
    "knees": {
        "spine_01": [(LEFT, 18)],
        "thigh_l": [(LEFT, -82), (UP, 8)],
        "calf_l": [(LEFT, 108)],
        "foot_l": [(LEFT, -30)],
        "thigh_r": [(LEFT, -82), (UP, 8)],
        "calf_r": [(LEFT, 108)],
        "foot_r": [(LEFT, -30)],
        "upperarm_l": [(UP, -62)],
        "upperarm_r": [(UP, -62)],
        "head": [(LEFT, -12)],
    },
    "twist": {
        "spine_01": [(UP, 14)],
        "spine_02": [(UP, 16)],
        "spine_03": [(UP, 16)],
        "neck_01": [(UP, 12)],
        "head": [(UP, 22)],
        "upperarm_l": [(BACK, -20), (UP, -25)],
        "lowerarm_l": [(UP, -75)],
        "upperarm_r": [(BACK, -36)],
        "lowerarm_r": [(UP, -30)],
        "thigh_l": [(LEFT, -28)],
        "calf_l": [(LEFT, 40)],
        "thigh_r": [(LEFT, 12)],
    },
}


def frame_of(pose: str) -> int:
    """The frame on which a pose is reached."""
    return 1 + FRAMES_BETWEEN * list(POSES).index(pose)


def key_poses(armature: bpy.types.Object, body: bpy.types.Object) -> None:
    """Key every pose, with the lowest point of the body on the floor."""
    scene = bpy.context.scene
    for pose, turns in POSES.items():
        frame = frame_of(pose)
        for bone in armature.pose.bones:
            bone.rotation_quaternion = local_rotation(bone, turns.get(bone.name, []))
            bone.keyframe_insert("rotation_quaternion", frame=frame)
        armature.location.z = 0.0
        bpy.context.view_layer.update()
        armature.location.z = -lowest_point(body)
        armature.keyframe_insert("location", index=2, frame=frame)
    scene.frame_start, scene.frame_end = 1, frame_of(list(POSES)[-1])
    scene.frame_set(1)


def local_rotation(bone: bpy.types.PoseBone, turns: list[Turn]) -> Quaternion:
    """The turns, one after another about world axes of the rest pose, in the bone's own axes."""
    total = Quaternion()
    for axis, degrees in turns:
        mirrored = bone.name.endswith(("_r", ".R")) and axis is not LEFT
        total = Quaternion(axis, np.radians(-degrees if mirrored else degrees)) @ total
    rest = bone.bone.matrix_local.to_quaternion()
    return rest.inverted() @ total @ rest


def lowest_point(body: bpy.types.Object) -> float:
    """Height of the evaluated mesh's lowest vertex in the world."""
    evaluated = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = np.empty(3 * len(evaluated.data.vertices), np.float32)
    evaluated.data.vertices.foreach_get("co", points)
    matrix = np.array(evaluated.matrix_world)
    return float((points.reshape(-1, 3) @ matrix[2, :3] + matrix[2, 3]).min())
