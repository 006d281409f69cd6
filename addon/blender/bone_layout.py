# SPDX-License-Identifier: GPL-3.0-or-later
"""Deforming bones as columns: one for each bone, one for each joint between the segments of a B-bone."""

from dataclasses import dataclass

import bpy
import numpy as np

from ..core.character import Bones, BoneWeights
from ..core.errors import InputError, listed
from .vertex_groups import GroupWeights


@dataclass(frozen=True)
class SegmentedBone:
    """A B-bone: the columns of its joints and their rest matrices."""

    name: str
    first: int
    rest: np.ndarray  # (4,4) the bone in armature space
    rest_inverse: np.ndarray  # (4,4)
    joints_inverse: np.ndarray  # (n,4,4) rest⁻¹ of the joints in the bone's space


@dataclass(frozen=True)
class BoneLayout:
    """Columns of a skin's weights and where their transforms come from."""

    bones: Bones  # in armature space
    rest: np.ndarray  # (B,4,4) rest matrices in armature space
    pose_index: np.ndarray  # (B,) place of each column's bone in the pose
    pose_count: int
    segmented: tuple[SegmentedBone, ...]

    def deltas(self, armature: bpy.types.Object) -> np.ndarray | None:
        """pose · rest⁻¹ (B,4,4) of an evaluated armature, None where its bones are not those of the layout."""
        bones = armature.pose.bones
        if len(bones) != self.pose_count:
            return None
        flat = np.empty(self.pose_count * 16, np.float32)
        bones.foreach_get("matrix_channel", flat)
        # Blender stores columns.
        channels = flat.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
        deltas = channels[self.pose_index]
        for bone in self.segmented:
            place = slice(bone.first, bone.first + len(bone.joints_inverse))
            joints = _joint_matrices(bones[bone.name], len(bone.joints_inverse), rest=False)
            deltas[place] = deltas[place] @ bone.rest @ joints @ bone.joints_inverse @ bone.rest_inverse
        return deltas


def read_layout(armature: bpy.types.Object, evaluated: bpy.types.Object) -> BoneLayout:
    """Layout of the armature's deforming bones; `evaluated` is the same armature in an evaluated scene."""
    bones = armature.data.bones
    pose_index = {bone.name: i for i, bone in enumerate(evaluated.pose.bones)}
    names, heads, tails, rests, index, segmented = [], [], [], [], [], []
    first_column: dict[str, int] = {}
    last_column: dict[str, int] = {}
    for bone in bones:
        if not bone.use_deform or bone.name not in pose_index:
            continue
        first_column[bone.name] = len(names)
        rest = np.array(bone.matrix_local, np.float64)
        if bone.bbone_segments == 1:
            rests.append(rest)
            names.append(bone.name)
            heads.append(bone.head_local)
            tails.append(bone.tail_local)
            index.append(pose_index[bone.name])
        else:
            count = bone.bbone_segments + 1
            joints = _joint_matrices(evaluated.pose.bones[bone.name], count, rest=True)
            segmented.append(SegmentedBone(bone.name, len(names), rest, np.linalg.inv(rest), np.linalg.inv(joints)))
            rests += list(_normalized(rest @ joints))
            places = joints[:, :3, 3] @ rest[:3, :3].T + rest[:3, 3]
            middles = (places[1:] + places[:-1]) / 2
            heads += [places[0], *middles]
            tails += [*middles, places[-1]]
            names += [f"{bone.name}[{i}]" for i in range(count)]
            index += [pose_index[bone.name]] * count
        last_column[bone.name] = len(names) - 1
    parents = np.arange(-1, len(names) - 1, dtype=np.int32)
    for name, column in first_column.items():
        ancestor = bones[name].parent
        while ancestor is not None and ancestor.name not in last_column:
            ancestor = ancestor.parent
        parents[column] = -1 if ancestor is None else last_column[ancestor.name]
    layout = Bones(
        tuple(names), np.array(heads, np.float64).reshape(-1, 3), np.array(tails, np.float64).reshape(-1, 3), parents
    )
    rest = np.array(rests, np.float64).reshape(-1, 4, 4)
    return BoneLayout(layout, rest, np.array(index, np.intp), len(pose_index), tuple(segmented))


def read_weights(
    ob: bpy.types.Object,
    armature: bpy.types.Object,
    evaluated: bpy.types.Object,
    layout: BoneLayout,
    groups: GroupWeights,
    positions: np.ndarray,
) -> BoneWeights:
    """Weights in the layout's columns; positions (V,3) are the rest vertices in armature space."""
    column = {name: i for i, name in enumerate(layout.bones.names)}
    starts = {bone.name: bone for bone in layout.segmented}
    bone_names = [bone.name for bone in armature.data.bones if bone.name in column or bone.name in starts]
    weights = groups.of_bones(bone_names)
    used = [bone_names[i] for i in np.unique(weights.bone[weights.value > 0])]
    enveloped = [name for name in used if armature.data.bones[name].use_envelope_multiply]
    if enveloped:
        raise InputError(
            f"Bones of '{armature.name}' multiply their weights on '{ob.name}' by envelopes: {listed(enveloped)}. "
            "Switch Envelope Multiply off."
        )
    first = np.array([starts[name].first if name in starts else column[name] for name in bone_names], np.int32)
    bone = first[weights.bone]
    if not any(name in starts for name in used):
        return BoneWeights(weights.vertex, bone, weights.value)
    split = np.array([name in starts for name in bone_names])[weights.bone]
    vertex, bone, value = [weights.vertex[~split]], [bone[~split]], [weights.value[~split]]
    for entry in np.flatnonzero(split).tolist():
        name = bone_names[weights.bone[entry]]
        at = int(weights.vertex[entry])
        joint, blend = evaluated.pose.bones[name].bbone_segment_index(positions[at])
        vertex.append([at, at])
        bone.append([starts[name].first + joint, starts[name].first + joint + 1])
        value.append([weights.value[entry] * (1.0 - blend), weights.value[entry] * blend])
    return BoneWeights(
        np.concatenate(vertex).astype(np.int32),
        np.concatenate(bone).astype(np.int32),
        np.concatenate(value).astype(np.float32),
    )


def armature_digest(armature: bpy.types.Armature) -> bytes:
    """What a skin depends on of the rest pose, cheap enough to be asked while bones are posed."""
    bones = armature.bones
    parts = ["\0".join(bones.keys()).encode()]
    for name, width, kind in (
        ("matrix_local", 16, np.float32),
        ("head", 3, np.float32),
        ("tail_local", 3, np.float32),
        ("use_deform", 1, np.bool_),
        ("use_envelope_multiply", 1, np.bool_),
        ("bbone_segments", 1, np.int32),
    ):
        values = np.empty(len(bones) * width, kind)
        bones.foreach_get(name, values)
        parts.append(values.tobytes())
    return b"".join(parts)


def _normalized(matrices: np.ndarray) -> np.ndarray:
    """Matrices (n,4,4) with axes of length 1: a segment's rest, whose scale does not count."""
    result = matrices.copy()
    result[:, :3, :3] /= np.linalg.norm(matrices[:, :3, :3], axis=1, keepdims=True)
    return result


def _joint_matrices(bone: bpy.types.PoseBone, count: int, *, rest: bool) -> np.ndarray:
    return np.array([bone.bbone_segment_matrix(i, rest=rest) for i in range(count)], np.float64)
