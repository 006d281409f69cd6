# SPDX-License-Identifier: GPL-3.0-or-later
"""Refits to skins that plain weights can follow exactly: the weights are found."""

from dataclasses import dataclass

import dermis_native as native
import numpy as np
import pytest

from addon.core.character import Bones, BoneWeights
from addon.core.refit_task import RefitOrder, RefitTask
from addon.core.skin_frames import PoseSample, SkinFrames

from .conftest import dense, strip

BONES, ROWS = 4, 30


@dataclass(frozen=True)
class WrongWeights(SkinFrames):
    """Shows other weights than the mesh has, as if that were its skin."""

    true: np.ndarray | None = None
    old: np.ndarray | None = None

    def positions(self, sample: PoseSample) -> np.ndarray:
        weights = self.true if sample.influence else self.old
        assert weights is not None
        shape = self.rest if self.mixed(sample) is None else self.mixed(sample)
        return native.linear_blend_skinning(shape, native.SkinWeights.from_dense(weights), sample.transforms)


@pytest.fixture
def order() -> RefitOrder:
    random = np.random.default_rng(0)
    surface = strip(3, ROWS)
    rest = (surface.vertices + 0.2 * random.normal(size=surface.vertices.shape)).astype(np.float32)
    true = random.dirichlet(np.full(BONES, 0.5), size=len(rest))
    true[true < 0.05] = 0
    true /= true.sum(axis=1, keepdims=True)
    old = random.dirichlet(np.ones(BONES), size=len(rest))
    transforms = np.tile(np.eye(4), (15, BONES, 1, 1))
    turns, _ = np.linalg.qr(random.normal(size=(15, BONES, 3, 3)))
    transforms[:, :, :3, :3] = turns * np.linalg.det(turns)[..., None, None]
    transforms[:, :, :3, 3] = random.normal(size=(15, BONES, 3))
    vertex, bone = np.nonzero(old > 0)
    pairs = np.array(
        [(2 * i, 2 * i + 2) for i in range(ROWS - 1)] + [(2 * i, 2 * i + 1) for i in range(ROWS)], np.int32
    )
    return RefitOrder(
        frames=WrongWeights("Arm", None, rest, true=true, old=old),  # type: ignore[arg-type]
        samples=[PoseSample(t.astype(np.float32)) for t in transforms],
        weights=BoneWeights(vertex.astype(np.int32), bone.astype(np.int32), old[vertex, bone].astype(np.float32)),
        bones=Bones(tuple("abcd"), np.zeros((4, 3)), np.ones((4, 3)), np.array([-1, 0, 1, 2], np.int32)),
        locked=np.zeros(BONES, np.bool_),
        edges=np.array(pairs, np.int32),
    )


def run(order: RefitOrder, limit: int):
    task = RefitTask([order], limit)
    task.run(lambda _: None)
    return task.result()[0]


def test_weights_that_reproduce_the_skin_are_found(order: RefitOrder) -> None:
    refit = run(order, 4)
    assert refit.kept > 0.999
    assert refit.largest < 0.01 * refit.before
    found = dense(refit.weights, len(order.frames.rest), BONES)
    np.testing.assert_allclose(found, order.frames.true, atol=2e-3)  # type: ignore[attr-defined]
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-6)


def test_limit_and_locks_hold(order: RefitOrder) -> None:
    order.locked[2] = True
    before = dense(order.weights, len(order.frames.rest), BONES)
    refit = run(order, 3)
    found = dense(refit.weights, len(order.frames.rest), BONES)
    assert ((found > 0).sum(axis=1) <= 3).all()
    np.testing.assert_array_equal(found[refit.changed, 2], before[refit.changed, 2])
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-6)
    assert 0.1 < refit.kept < 0.95


def test_other_shape_keys_that_act(order: RefitOrder) -> None:
    frames = order.frames
    assert isinstance(frames, WrongWeights)
    bulge = 0.3 * np.random.default_rng(5).normal(size=frames.rest.shape)
    bulged = WrongWeights(
        "Arm", frames.skin, frames.rest, shape_keys={"Bulge": bulge}, true=frames.true, old=frames.old
    )
    samples = [PoseSample(s.transforms, {"Bulge": 0.1 * i}) for i, s in enumerate(order.samples)]
    moved = RefitOrder(bulged, samples, order.weights, order.bones, order.locked, order.edges)
    assert run(moved, 4).kept > 0.999


def test_vertices_that_need_nothing_are_left_alone(order: RefitOrder) -> None:
    frames = order.frames
    assert isinstance(frames, WrongWeights)
    assert frames.true is not None
    assert frames.old is not None
    frames.true[10:] = frames.old[10:]
    assert set(run(order, 4).changed.tolist()) <= set(range(10))
