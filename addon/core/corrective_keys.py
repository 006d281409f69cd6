# SPDX-License-Identifier: GPL-3.0-or-later
"""As few shape keys as give a wanted share of a skin's corrections, each driven by one joint.

Corrections are sampled in whole poses and in poses of one joint alone. The latter say which vertices a
joint moves, so that its keys touch no others and keys of two joints share what both move. Keys are
chosen greedily, by orthogonal matching pursuit over the readers of all joints; their shapes are the least-squares
fit to all samples at once, so that keys that act together add up to what was sampled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

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
# Vertices that share less than this of all do not take part in the choice.
NEGLIGIBLE = 1e-6


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
    """Vertices that the same joints move.

    The choice needs only the products of samples with each other, so its cost does not grow with the vertices:
    first and left (R,r) have the same products as the offsets in the samples `rows` and as what the chosen keys
    leave of them. columns are the keys that act here, basis (R,k) spans their values; gains
    holds for each joint how much each of its readers would take away besides them.
    """

    vertices: npt.NDArray[np.intp]
    joints: tuple[int, ...]
    rows: npt.NDArray[np.intp]
    whole: Flags
    first: Floats
    left: Floats
    basis: Floats
    columns: list[int] = field(default_factory=list)
    gains: dict[int, Floats] = field(default_factory=dict)

    def fit(self, design: Floats) -> None:
        """Take what the chosen keys of the design (S,K) give away."""
        part = design[self.rows][:, self.columns]
        self.left = self.first - part @ (_solution(part) @ self.first)
        self.basis = np.asarray(np.linalg.qr(part)[0], np.float64)

    @property
    def error(self) -> float:
        """Square of what is left in the whole poses."""
        return float(np.square(self.left[self.whole]).sum())

    def weigh(self, values: Sequence[Floats], small: float) -> None:
        """Find how much each reader of each joint would take away besides the chosen keys (squared)."""
        self.gains = {}
        if np.square(self.left).sum() <= small:
            return
        for joint in self.joints:
            candidates = values[joint][:, self.rows]
            before = np.square(candidates).sum(axis=1)
            candidates = candidates - (candidates @ self.basis) @ self.basis.T
            size = np.square(candidates).sum(axis=1)
            reach = np.square(candidates @ self.left).sum(axis=1)
            alive = size > 1e-6 * np.maximum(before, 1e-12)
            self.gains[joint] = np.where(alive, reach / np.maximum(size, 1e-300), 0.0)


def _solution(part: Floats) -> Floats:
    """Matrix (k,R) from samples to the shapes of keys whose values are `part` (R,k)."""
    gram = part.T @ part
    gram += RIDGE * np.trace(gram) / max(len(gram), 1) * np.eye(len(gram))
    return np.asarray(np.linalg.solve(gram, part.T), np.float64)


def choose_keys(
    samples: JointSamples, kept: float, most: int, check: Callable[[float], None] = lambda _: None
) -> ChosenKeys:
    """As few keys as keep the share `kept` of the whole poses' corrections, at most `most`.

    Where there is no whole pose, those of one joint alone count.

    `check` hears of the progress, 0 to 1, and may raise to stop.
    """
    whole = samples.owner < 0
    if not whole.any():
        whole = np.ones_like(whole)
    groups = _groups(samples, whole)
    total = float(np.square(samples.offsets[whole], dtype=np.float64).sum())
    everything = float(np.square(samples.offsets, dtype=np.float64).sum())
    outside = max(total - sum(group.error for group in groups), 0.0)
    chosen: list[tuple[int, int]] = []
    design = np.empty((len(samples.owner), 0))
    share = 0.0
    small = NEGLIGIBLE * everything
    gains = [np.zeros(len(values)) for values in samples.values]
    for group in groups:
        group.weigh(samples.values, small)
    while total > 0 and share < kept and len(chosen) < most:
        for joint, values in enumerate(gains):
            values[:] = sum(group.gains[joint] for group in groups if joint in group.gains)
        for joint, reader in chosen:
            gains[joint][reader] = 0.0
        joint = max(range(len(gains)), key=lambda j: (float(gains[j].max(initial=0.0)), -j), default=-1)
        if joint < 0 or gains[joint].max(initial=0.0) <= LEAST_GAIN * everything:
            break
        reader = int(np.argmax(gains[joint]))
        chosen.append((joint, reader))
        design = np.column_stack([design, samples.values[joint][reader]])
        for group in groups:
            if joint in group.joints:
                group.columns.append(len(chosen) - 1)
                group.fit(design)
                group.weigh(samples.values, small)
        left = outside + sum(group.error for group in groups)
        share = 1.0 - float(np.sqrt(max(left, 0.0) / total))
        check(max(share / kept, len(chosen) / most))
    return ChosenKeys(_keys(samples, groups, chosen, design), share)


def _groups(samples: JointSamples, whole: Flags) -> list[_Group]:
    touched = samples.touched
    if not len(touched):
        return []
    patterns, place = np.unique(touched.T, axis=0, return_inverse=True)
    order = np.argsort(place.ravel(), kind="stable")
    bounds = np.searchsorted(place.ravel()[order], np.arange(len(patterns) + 1))
    found = []
    for number, pattern in enumerate(patterns):
        if not pattern.any():
            continue
        joints = tuple(np.flatnonzero(pattern).tolist())
        vertices = order[bounds[number] : bounds[number + 1]]
        rows = np.flatnonzero((samples.owner < 0) | np.isin(samples.owner, joints))
        first = _narrowed(_target(samples, rows, vertices))
        found.append(_Group(vertices, joints, rows, whole[rows], first, first, np.empty((len(rows), 0))))
    return found


def _narrowed(target: Floats) -> Floats:
    """As few columns as have the products of the target's rows (R,n) with each other, but for a negligible rest."""
    if target.shape[1] <= 8:
        return target
    values, vectors = np.linalg.eigh(target @ target.T)
    values = np.maximum(values, 0.0)
    kept = np.cumsum(values) > NEGLIGIBLE * values.sum()
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]), np.float64)


def _target(samples: JointSamples, rows: npt.NDArray[np.intp], vertices: npt.NDArray[np.intp]) -> Floats:
    """Offsets (R, 3 vertices) of some samples and vertices."""
    part = samples.offsets[np.ix_(rows, vertices)]
    return np.asarray(part.reshape(len(rows), -1), np.float64)


def _keys(
    samples: JointSamples, groups: list[_Group], chosen: list[tuple[int, int]], design: Floats
) -> tuple[CorrectiveKey, ...]:
    shapes = np.zeros((len(chosen), samples.offsets.shape[1], 3), np.float32)
    for group in groups:
        if group.columns:
            fitted = _solution(design[group.rows][:, group.columns]) @ _target(samples, group.rows, group.vertices)
            for column, shape in zip(group.columns, fitted, strict=True):
                shapes[column, group.vertices] = shape.reshape(-1, 3)
    return tuple(
        CorrectiveKey(samples.readers[joint][reader], joint, shapes[number])
        for number, (joint, reader) in enumerate(chosen)
    )
