# SPDX-License-Identifier: GPL-3.0-or-later
"""Small characters as arrays."""

import numpy as np
import pytest

from addon.core.character import Bones, BoneWeights, Source, Surface, Target


def strip(height: float, rows: int) -> Surface:
    """A flat strip of quads along z, two vertices in each row."""
    z = np.linspace(0, height, rows)
    vertices = np.stack([np.tile([0.0, 1.0], rows), np.zeros(2 * rows), np.repeat(z, 2)], axis=1)
    corners = [(2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(rows - 1)]
    return Surface(vertices, np.full(rows - 1, 4, np.int32), np.array(corners, np.int32).ravel())


def chain(*names: str) -> Bones:
    """Bones of length 1 on top of each other."""
    heads = np.array([[0.5, 0, i] for i in range(len(names))], np.float64)
    return Bones(names, heads, np.add(heads, (0, 0, 1)), np.arange(-1, len(names) - 1, dtype=np.int32))


def entries(*triples: tuple[int, int, float]) -> BoneWeights:
    vertex, bone, value = zip(*triples, strict=True) if triples else ((), (), ())
    return BoneWeights(np.array(vertex, np.int32), np.array(bone, np.int32), np.array(value, np.float32))


def dense(weights: BoneWeights, vertices: int, bones: int) -> np.ndarray:
    matrix = np.zeros((vertices, bones))
    np.add.at(matrix, (weights.vertex, weights.bone), weights.value)
    return matrix


@pytest.fixture
def source() -> Source:
    surface = strip(3, 9)
    z = surface.vertices[:, 2]
    bone = np.minimum(z, 2.999).astype(np.int32)
    weights = BoneWeights(np.arange(18, dtype=np.int32), bone, np.ones(18, np.float32))
    return Source("Old", "OldRig", surface, chain("a", "b", "c"), weights)


@pytest.fixture
def target() -> Target:
    return Target("New", "NewRig", strip(3, 8), chain("a", "b", "c"), entries(), np.zeros(3, np.bool_))
