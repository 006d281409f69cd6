# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights refitted to a skin over sampled poses, in a thread of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .character import Bones, BoneWeights, Flags, Floats, Integers
from .refit import TINY, errors, fit_weights
from .skin_frames import PoseSample, SkinFrames
from .stepped_task import SteppedTask

# Bones that a vertex may get weight on: its own, those of its neighbours, and theirs in the skeleton.
MOST_CANDIDATES = 12
# Corrections below this share of the height are none.
STILL = 1e-5
# Vertices whose Gram matrices are held at a time.
CHUNK = 4_000


@dataclass(frozen=True)
class RefitOrder:
    """One mesh: its skin, the poses, weights (columns are bones), bones, locked (B,) and the mesh's edges (E,2)."""

    frames: SkinFrames
    samples: Sequence[PoseSample]
    weights: BoneWeights
    bones: Bones
    locked: Flags
    edges: Integers


@dataclass(frozen=True)
class Refit:
    """New weights of the vertices `changed`, and what they are worth over the sampled poses.

    kept is the share of the correction (root mean square) that plain skinning with them keeps; largest
    is the farthest that a vertex is off, in the object's units; before is the same with the old weights.
    """

    name: str
    weights: BoneWeights
    changed: npt.NDArray[np.intp]
    kept: float
    largest: float
    before: float


class RefitTask(SteppedTask[list[Refit]]):
    """Fits one mesh after the other."""

    def __init__(self, orders: Sequence[RefitOrder], limit: int) -> None:
        super().__init__("dermis-refit", "fitting weights")
        self._orders = tuple(orders)
        self._limit = limit
        self._total = 3 * sum(len(order.samples) for order in self._orders)
        self._done = 0

    def work(self) -> list[Refit]:
        """One result for each mesh."""
        return [self._refit(order) for order in self._orders]

    def _tick(self) -> None:
        self._step(self._done / self._total)
        self._done += 1

    def _refit(self, order: RefitOrder) -> Refit:
        count = len(order.frames.rest)
        wanted, shapes, moves = [], [], []
        squared, size = np.zeros(count), np.zeros(count)
        for sample in order.samples:
            self._tick()
            wanted.append(order.frames.positions(sample))
            mix = order.frames.mixed(sample)
            shapes.append(order.frames.rest if mix is None else mix.astype(np.float32))
            moves.append(_in_object_space(order.frames, sample))
            off = np.square(order.frames.positions(replace(sample, influence=0.0)) - wanted[-1]).sum(axis=1)
            squared += off
            np.maximum(size, off, out=size)
        totals = order.weights.totals(count)
        height = float(np.ptp(order.frames.rest, axis=0).max(initial=0.0))
        influences = np.bincount(order.weights.vertex[order.weights.value > 0], minlength=count)
        active = np.flatnonzero((totals > TINY) & ((size > (STILL * height) ** 2) | (influences > self._limit)))
        left, largest = squared.copy(), size.copy()
        entries = []
        for start in range(0, len(active), CHUNK):
            chunk = active[start : start + CHUNK]
            fitted, candidates = self._fit(order, chunk, totals, shapes, moves, wanted)
            left[chunk], largest[chunk] = self._judge(order, chunk, fitted, candidates, shapes, moves, wanted)
            row, column = np.nonzero(fitted > 0)
            entries.append((chunk[row], candidates[row, column], fitted[row, column]))
        whole = squared.sum()
        return Refit(
            name=order.frames.name,
            weights=_joined(entries),
            changed=active,
            kept=1.0 - float(np.sqrt(left.sum() / whole)) if whole > 0 else 1.0,
            largest=float(np.sqrt(largest.max(initial=0.0))),
            before=float(np.sqrt(size.max(initial=0.0))),
        )

    def _fit(
        self,
        order: RefitOrder,
        chunk: npt.NDArray[np.intp],
        totals: Floats,
        shapes: Sequence[npt.NDArray[np.float32]],
        moves: Sequence[Floats],
        wanted: Sequence[npt.NDArray[np.float32]],
    ) -> tuple[Floats, npt.NDArray[np.intp]]:
        dense = _dense(order.weights, len(totals), len(order.bones))
        candidates, valid = _candidates(dense, chunk, order)
        start = np.where(valid, np.take_along_axis(dense[chunk], candidates, axis=1), 0.0).astype(np.float64)
        fixed = order.locked[candidates] & valid
        # Locked weights stay what they are; the others share what is left of 1.
        held = np.where(fixed, start, 0.0).sum(axis=1, keepdims=True)
        loose = np.where(fixed, 0.0, start)
        total = loose.sum(axis=1, keepdims=True)
        loose *= np.divide(np.maximum(1.0 - held, 0.0), total, out=np.zeros_like(total), where=total > 0)
        start = np.where(fixed, start, loose)
        gram = np.zeros((len(chunk), candidates.shape[1], candidates.shape[1]))
        for shape, move, place in zip(shapes, moves, wanted, strict=True):
            self._tick()
            off = _moved(order.frames, shape, move, chunk, candidates) - place[chunk][:, None, :]
            gram += np.einsum("ncx,ndx->ncd", off, off)
        fitted = fit_weights(gram, start, valid, fixed, self._limit)
        # A vertex that has no better weights within the limit keeps its own.
        worse = (errors(gram, fitted) >= errors(gram, start)) & ((start > 0).sum(axis=1) <= self._limit)
        return np.where(worse[:, None], start, fitted), candidates

    def _judge(
        self,
        order: RefitOrder,
        chunk: npt.NDArray[np.intp],
        fitted: Floats,
        candidates: npt.NDArray[np.intp],
        shapes: Sequence[npt.NDArray[np.float32]],
        moves: Sequence[Floats],
        wanted: Sequence[npt.NDArray[np.float32]],
    ) -> tuple[Floats, Floats]:
        """Sum and maximum over the poses of each vertex's squared distance from the skin."""
        left, largest = np.zeros(len(chunk)), np.zeros(len(chunk))
        share = fitted / np.maximum(fitted.sum(axis=1, keepdims=True), TINY)
        for shape, move, place in zip(shapes, moves, wanted, strict=True):
            self._tick()
            posed = np.einsum("nc,ncx->nx", share, _moved(order.frames, shape, move, chunk, candidates))
            off = np.square(posed - place[chunk]).sum(axis=1)
            left += off
            np.maximum(largest, off, out=largest)
        return left, largest


def _in_object_space(frames: SkinFrames, sample: PoseSample) -> Floats:
    """The bones' transforms (B,4,4) in the object's axes."""
    moves = np.asarray(sample.transforms, np.float64).copy()
    if frames.to_solver is not None and frames.to_object is not None:
        moves[:, :3, :] = frames.to_object @ moves[:, :3, :]
        moves[:, :3, :3] = moves[:, :3, :3] @ frames.to_solver
    return moves


def _moved(
    frames: SkinFrames,
    shape: npt.NDArray[np.float32],
    move: Floats,
    chunk: npt.NDArray[np.intp],
    candidates: npt.NDArray[np.intp],
) -> Floats:
    """Where each candidate bone alone takes each vertex (n,C,3)."""
    points = shape[chunk].astype(np.float64)
    matrices = move[candidates]
    moved = np.einsum("ncij,nj->nci", matrices[:, :, :3, :3], points) + matrices[:, :, :3, 3]
    if frames.shares is not None:
        moved = points[:, None, :] + frames.shares[chunk][:, None, None] * (moved - points[:, None, :])
    return np.asarray(moved, np.float64)


def _dense(weights: BoneWeights, vertices: int, bones: int) -> npt.NDArray[np.float32]:
    dense = np.zeros((vertices, bones), np.float32)
    dense[weights.vertex, weights.bone] = weights.value
    return dense


def _candidates(
    dense: npt.NDArray[np.float32], chunk: npt.NDArray[np.intp], order: RefitOrder
) -> tuple[npt.NDArray[np.intp], Flags]:
    """The bones that may take part at each vertex (n,C), own ones first, and which of the places are filled."""
    around = np.zeros_like(dense)
    ends = np.concatenate([order.edges, order.edges[:, ::-1]])
    for bone in np.flatnonzero(dense.any(axis=0)).tolist():
        around[:, bone] = np.bincount(ends[:, 0], weights=dense[ends[:, 1], bone], minlength=len(dense))
    score = dense[chunk] * 1e4 + around[chunk]
    has = score > 0
    near = np.zeros_like(has)
    for bone, parent in enumerate(order.bones.parents.tolist()):
        if parent >= 0:
            near[:, parent] |= has[:, bone]
            near[:, bone] |= has[:, parent]
    used = dense.any(axis=0)
    score += 1e-4 * (near & used)
    score[:, order.locked & ~used] = 0.0
    # What is locked and not the vertex's own cannot be given to it.
    score[:, order.locked] *= dense[chunk][:, order.locked] > 0
    width = min(max(MOST_CANDIDATES, int((dense > 0).sum(axis=1).max(initial=0))), dense.shape[1])
    columns = np.argsort(-score, axis=1, kind="stable")[:, :width]
    return columns, np.take_along_axis(score, columns, axis=1) > 0


def _joined(entries: Sequence[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Floats]]) -> BoneWeights:
    if not entries:
        return BoneWeights.none()
    vertex, bone, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    return BoneWeights(vertex.astype(np.int32), bone.astype(np.int32), value.astype(np.float32))
