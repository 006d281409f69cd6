# SPDX-License-Identifier: GPL-3.0-or-later
"""New weights beside old ones: locks, chosen bones and vertices, mixing, limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from addon.core.character import Target
from addon.core.errors import InputError
from addon.core.merge import Merged, MergeSettings, check_totals, merge_weights

from .conftest import chain, dense, entries, strip

ROWS, BONES = 3, 4
VERTICES = 2 * ROWS
unit = st.floats(0, 1, width=32)


def from_dense(matrix):
    vertex, bone = np.nonzero(matrix)
    return entries(*zip(vertex.tolist(), bone.tolist(), matrix[vertex, bone].tolist(), strict=True))


def target_with(existing, locked):
    return Target("New", "Rig", strip(2, ROWS), chain(*"abcd"), from_dense(existing), np.array(locked, np.bool_))


def bare():
    return target_with(np.zeros((VERTICES, BONES)), [False] * BONES)


def applied(target: Target, merged: Merged) -> np.ndarray:
    """The target's weights (V,B) after writing."""
    weights = dense(target.existing, VERTICES, BONES).astype(np.float32)
    weights[np.ix_(merged.replaced, np.flatnonzero(merged.written))] = 0
    weights[merged.weights.vertex, merged.weights.bone] += merged.weights.value
    return weights


@given(
    new=arrays(np.float32, (VERTICES, BONES), elements=unit),
    existing=arrays(np.float32, (VERTICES, BONES), elements=unit),
    locked=st.lists(st.booleans(), min_size=BONES, max_size=BONES).filter(lambda flags: not all(flags)),
    limit=st.one_of(st.none(), st.integers(1, 5)),
)
def test_totals_limits_and_locks(new, existing, locked, limit):
    new[:, 0] += 0.01
    new /= new.sum(axis=1, keepdims=True)
    target = target_with(existing, locked)
    merged = merge_weights(from_dense(new), target, MergeSettings(max_influences=limit))
    replaced, written = merged.replaced, dense(merged.weights, VERTICES, BONES)
    assert (written[:, locked] == 0).all(), "locked groups are not written"
    assert (written >= 0).all()
    assert replaced.tolist() == list(range(VERTICES))
    kept = np.where(locked, existing, 0).astype(np.float64)
    totals = kept.sum(axis=1) + written.sum(axis=1)
    np.testing.assert_allclose(totals, np.maximum(kept.sum(axis=1), 1), atol=1.5e-6)
    if limit is not None:
        free = np.maximum(limit - (kept > 0).sum(axis=1), 1)
        assert ((written > 0).sum(axis=1) <= free).all()


def test_without_locks_the_weights_stay():
    new = np.array([[0.25, 0.75, 0, 0]] * VERTICES, np.float32)
    merged = merge_weights(from_dense(new), bare(), MergeSettings())
    np.testing.assert_array_equal(dense(merged.weights, VERTICES, BONES), new)


def test_only_vertices_without_weights():
    existing = np.zeros((VERTICES, BONES), np.float32)
    existing[2, 3] = 0.125
    new = np.array([[1, 0, 0, 0]] * VERTICES, np.float32)
    merged = merge_weights(from_dense(new), target_with(existing, [False] * BONES), MergeSettings(replace=False))
    assert merged.replaced.tolist() == [0, 1, 3, 4, 5]
    assert set(merged.weights.vertex.tolist()) == {0, 1, 3, 4, 5}


def test_share_of_a_locked_bone_goes_to_the_nearest_free_one():
    new = np.zeros((VERTICES, BONES), np.float32)
    new[:, 1] = 1
    target = target_with(np.zeros((VERTICES, BONES)), [False, True, False, False])
    merged = merge_weights(from_dense(new), target, MergeSettings())
    # Rows of the strip are at z = 0, 1 and 2; bone a spans 0 to 1, bone c 2 to 3.
    assert dense(merged.weights, VERTICES, BONES).argmax(axis=1).tolist() == [0, 0, 0, 0, 2, 2]


def test_all_locked():
    with pytest.raises(InputError, match="All chosen bone groups of 'New' are locked"):
        merge_weights(entries(), target_with(np.zeros((VERTICES, BONES)), [True] * BONES), MergeSettings())


def test_totals_are_checked():
    check_totals("New", entries((0, 0, 0.5), (0, 1, 0.5), (1, 1, 1.0)), 2)
    with pytest.raises(RuntimeError, match="1 vertex of 'New' got no full weight, the first is vertex 1"):
        check_totals("New", entries((0, 0, 1.0)), 2)
    for value in (np.nan, -0.5, np.inf):
        with pytest.raises(RuntimeError, match="Vertex 1 of 'New' got an impossible weight"):
            check_totals("New", entries((0, 0, 1.0), (1, 0, value)), 2)


def test_target_is_not_changed(target):
    existing = entries((0, 0, 0.5), (1, 1, 0.25))
    locked = replace(target, existing=existing, locked=np.array([True, False, False]))
    before = [array.copy() for array in (existing.vertex, existing.bone, existing.value)]
    merge_weights(entries((0, 1, 1.0)), locked, MergeSettings(mix=0.5, max_influences=1))
    for array, old in zip((existing.vertex, existing.bone, existing.value), before, strict=True):
        np.testing.assert_array_equal(array, old)


flags = arrays(np.bool_, BONES, elements=st.booleans())


@given(
    new=arrays(np.float32, (VERTICES, BONES), elements=unit),
    existing=arrays(np.float32, (VERTICES, BONES), elements=unit),
    locked=flags,
    chosen=flags,
    selected=arrays(np.bool_, VERTICES, elements=st.booleans()),
    settings=st.builds(
        MergeSettings,
        replace=st.booleans(),
        mix=st.sampled_from([0.0, 0.25, 0.5, 1.0]),
        max_influences=st.sampled_from([None, 1, 2, 4]),
        other_groups=st.sampled_from(["keep", "scale"]),
    ),
)
def test_what_is_not_chosen_stays_bit_for_bit(new, existing, locked, chosen, selected, settings):
    new[:, 0] += 0.01
    new /= new.sum(axis=1, keepdims=True)
    existing[existing < 0.05] = 0
    totals = existing.sum(axis=1, keepdims=True)
    existing = np.divide(existing, totals, out=np.zeros_like(existing), where=totals > 0)
    target = replace(target_with(existing, locked), only_bones=chosen, only_vertices=selected)
    before = dense(target.existing, VERTICES, BONES).astype(np.float32)
    if not (chosen & ~locked).any():
        with pytest.raises(InputError):
            merge_weights(from_dense(new), target, settings)
        return
    merged = merge_weights(from_dense(new), target, settings)
    after = applied(target, merged)
    had = before.sum(axis=1) > 0
    same = [*np.flatnonzero(~selected), *np.flatnonzero(had & (not settings.replace or settings.mix == 0))]
    assert (after[same] == before[same]).all()
    assert (after[:, locked] == before[:, locked]).all()
    if settings.other_groups == "keep":
        assert (after[:, ~chosen] == before[:, ~chosen]).all()
    assert (after >= 0).all()
    np.testing.assert_allclose(after[had].sum(axis=1), 1, atol=1e-5)
    assert (after.sum(axis=1) <= 1 + 1e-5).all()
    if (chosen | locked).all():
        np.testing.assert_allclose(after[merged.replaced].sum(axis=1), 1, atol=1e-5)
    if settings.max_influences is not None:
        kept = (after * ~merged.written)[merged.replaced]
        free = np.maximum(settings.max_influences - (kept > 0).sum(axis=1), 1)
        assert (((after * merged.written)[merged.replaced] > 0).sum(axis=1) <= free).all()


def test_one_bone_on_a_bare_target_gets_what_the_source_gives():
    new = np.array([[0.25, 0.75, 0, 0]] * VERTICES, np.float32)
    new[1] = [0, 1, 0, 0]
    only_a = np.array([True, False, False, False])
    target = replace(bare(), only_bones=only_a)
    after = applied(target, merge_weights(from_dense(new), target, MergeSettings()))
    np.testing.assert_array_equal(after[:, 0], [0.25, 0, *[0.25] * (VERTICES - 2)])
    assert after[:, 1:].max() == 0


def test_other_groups_give_way():
    existing = np.array([[0.2, 0.4, 0.4, 0]] * VERTICES, np.float32)
    new = np.array([[0.5, 0, 0, 0.5]] * VERTICES, np.float32)
    target = replace(
        target_with(existing, [False, False, True, False]), only_bones=np.array([True, False, False, False])
    )
    scaled = applied(target, merge_weights(from_dense(new), target, MergeSettings(other_groups="scale")))
    np.testing.assert_allclose(scaled, [[0.5, 0.1, 0.4, 0]] * VERTICES, atol=1e-6)
    kept = applied(target, merge_weights(from_dense(new), target, MergeSettings()))
    np.testing.assert_allclose(kept, existing, atol=1e-7)
    np.testing.assert_array_equal(kept[:, 1:], existing[:, 1:])


@pytest.mark.parametrize("mix", [0.0, 0.25, 1.0])
def test_mix_factor(mix):
    existing = np.array([[0.5, 0.5, 0, 0]] * VERTICES, np.float32)
    existing[3] = 0
    new = np.array([[0, 0, 0.25, 0.75]] * VERTICES, np.float32)
    target = target_with(existing, [False] * BONES)
    after = applied(target, merge_weights(from_dense(new), target, MergeSettings(mix=mix)))
    expected = (1 - mix) * existing + mix * new
    expected[3] = new[3] if mix > 0 else 0  # nothing to mix with
    np.testing.assert_allclose(after, expected, atol=1e-6)
