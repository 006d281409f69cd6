# SPDX-License-Identifier: GPL-3.0-or-later
"""As few shape keys as give a wanted share of a skin's corrections, each driven by one joint.

Corrections are sampled in whole poses and in poses of one joint alone. The latter say which vertices a
joint moves, so that its keys touch no others and keys of two joints share what both move. Keys are
chosen greedily, by orthogonal matching pursuit over the readers of all joints; their shapes are the least-squares
fit to all samples at once, so that keys that act together add up to what was sampled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .character import Flags, Floats, Weights
from .pose_readers import PoseReader

# A joint moves the vertices whose correction comes to this share of its largest.
TOUCHED = 0.01
# Weight of a key's own size in the fit, against overshooting where samples say little.
RIDGE = 1e-4
# A key that takes away less than this share of all is not worth having.
LEAST_GAIN = 2e-4


@dataclass(frozen=True)
class JointSamples:
    """Samples of the corrections.

    offsets (S,V,3): first the whole poses, then those of one joint alone; owner (S,) is the joint of the
    latter and -1 for the former. readers[j] can drive joint j, with values[j] (readers,S).
    """

    offsets: Weights
    owner: npt.NDArray[np.int32]
    readers: Sequence[Sequence[PoseReader]]
    values: Sequence[Floats]

    @property
    def touched(self) -> Flags:
        """Which vertices (J,V) each joint moves."""
        masks = np.zeros((len(self.readers), self.offsets.shape[1]), np.bool_)
        for joint in range(len(self.readers)):
            size = np.linalg.norm(self.offsets[self.owner == joint], axis=2).max(axis=0, initial=0.0)
            masks[joint] = size > max(TOUCHED * float(size.max(initial=0.0)), 1e-12)
        return masks


@dataclass(frozen=True)
class CorrectiveKey:
    """A key: what drives it, and its offsets (V,3) at value 1."""

    reader: PoseReader
    joint: int
    offsets: Weights


@dataclass(frozen=True)
class ChosenKeys:
    """The keys, and the share of the corrections of the whole poses that they keep (root mean square)."""

    keys: tuple[CorrectiveKey, ...]
    kept: float


@dataclass
class _Group:
    """Vertices that the same joints move."""

    vertices: npt.NDArray[np.intp]
    joints: tuple[int, ...]
    rows: npt.NDArray[np.intp]
    target: Weights  # (rows, 3 vertices)
    residual: Weights
    columns: list[int]
    shapes: Floats  # (columns, 3 vertices)

    def fit(self, design: Floats) -> None:
        """Shapes of the chosen keys from the design (S,K) of all chosen keys."""
        part = design[self.rows][:, self.columns]
        gram = part.T @ part
        gram += RIDGE * np.trace(gram) / max(len(gram), 1) * np.eye(len(gram))
        self.shapes = np.linalg.solve(gram, part.T @ self.target)
        self.residual = (self.target - part @ self.shapes).astype(np.float32)


def choose_keys(
    samples: JointSamples, kept: float, most: int, check: Callable[[float], None] = lambda _: None
) -> ChosenKeys:
    """As few keys as keep the share `kept` of the whole poses' corrections, at most `most`.

    Where there is no whole pose, those of one joint alone count.

    `check` hears of the progress, 0 to 1, and may raise to stop.
    """
    groups = _groups(samples)
    whole = samples.owner < 0
    if not whole.any():
        whole = np.ones_like(whole)
    total = float(np.square(samples.offsets[whole], dtype=np.float64).sum())
    everything = float(np.square(samples.offsets, dtype=np.float64).sum())
    outside = total - sum(_of_whole(group, group.target, whole) for group in groups)
    chosen: list[tuple[int, int]] = []
    design = np.empty((len(samples.owner), 0))
    share = 0.0
    gains: dict[int, tuple[float, int]] = {}
    stale = set(range(len(samples.readers)))
    while total > 0 and share < kept and len(chosen) < most:
        for joint in stale:
            gains[joint] = _best(samples, groups, joint, design, chosen)
        if not gains:
            break
        joint = max(gains, key=lambda j: (gains[j][0], -j))
        gain, reader = gains[joint]
        if gain <= LEAST_GAIN * everything:
            break
        chosen.append((joint, reader))
        design = np.column_stack([design, samples.values[joint][reader]])
        stale = set()
        for group in groups:
            if joint in group.joints:
                group.columns.append(len(chosen) - 1)
                group.fit(design)
                stale.update(group.joints)
        left = outside + sum(_of_whole(group, group.residual, whole) for group in groups)
        share = 1.0 - float(np.sqrt(max(left, 0.0) / total))
        check(max(share / kept, len(chosen) / most))
    return ChosenKeys(_keys(samples, groups, chosen), share)


def _groups(samples: JointSamples) -> list[_Group]:
    touched = samples.touched
    if not len(touched):
        return []
    patterns, place = np.unique(touched.T, axis=0, return_inverse=True)
    found = []
    for number, pattern in enumerate(patterns):
        if not pattern.any():
            continue
        joints = tuple(np.flatnonzero(pattern).tolist())
        vertices = np.flatnonzero(place.ravel() == number)
        rows = np.flatnonzero((samples.owner < 0) | np.isin(samples.owner, joints))
        target = samples.offsets[np.ix_(rows, vertices)].reshape(len(rows), -1)
        found.append(_Group(vertices, joints, rows, target, target, [], np.empty((0, target.shape[1]))))
    return found


def _of_whole(group: _Group, values: Weights, whole: Flags) -> float:
    return float(np.square(values[whole[group.rows]], dtype=np.float64).sum())


def _best(
    samples: JointSamples, groups: list[_Group], joint: int, design: Floats, chosen: list[tuple[int, int]]
) -> tuple[float, int]:
    """The joint's reader that would take away most of what is left, and how much (squared)."""
    values = samples.values[joint]
    gains = np.zeros(len(values))
    for group in groups:
        if joint not in group.joints or not len(values):
            continue
        candidates = values[:, group.rows].copy()
        if group.columns:
            basis: Floats = np.linalg.qr(design[group.rows][:, group.columns].astype(np.float64))[0]
            candidates -= (candidates @ basis) @ basis.T
        size = np.square(candidates).sum(axis=1)
        alive = size > 1e-6 * np.maximum(np.square(values[:, group.rows]).sum(axis=1), 1e-12)
        reach = np.square(candidates[alive].astype(np.float32) @ group.residual, dtype=np.float64).sum(axis=1)
        gains[alive] += reach / size[alive]
    for other, reader in chosen:
        if other == joint:
            gains[reader] = 0.0
    if not len(gains):
        return 0.0, 0
    best = int(np.argmax(gains))
    return float(gains[best]), best


def _keys(samples: JointSamples, groups: list[_Group], chosen: list[tuple[int, int]]) -> tuple[CorrectiveKey, ...]:
    shapes = np.zeros((len(chosen), samples.offsets.shape[1], 3), np.float32)
    for group in groups:
        for column, shape in zip(group.columns, group.shapes, strict=True):
            shapes[column, group.vertices] = shape.reshape(-1, 3)
    return tuple(
        CorrectiveKey(samples.readers[joint][reader], joint, shapes[number])
        for number, (joint, reader) in enumerate(chosen)
    )
