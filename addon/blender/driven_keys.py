# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrective shape keys with drivers, or with keyframes where no driver can go along."""

from collections.abc import Sequence

import bpy

from ..core.driven_keys_task import DrivenKeys
from ..core.pose_readers import PoseReader
from .offset_keys import add_offset_key

PREFIX = "Dermis "
# Blender cuts longer names.
LONGEST_NAME = 58


def add_driven_keys(
    ob: bpy.types.Object, armature: bpy.types.Object, found: DrivenKeys, frames: Sequence[float] | None
) -> list[str]:
    """Add the keys; with `frames` their values are keyframes there instead of drivers. Their names."""
    names = []
    for key, values in zip(found.keys, found.values, strict=True):
        block = add_offset_key(ob, (PREFIX + key.reader.label)[:LONGEST_NAME], key.offsets, 0.0)
        names.append(block.name)
        if frames is None:
            _drive(block, armature, key.reader)
        else:
            for frame, value in zip(frames, values.tolist(), strict=True):
                block.value = value
                block.keyframe_insert("value", frame=frame)
    return names


def _drive(block: bpy.types.ShapeKey, armature: bpy.types.Object, reader: PoseReader) -> None:
    driver = block.driver_add("value").driver
    driver.type = "SCRIPTED"
    for wanted in reader.variables:
        variable = driver.variables.new()
        variable.name = wanted.name
        variable.type = "TRANSFORMS"
        target = variable.targets[0]
        target.id = armature
        target.bone_target = reader.bone
        target.transform_type = wanted.channel
        target.rotation_mode = wanted.mode
        target.transform_space = "LOCAL_SPACE"
    driver.expression = reader.expression
