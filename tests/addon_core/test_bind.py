# SPDX-License-Identifier: GPL-3.0-or-later
"""Binding several meshes as one body, fitted into what they have."""

from dataclasses import replace

import numpy as np
import pytest
from dermis_native import Cancelled

from addon.core.bind import BindSettings, BindTask, bind_line, bind_notes, joined_surface
from addon.core.character import Bones, BoneWeights, Surface, Target
from addon.core.errors import InputError
from addon.core.merge import MergeSettings

BONES = Bones(
    ("lower", "upper", "far"),
    np.array([[0.0, 0, 0], [0, 0, 1], [0, 0, 9]]),
    np.array([[0.0, 0, 1], [0, 0, 2], [0, 0, 10]]),
    np.array([-1, 0, 1], np.int32),
)


def prism(low=0.0, high=2.0, radius=0.3, rings=9):
    """A closed prism around the bones."""
    angles = np.arange(8) * (np.pi / 4)
    circle = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.array([(x, y, z) for z in np.linspace(low, high, rings) for x, y in circle])
    quads = [
        (8 * r + i, 8 * r + (i + 1) % 8, 8 * r + 8 + (i + 1) % 8, 8 * r + 8 + i)
        for r in range(rings - 1)
        for i in range(8)
    ]
    corners = np.concatenate([np.ravel(quads), np.arange(8)[::-1], 8 * (rings - 1) + np.arange(8)])
    counts = np.array([4] * len(quads) + [8, 8], np.int32)
    return Surface(vertices, counts, corners.astype(np.int32))


def target(name="Tube", surface=None):
    return Target(name, "Rig", surface or prism(), BONES, BoneWeights.none(), np.zeros(3, bool))


def bound(*targets, **options):
    return BindTask(targets, BindSettings(**options)).work()


def test_every_vertex_of_every_mesh_has_weights():
    targets = [target(), target("Collar", prism(0.7, 1.3, 0.32, 5))]
    for together in (True, False):
        results = bound(*targets, together=together)
        for each, result in zip(targets, results, strict=True):
            np.testing.assert_allclose(result.weights.totals(len(each.surface.vertices)), 1, atol=1e-6)
            assert result.groups == (0, 1, 2)
        assert "'Tube', 'Collar' bound to 'Rig': 112 vertices, 2 bones" in bind_line(targets, results, 0.5)
        assert bind_notes(targets, results) == ["1 bone moved no vertex: 'far'."]


def test_surfaces_are_joined_in_order():
    first, second = prism(), prism(3.0, 4.0)
    both = joined_surface([first, second])
    assert (both.vertices[len(first.vertices) :] == second.vertices).all()
    assert (both.loop_indices[len(first.loop_indices) :] == second.loop_indices + len(first.vertices)).all()
    assert both.loop_counts.sum() == len(both.loop_indices)


def test_locks_and_limits():
    locked = np.array([False, True, False])
    existing = BoneWeights(np.array([3], np.int32), np.array([1], np.int32), np.array([0.25], np.float32))
    held = replace(target(), locked=locked, existing=existing)
    [result] = bound(held)
    assert not (result.weights.bone == 1).any()
    assert result.weights.totals(72)[3] == pytest.approx(0.75)
    [result] = bound(target(), merge=MergeSettings(max_influences=1))
    assert np.bincount(result.weights.vertex).max() == 1


def test_bad_input_is_named():
    with pytest.raises(InputError, match="All bone groups of 'Tube' are locked"):
        bound(replace(target(), locked=np.ones(3, bool)))
    with pytest.raises(InputError, match="All chosen bone groups of 'Tube' are locked"):
        bound(replace(target(), locked=np.array([True, False, False]), only_bones=np.array([True, False, False])))
    with pytest.raises(InputError, match="No vertex of 'Tube' is selected"):
        bound(replace(target(), only_vertices=np.zeros(72, bool)))
    with pytest.raises(InputError, match="'Tube' has 72 vertices and no faces"):
        bound(target(surface=Surface(prism().vertices, np.zeros(0, np.int32), np.zeros(0, np.int32))))


def test_cancelling():
    task = BindTask([target()], BindSettings())
    task.cancel()
    task.start()
    with pytest.raises(Cancelled):
        task.result()
