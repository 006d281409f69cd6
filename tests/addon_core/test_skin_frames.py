# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames from sampled poses: what the solver says, with masks, other keys and other axes between."""

import numpy as np
import pytest

from addon.core.skin import Skin
from addon.core.skin_frames import PoseSample, SkinFrames

from .test_skin import bent, skin, source  # noqa: F401  (fixtures)


@pytest.fixture
def frames(skin: Skin, source) -> SkinFrames:  # noqa: F811
    return SkinFrames("Arm", skin, source.surface.vertices.astype(np.float32))


def test_positions_are_the_solved_skin(frames: SkinFrames) -> None:
    for degrees in (0, 40, 110):
        pose = bent(degrees).astype(np.float32)
        np.testing.assert_allclose(frames.positions(PoseSample(pose)), frames.skin.solved(pose), atol=5e-6)


def test_influence_and_mask_scale_the_offsets(frames: SkinFrames) -> None:
    pose = bent(80).astype(np.float32)
    mask = np.linspace(0, 1, len(frames.rest)).astype(np.float32)
    masked = SkinFrames("Arm", frames.skin, frames.rest, mask=mask)
    sample = PoseSample(pose, influence=0.5)
    wanted = frames.skin.plain(pose, frames.rest + 0.5 * mask[:, None] * frames.offsets(sample))
    np.testing.assert_allclose(masked.positions(sample), wanted, atol=1e-6)
    np.testing.assert_allclose(masked.acting_offsets(sample), 0.5 * mask[:, None] * frames.offsets(sample), atol=1e-7)
    np.testing.assert_array_equal(
        frames.positions(PoseSample(pose, influence=0.0)), frames.skin.plain(pose, frames.rest)
    )


def test_a_hidden_modifier_leaves_the_shape(frames: SkinFrames) -> None:
    key = {"Flex": np.full(frames.rest.shape, 0.1)}
    flexed = SkinFrames("Arm", frames.skin, frames.rest, shape_keys=key)
    sample = PoseSample(bent(80).astype(np.float32), {"Flex": 0.5}, deformed=False)
    np.testing.assert_allclose(flexed.positions(sample), frames.rest + 0.05, atol=1e-6)
    assert not flexed.acting_offsets(sample).any()


def test_offsets_and_positions_agree(frames: SkinFrames) -> None:
    sample = PoseSample(bent(95).astype(np.float32))
    shown = frames.with_offsets(sample, frames.acting_offsets(sample))
    np.testing.assert_allclose(shown, frames.positions(sample), atol=2e-6)


def test_other_axes_of_the_object(frames: SkinFrames) -> None:
    """The same surface in an object that is turned and scaled."""
    to_solver = np.array([[0.0, -2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    to_object = np.linalg.inv(to_solver)
    rest = (frames.rest @ to_object.T).astype(np.float32)
    turned = SkinFrames("Arm", frames.skin, rest, to_solver, to_object)
    sample = PoseSample(bent(70).astype(np.float32))
    np.testing.assert_allclose(turned.positions(sample) @ to_solver.T, frames.positions(sample), atol=1e-5)
    np.testing.assert_allclose(turned.offsets(sample) @ to_solver.T, frames.offsets(sample), atol=1e-5)
