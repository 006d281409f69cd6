# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses of one joint and of several at once, and keys for a whole skin without Blender."""

import numpy as np
import pytest
from dermis_native import Cancelled

from addon.core.driven_keys_task import DrivenKeysOrder, DrivenKeysTask, Joint, mixed_rotations, range_of_motion
from addon.core.errors import InputError
from addon.core.pose_readers import angles_between, swing_twist
from addon.core.skin_frames import PoseSample, SkinFrames

from .test_skin import bent, skin, source  # noqa: F401  (fixtures)

REST = np.array([1.0, 0.0, 0.0, 0.0])
NONE = np.empty((0, 4))


def hinge(rotations: np.ndarray, more: np.ndarray = NONE) -> Joint:
    """The second bone of the tube, whose own axes are the world's."""
    rest = np.eye(4)
    rest[2, 3] = 1.0
    return Joint("b", np.array([False, True]), rest, rotations, more)


def around_y(degrees: float) -> np.ndarray:
    half = np.radians(degrees) / 2
    return np.array([np.cos(half), 0.0, np.sin(half), 0.0])


def test_a_joint_alone_is_the_bent_bone() -> None:
    turned = hinge(NONE).alone(np.array([around_y(70), REST]), 2)
    np.testing.assert_allclose(turned[0], bent(70), atol=1e-12)
    np.testing.assert_allclose(turned[1], np.tile(np.eye(4), (2, 1, 1)), atol=1e-12)


def test_range_of_motion() -> None:
    angles = np.degrees(swing_twist(range_of_motion(np.radians(60), 3)))
    assert sorted(np.unique(angles[:, 0].round(3))) == pytest.approx([-60, -40, -20, 0, 20, 40, 60], abs=1e-3)
    assert sorted(np.unique(angles[:, 1].round(3))) == pytest.approx([-30, -20, -10, 0, 10, 20, 30], abs=1e-3)
    assert (np.count_nonzero(np.abs(angles) > 1e-6, axis=1) == 1).all()


def test_mixed_poses_stay_in_the_range_and_are_the_same_each_time() -> None:
    joints = [hinge(NONE, range_of_motion(np.radians(60))), hinge(NONE), hinge(NONE, range_of_motion(0.2))]
    mixed = mixed_rotations(joints)
    assert mixed.shape[0] == 3
    np.testing.assert_array_equal(mixed, mixed_rotations(joints))
    assert np.degrees(angles_between(mixed[0], REST)).max() <= 60 + 1e-9
    assert 0.2 < (angles_between(mixed[0], REST) > 1e-6).mean() < 0.8
    np.testing.assert_allclose(mixed[1], np.tile(REST, (mixed.shape[1], 1)))
    assert mixed_rotations([hinge(NONE)]).shape == (1, 0, 4)


@pytest.fixture
def order(skin, source) -> DrivenKeysOrder:  # noqa: F811
    frames = SkinFrames("Arm", skin, source.surface.vertices.astype(np.float32))
    degrees = np.linspace(0, 100, 12)
    samples = [PoseSample(bent(angle).astype(np.float32)) for angle in degrees]
    return DrivenKeysOrder(frames, samples, [hinge(np.array([around_y(angle) for angle in degrees]))], 50)


def test_keys_of_a_skin(order: DrivenKeysOrder) -> None:
    task = DrivenKeysTask([order], 0.9, 20)
    task.run(lambda _: None)
    (found,) = task.result()
    assert found.kept >= 0.88
    assert 0 < found.largest < found.before
    assert 0 < len(found.keys) < 10
    assert all(len(values) == 12 and values[0] == 0 for values in found.values)
    # The keys at their values add up to what the report says.
    left, whole = 0.0, 0.0
    for index, sample in enumerate(order.samples):
        mixed = sum(values[index] * key.offsets for key, values in zip(found.keys, found.values, strict=True))
        wanted = order.frames.positions(sample)
        left += np.square(order.frames.with_offsets(sample, np.asarray(mixed)) - wanted).sum()
        whole += np.square(order.frames.skin.plain(sample.transforms) - wanted).sum()
    assert found.kept == pytest.approx(1 - np.sqrt(left / whole), abs=1e-3)


def test_cancelling_and_too_much(order: DrivenKeysOrder, monkeypatch: pytest.MonkeyPatch) -> None:
    task = DrivenKeysTask([order], 0.9, 20)
    task.cancel()
    task.start()
    with pytest.raises(Cancelled):
        task.result()
    monkeypatch.setattr("addon.core.driven_keys_task.MOST_BYTES", 1000)
    task = DrivenKeysTask([order], 0.9, 20)
    task.start()
    with pytest.raises(InputError, match="ask for fewer poses"):
        task.result()
