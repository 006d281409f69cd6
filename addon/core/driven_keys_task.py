# SPDX-License-Identifier: GPL-3.0-or-later
"""Pose-driven corrective keys of skins, in a thread of its own: sample joints alone, choose keys, judge them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .character import Flags, Floats, Weights
from .corrective_keys import ChosenKeys, CorrectiveKey, JointSamples, choose_keys
from .errors import InputError
from .pose_readers import readers_of, rotation_matrices, spread_out
from .skin_frames import PoseSample, SkinFrames
from .stepped_task import SteppedTask

# Angles below this (radians) count as rest.
LEAST_ANGLE = 0.09
# Poses of one joint alone, taken from the frames.
ALONE = 8
# Poses in which about half of the joints take a rotation of their range at once.
MIXED = 60
# Bytes that the samples may take.
MOST_BYTES = 2_000_000_000


@dataclass(frozen=True)
class Joint:
    """A bone that turns.

    columns (B,) are the skin's columns that it carries along, rest (4,4) its rest matrix in solver space;
    rotations (P,4) its local rotations in the sampled frames, more (M,4) others that it may take.
    """

    bone: str
    columns: Flags
    rest: Floats
    rotations: Floats
    more: Floats

    @property
    def reachable(self) -> Floats:
        """All rotations (P+M,4) to be prepared for."""
        return np.concatenate([self.rotations, self.more])

    def alone(self, rotations: Floats, bones: int) -> Floats:
        """Transforms (n,B,4,4) of poses where this joint alone is turned."""
        turns = np.tile(np.eye(4), (len(rotations), 1, 1))
        turns[:, :3, :3] = rotation_matrices(rotations)
        transforms = np.tile(np.eye(4), (len(rotations), bones, 1, 1))
        transforms[:, self.columns] = (self.rest @ turns @ np.linalg.inv(self.rest))[:, None]
        return transforms


@dataclass(frozen=True)
class DrivenKeysOrder:
    """One mesh: its skin, the frames' poses, the joints, and how many of the poses are fitted to."""

    frames: SkinFrames
    samples: Sequence[PoseSample]
    joints: Sequence[Joint]
    most_poses: int


@dataclass(frozen=True)
class DrivenKeys:
    """The keys of one mesh with their values (P,) in all sampled frames.

    kept is the share of the correction (root mean square over the fitted poses) that they keep; largest
    is the farthest that a vertex is off, in the object's units; before is the same without keys.
    """

    name: str
    keys: tuple[CorrectiveKey, ...]
    values: tuple[Floats, ...]
    kept: float
    largest: float
    before: float


class DrivenKeysTask(SteppedTask[list[DrivenKeys]]):
    """Makes the keys of one mesh after the other."""

    def __init__(self, orders: Sequence[DrivenKeysOrder], kept: float, most: int) -> None:
        super().__init__("dermis-driven-keys", "solving poses")
        self._orders = tuple(orders)
        self._kept, self._most = kept, most

    def work(self) -> list[DrivenKeys]:
        """One result for each mesh."""
        found = []
        for number, order in enumerate(self._orders):
            self._start, self._share = number / len(self._orders), 1.0 / len(self._orders)
            found.append(self._keys(order))
        return found

    def _at(self, fraction: float) -> None:
        self._step(self._start + self._share * min(fraction, 1.0))

    def _keys(self, order: DrivenKeysOrder) -> DrivenKeys:
        self._stage = "solving poses"
        count = len(order.samples)
        step = max(count / order.most_poses, 1.0)
        whole = sorted({min(int(i * step), count - 1) for i in range(order.most_poses)} | {count - 1}) if count else []
        joints = [joint for joint in order.joints if _turns(joint)]
        rotations = [_rotations_alone(joint) for joint in joints]
        poses = [order.samples[index] for index in whole]
        mixed = mixed_rotations(joints)
        poses += [PoseSample(transforms) for transforms in _together(joints, mixed)]
        complete = len(poses)
        owner = [-1] * complete
        for number, (joint, turned) in enumerate(zip(joints, rotations, strict=True)):
            alone = joint.alone(turned, len(joint.columns)).astype(np.float32)
            poses += [PoseSample(transforms) for transforms in alone]
            owner += [number] * len(alone)
        offsets = self._offsets(order, poses)
        active = np.flatnonzero(np.abs(offsets).max(axis=(0, 2), initial=0.0) > 0)
        readers, values = [], []
        for number, (joint, turned) in enumerate(zip(joints, rotations, strict=True)):
            readers.append(readers_of(joint.bone, joint.reachable, least=LEAST_ANGLE))
            seen = np.tile([1.0, 0.0, 0.0, 0.0], (len(poses), 1))
            seen[: len(whole)] = joint.rotations[whole]
            seen[len(whole) : complete] = mixed[number]
            seen[np.array(owner) == number] = turned
            values.append(np.array([reader.values(seen) for reader in readers[-1]]).reshape(-1, len(poses)))
        samples = JointSamples(offsets[:, active], np.array(owner, np.int32), readers, values)
        self._stage = "choosing keys"
        chosen = choose_keys(samples, self._kept, self._most, lambda fraction: self._at(0.5 + 0.4 * fraction))
        self._stage = "judging keys"
        return self._judged(order, joints, chosen, active, poses[:complete], offsets, samples)

    def _offsets(self, order: DrivenKeysOrder, poses: Sequence[PoseSample]) -> Weights:
        size = len(poses) * order.frames.rest.nbytes
        if size > MOST_BYTES:
            raise InputError(
                f"{len(poses)} poses of '{order.frames.name}' take {size / 1e9:.1f} GB: ask for fewer poses."
            )
        offsets = np.empty((len(poses), *order.frames.rest.shape), np.float32)
        for index, pose in enumerate(poses):
            self._at(0.5 * index / max(len(poses), 1))
            offsets[index] = order.frames.acting_offsets(pose)
        return offsets

    def _judged(
        self,
        order: DrivenKeysOrder,
        joints: Sequence[Joint],
        chosen: ChosenKeys,
        active: npt.NDArray[np.intp],
        poses: Sequence[PoseSample],
        offsets: Weights,
        samples: JointSamples,
    ) -> DrivenKeys:
        keys = []
        for key in chosen.keys:
            shape = np.zeros_like(order.frames.rest)
            shape[active] = key.offsets
            keys.append(CorrectiveKey(key.reader, key.joint, shape))
        columns = [samples.values[key.joint][list(samples.readers[key.joint]).index(key.reader)] for key in chosen.keys]
        left = whole = largest = before = 0.0
        for index, pose in enumerate(poses):
            self._at(0.9 + 0.1 * index / len(poses))
            mixed = np.zeros_like(order.frames.rest)
            for key, values in zip(keys, columns, strict=True):
                if values[index]:
                    mixed += np.float32(values[index]) * key.offsets
            wanted = order.frames.with_offsets(pose, offsets[index])
            off = np.square(order.frames.with_offsets(pose, mixed) - wanted, dtype=np.float64).sum(axis=1)
            plain = np.square(order.frames.with_offsets(pose, np.zeros_like(mixed)) - wanted, dtype=np.float64)
            left += off.sum()
            whole += plain.sum()
            largest = max(largest, float(off.max(initial=0.0)))
            before = max(before, float(plain.sum(axis=1).max(initial=0.0)))
        return DrivenKeys(
            name=order.frames.name,
            keys=tuple(keys),
            values=tuple(key.reader.values(joints[key.joint].rotations) for key in chosen.keys),
            kept=1.0 - float(np.sqrt(left / whole)) if whole > 0 else 1.0,
            largest=float(np.sqrt(largest)),
            before=float(np.sqrt(before)),
        )


def range_of_motion(angle: float, steps: int = 3) -> Floats:
    """Rotations (n,4) of a joint that bends both ways about X and Z up to `angle`, and twists up to half of it."""
    found = []
    for axis, most in ((1, angle), (2, angle / 2), (3, angle)):
        for share in range(-steps, steps + 1):
            half = most * share / steps / 2
            if share:
                q = np.zeros(4)
                q[0], q[axis] = np.cos(half), np.sin(half)
                found.append(q)
    return np.array(found).reshape(-1, 4)


def mixed_rotations(joints: Sequence[Joint]) -> Floats:
    """Rotations (J,n,4) of the joints in poses where about half of them turn somewhere in their range."""
    ranges = [joint.more for joint in joints]
    count = MIXED if any(len(more) for more in ranges) else 0
    random = np.random.default_rng(0)
    found = np.tile([1.0, 0.0, 0.0, 0.0], (len(joints), count, 1))
    for number, more in enumerate(ranges):
        turned = np.flatnonzero(random.random(count) < 0.5)
        if len(more) and len(turned):
            ends = more[random.integers(0, len(more), len(turned))]
            half = np.arccos(np.clip(ends[:, :1], -1.0, 1.0))
            axes = ends[:, 1:] / np.linalg.norm(ends[:, 1:], axis=1, keepdims=True)
            half *= random.random((len(turned), 1))
            found[number, turned] = np.concatenate([np.cos(half), np.sin(half) * axes], axis=1)
    return found


def _together(joints: Sequence[Joint], rotations: Floats) -> list[npt.NDArray[np.float32]]:
    """Transforms (B,4,4) of poses where all joints turn by rotations (J,n,4)."""
    if not len(joints):
        return []
    bones = len(joints[0].columns)
    total = np.tile(np.eye(4), (rotations.shape[1], bones, 1, 1))
    # From the roots to the tips: who carries more comes first.
    for number in sorted(range(len(joints)), key=lambda j: (-int(joints[j].columns.sum()), j)):
        columns = joints[number].columns
        total[:, columns] = total[:, columns] @ joints[number].alone(rotations[number], bones)[:, columns]
    return list(total.astype(np.float32))


def _turns(joint: Joint) -> bool:
    return bool(spread_out(joint.reachable, 1, LEAST_ANGLE))


def _rotations_alone(joint: Joint) -> Floats:
    """Rotations (n,4) to be sampled with all other joints at rest."""
    chosen = spread_out(joint.rotations, ALONE, LEAST_ANGLE)
    # Half of the way to each: what a joint does between rest and there.
    far = joint.rotations[chosen]
    half = np.where(far[:, :1] < 0, -far, far) + np.array([1.0, 0.0, 0.0, 0.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return np.concatenate([far, half, joint.more])
