# SPDX-License-Identifier: GPL-3.0-or-later
"""Locked vertex groups stay as they are, and totals stay 1."""

import characters as c
import numpy as np
import pytest


def locked_target(values):
    """A target whose group `middle` is locked with these weights at its first vertices."""
    target = c.target_tube()
    target.vertex_groups.new(name="Other").add([3], 0.5, "REPLACE")
    group = target.vertex_groups.new(name="middle")
    for vertex, value in enumerate(values):
        group.add([vertex], value, "REPLACE")
    group.lock_weight = True
    return target


def entries(ob, name):
    index = ob.vertex_groups[name].index
    return [(v.index, e.weight) for v in ob.data.vertices for e in v.groups if e.group == index]


def test_locked_group_is_kept_bit_for_bit():
    source, rig = c.source_tube()
    target = locked_target([0.1, 0.7, 1 / 3, 0.0, 1.0])
    before = entries(target, "middle")
    assert c.retarget(source, target) == {"FINISHED"}
    assert entries(target, "middle") == before
    assert target.vertex_groups["middle"].lock_weight
    weights = c.dense(target, c.bone_names(rig))
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert weights[4].tolist() == [0, 1, 0]


def test_vertices_whose_bone_is_locked_go_to_the_nearest_free_bone():
    source, rig = c.source_tube()
    target = locked_target([])
    c.retarget(source, target)
    weights = c.dense(target, c.bone_names(rig))
    heights = np.array([v.co.z for v in target.data.vertices])
    assert weights[:, 1].max() == 0
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert (weights[heights < 1.3, 0] > 0.5).all()
    assert (weights[heights > 1.7, 2] > 0.5).all()


def test_limit_counts_locked_weights():
    source, rig = c.source_tube()
    target = locked_target([0.4] * 30)
    c.retarget(source, target, max_influences=2)
    weights = c.dense(target, c.bone_names(rig))
    assert (weights > 0).sum(axis=1).max() == 2
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)


def test_all_groups_locked():
    source, rig = c.source_tube()
    target = c.target_tube()
    for name in c.bone_names(rig):
        target.vertex_groups.new(name=name).lock_weight = True
    c.activate(source, target)
    before = c.state(target)
    with pytest.raises(RuntimeError, match=r"All bone groups of 'Target' are locked\. Nothing was changed\."):
        c.retarget(source, target)
    assert c.state(target) == before
