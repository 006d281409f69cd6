# SPDX-License-Identifier: GPL-3.0-or-later
"""Choosing keys: corrections that were made of known keys are found again, with as few."""

import numpy as np
import pytest

from addon.core.corrective_keys import JointSamples, choose_keys
from addon.core.pose_readers import PoseReader, Ramp

VERTICES = 60
BENDS = np.radians(np.linspace(0, 100, 21))


def around_x(angles: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angles / 2), np.sin(angles / 2), 0 * angles, 0 * angles], 1)


@pytest.fixture
def made() -> tuple[JointSamples, list[tuple[int, Ramp, np.ndarray]]]:
    """Two joints that share vertices 20 to 40, whose corrections are three keys, in whole poses and alone."""
    random = np.random.default_rng(1)
    quarter = np.radians(100) / 4
    readers: list[list[PoseReader]] = [
        [Ramp(f"bone{joint}", "X", a * quarter, b * quarter) for a in range(4) for b in range(4, a, -1)]
        for joint in range(2)
    ]
    true = []
    for joint, index, part in ((0, 0, slice(0, 40)), (0, 7, slice(0, 40)), (1, 0, slice(20, 60))):
        shape = np.zeros((VERTICES, 3))
        shape[part] = random.normal(size=(part.stop - part.start, 3))
        reader = readers[joint][index]
        assert isinstance(reader, Ramp)
        true.append((joint, reader, shape))
    whole = [(BENDS[i], BENDS[j]) for i, j in random.integers(0, 21, (40, 2))]
    poses = whole + [(bend, 0.0) for bend in BENDS[5::5]] + [(0.0, bend) for bend in BENDS[5::5]]
    angles = np.array(poses)
    owner = np.array([-1] * 40 + [0] * 4 + [1] * 4, np.int32)
    rotations = [around_x(angles[:, joint]) for joint in range(2)]
    offsets = sum(reader.values(rotations[joint])[:, None, None] * shape for joint, reader, shape in true)
    values = [np.array([reader.values(rotations[joint]) for reader in readers[joint]]) for joint in range(2)]
    return JointSamples(np.asarray(offsets, np.float32), owner, readers, values), true


def test_the_keys_are_found_again(made: tuple) -> None:
    samples, true = made
    chosen = choose_keys(samples, 0.99, 10)
    assert chosen.kept > 0.99
    assert len(chosen.keys) == len(true)
    # Two ramps of a joint may be found as two others that add up to the same.
    for joint in range(2):
        bends = around_x(np.radians(np.linspace(0, 120, 25)))
        wanted = sum(r.values(bends)[:, None, None] * shape for j, r, shape in true if j == joint)
        found = sum(k.reader.values(bends)[:, None, None] * k.offsets for k in chosen.keys if k.joint == joint)
        np.testing.assert_allclose(found, wanted, atol=0.05)


def test_keys_of_a_joint_touch_its_vertices_alone(made: tuple) -> None:
    samples, _ = made
    touched = samples.touched
    np.testing.assert_array_equal(np.flatnonzero(touched[0]), np.arange(40))
    np.testing.assert_array_equal(np.flatnonzero(touched[1]), np.arange(20, 60))
    for key in choose_keys(samples, 0.99, 10).keys:
        assert not key.offsets[~touched[key.joint]].any()


def test_as_few_as_the_share_asks_for(made: tuple) -> None:
    samples, _ = made
    results = [choose_keys(samples, kept, 10) for kept in (0.3, 0.6, 0.99)]
    assert [len(result.keys) for result in results] == sorted({len(result.keys) for result in results})
    for result, kept in zip(results, (0.3, 0.6, 0.99), strict=True):
        assert result.kept >= kept
    assert len(choose_keys(samples, 0.99, 2).keys) == 2


def test_the_kept_share_is_what_the_keys_keep(made: tuple) -> None:
    samples, _ = made
    chosen = choose_keys(samples, 0.6, 10)
    whole = samples.owner < 0
    mixed = np.zeros_like(samples.offsets[whole])
    for key in chosen.keys:
        values = samples.values[key.joint][list(samples.readers[key.joint]).index(key.reader)][whole]
        mixed += values[:, None, None].astype(np.float32) * key.offsets
    wanted = samples.offsets[whole]
    assert chosen.kept == pytest.approx(1 - np.linalg.norm(mixed - wanted) / np.linalg.norm(wanted), abs=1e-4)


def test_the_same_samples_give_the_same_bits(made: tuple) -> None:
    samples, _ = made
    first, second = (choose_keys(samples, 0.9, 10) for _ in range(2))
    assert [key.reader for key in first.keys] == [key.reader for key in second.keys]
    assert all(a.offsets.tobytes() == b.offsets.tobytes() for a, b in zip(first.keys, second.keys, strict=True))


def test_nothing_to_correct(made: tuple) -> None:
    samples, _ = made
    still = JointSamples(np.zeros_like(samples.offsets), samples.owner, samples.readers, samples.values)
    assert choose_keys(still, 0.9, 10).keys == ()
    nothing = JointSamples(samples.offsets, samples.owner, [], [])
    assert choose_keys(nothing, 0.9, 10).keys == ()


def test_stopping() -> None:
    class Stopped(Exception):
        pass

    def stop(_: float) -> None:
        raise Stopped

    readers: list[list[PoseReader]] = [[Ramp("bone", "X", 0.0, 1.0)]]
    offsets = np.ones((2, 4, 3), np.float32)
    offsets[0] = 0
    values = [np.array([[0.0, 1.0]])]
    samples = JointSamples(offsets, np.array([-1, 0], np.int32), readers, values)
    assert choose_keys(samples, 0.9, 5).keys == (), "the whole pose needs none"
    samples = JointSamples(offsets, np.array([0, 0], np.int32), readers, values)
    with pytest.raises(Stopped):
        choose_keys(samples, 0.9, 5, stop)
