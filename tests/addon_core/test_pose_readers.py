# SPDX-License-Identifier: GPL-3.0-or-later
"""Functions of rotations against scipy's rotations and against their own driver expressions."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from addon.core.pose_readers import (
    Cone,
    Ramp,
    angles_between,
    readers_of,
    rotation_matrices,
    spread_out,
    swing_twist,
)

REST = np.array([1.0, 0.0, 0.0, 0.0])


def scipy_of(rotations: np.ndarray) -> Rotation:
    return Rotation.from_quat(rotations[:, [1, 2, 3, 0]])


@pytest.fixture
def rotations() -> np.ndarray:
    q = np.random.default_rng(0).normal(size=(50, 4))
    return np.array(q / np.linalg.norm(q, axis=1, keepdims=True))


def turned(x: float, y: float, z: float) -> np.ndarray:
    return np.array(Rotation.from_euler("XYZ", [x, y, z], degrees=True).as_quat()[[3, 0, 1, 2]])


def test_matrices_and_angles(rotations: np.ndarray) -> None:
    np.testing.assert_allclose(rotation_matrices(rotations), scipy_of(rotations).as_matrix(), atol=1e-12)
    between = (scipy_of(rotations).inv() * scipy_of(rotations[:1])).magnitude()
    np.testing.assert_allclose(angles_between(rotations, rotations[0]), between, atol=1e-6)


def test_swing_times_twist_is_the_rotation(rotations: np.ndarray) -> None:
    x, y, z = (swing_twist(rotations) / 2).T
    swing = np.stack([np.sin(x), np.zeros_like(x), np.sin(z), np.sqrt(1 - np.sin(x) ** 2 - np.sin(z) ** 2)], 1)
    twist = np.stack([np.zeros_like(y), np.sin(y), np.zeros_like(y), np.cos(y)], 1)
    product = Rotation.from_quat(swing) * Rotation.from_quat(twist)
    assert (product.inv() * scipy_of(rotations)).magnitude().max() < 1e-6


def test_single_axes_are_their_angles() -> None:
    q = np.array([turned(70, 0, 0), turned(0, -110, 0), turned(0, 0, 45), -turned(70, 0, 0)])
    expected = np.radians([[70, 0, 0], [0, -110, 0], [0, 0, 45], [70, 0, 0]])
    np.testing.assert_allclose(swing_twist(q), expected, atol=1e-9)


def evaluated(reader: Ramp | Cone, q: np.ndarray) -> float:
    """The driver's expression in Python, its variables as Blender hands them over."""
    angles = dict(zip("XYZ", swing_twist(q[None])[0], strict=True))
    names = dict(zip("WXYZ", q, strict=True))
    variables = {
        v.name: angles[v.channel[-1]] if v.mode == "SWING_TWIST_Y" else names[v.channel[-1]] for v in reader.variables
    }
    functions = {"min": min, "abs": abs, "acos": math.acos, "clamp": lambda x, a, b: min(max(x, a), b)}
    return float(eval(reader.expression, {"__builtins__": {}}, {**functions, **variables}))


def test_expressions_say_the_same_and_are_short(rotations: np.ndarray) -> None:
    readers = readers_of("forearm.L", rotations)
    assert {type(reader) for reader in readers} == {Ramp, Cone}
    for reader in readers:
        assert len(reader.expression) < 256
        assert [evaluated(reader, q) for q in rotations] == pytest.approx(reader.values(rotations).tolist(), abs=1e-4)


def test_values_are_shares_and_nothing_at_rest(rotations: np.ndarray) -> None:
    for reader in readers_of("bone", rotations):
        values = reader.values(rotations)
        assert values.min() >= 0
        assert values.max() <= 1 + 1e-12
        assert values.max() > 0
        assert reader.values(REST[None])[0] == pytest.approx(0, abs=1e-9)
        assert reader.values(-rotations) == pytest.approx(values, abs=1e-9)


def test_a_hinge_needs_ramps_of_its_axis_alone() -> None:
    hinge = np.array([turned(angle, 0, 0) for angle in range(0, 121, 10)])
    readers = readers_of("bone", hinge)
    assert {reader.axis for reader in readers if isinstance(reader, Ramp)} == {"X"}
    assert all(isinstance(reader, Ramp) for reader in readers)
    assert readers_of("bone", np.array([turned(2, 1, 0)])) == []


def test_spread_out_takes_the_farthest() -> None:
    q = np.array([turned(angle, 0, 0) for angle in (1, 10, 88, 90, -80)])
    assert spread_out(q, 2, 0.1) == [3, 4]
    assert spread_out(q, 9, 0.1) == [3, 4, 1]
    assert spread_out(q[:1], 3, 0.1) == []
