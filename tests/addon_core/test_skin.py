# SPDX-License-Identifier: GPL-3.0-or-later
"""Skins from arrays: their input, their store, and the offsets that undo the Armature modifier."""

from dataclasses import replace

import dermis_native as native
import numpy as np
import pytest

from addon.core.character import Bones, BoneWeights, Surface
from addon.core.errors import InputError
from addon.core.skin import Skin, SkinStore
from addon.core.skin_input import SkinInput, check_finite_pose
from addon.core.skin_settings import ADJUSTABLE, PRESETS, SkinSettings, preset_values

from .conftest import entries

SEGMENTS, RINGS = 12, 17
NO_BONES = Bones((), np.empty((0, 3)), np.empty((0, 3)), np.empty(0, np.int32))


def tube() -> Surface:
    """A capped tube of height 2 and radius 0.4 along z."""
    angle = np.arange(SEGMENTS) * (2 * np.pi / SEGMENTS)
    rings = [
        np.stack([0.4 * np.cos(angle), 0.4 * np.sin(angle), np.full(SEGMENTS, z)], 1) for z in np.linspace(0, 2, RINGS)
    ]
    polygons = [
        (r + i, r + (i + 1) % SEGMENTS, r + SEGMENTS + (i + 1) % SEGMENTS, r + SEGMENTS + i)
        for r in range(0, SEGMENTS * (RINGS - 1), SEGMENTS)
        for i in range(SEGMENTS)
    ]
    polygons += [tuple(range(SEGMENTS))[::-1], tuple(range(SEGMENTS * (RINGS - 1), SEGMENTS * RINGS))]
    return Surface(
        np.concatenate(rings),
        np.array([len(p) for p in polygons], np.int32),
        np.array([v for p in polygons for v in p], np.int32),
    )


@pytest.fixture(scope="module")
def source() -> SkinInput:
    surface = tube()
    share = np.clip((surface.vertices[:, 2] - 0.5), 0, 1).astype(np.float32)
    count = len(share)
    bones = Bones(
        ("a", "b"),
        np.array([[0, 0, 0], [0, 0, 1.0]]),
        np.array([[0, 0, 1.0], [0, 0, 2.0]]),
        np.array([-1, 0], np.int32),
    )
    weights = BoneWeights(
        np.tile(np.arange(count, dtype=np.int32), 2),
        np.repeat(np.array([0, 1], np.int32), count),
        np.concatenate([1 - share, share]),
    )
    return SkinInput("Arm", "Rig", surface, bones, weights, "linear", SkinSettings())


@pytest.fixture(scope="module")
def skin(source):
    return Skin(source)


def bent(degrees: float) -> np.ndarray:
    """The second bone turned about the y axis through its head."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    pose = np.stack([np.eye(4)] * 2)
    pose[1, :3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    pose[1, :3, 3] = [-s, 0, 1 - c]
    return pose


def native_weights(source):
    w = source.weights
    return native.SkinWeights.from_triplets(w.vertex, w.bone, w.value, len(source.surface.vertices), len(source.bones))


def test_skinning_the_offset_vertices_gives_the_solved_skin(source, skin):
    for degrees in (30, 80, 120):
        pose = bent(degrees)
        correction = skin.correction(pose)
        solved = skin.solved(pose)
        plain = native.linear_blend_skinning(source.surface.vertices, native_weights(source), pose)
        assert np.abs(solved - plain).max() > 1e-3
        moved = source.surface.vertices + correction.offsets
        shown = native.linear_blend_skinning(moved, native_weights(source), pose)
        np.testing.assert_allclose(shown, solved, atol=2e-5)
        assert correction.limited == 0


def test_dual_quaternions(source):
    skin = Skin(replace(source, skinning="dual_quaternion"))
    pose = bent(100)
    moved = source.surface.vertices + skin.correction(pose).offsets
    shown = native.dual_quaternion_skinning(moved, native_weights(source), pose)
    np.testing.assert_allclose(shown, skin.solved(pose), atol=2e-5)


def test_shares_and_other_shapes(source, skin):
    pose = bent(80)
    rest = source.surface.vertices * [1.1, 0.9, 1.0]
    shares = np.linspace(0, 1, len(rest), dtype=np.float32)
    correction = skin.correction(pose, rest, shares)
    weights = native_weights(source)

    def masked(points):
        return points + shares[:, None] * (native.linear_blend_skinning(points, weights, pose) - points)

    wanted = rest + shares[:, None] * (skin.solved(pose, rest) - rest)
    np.testing.assert_allclose(masked(rest + correction.offsets), wanted, atol=2e-5)


def test_rest_needs_nothing(skin):
    for rest in (np.stack([np.eye(4)] * 2), np.stack([bent(70)[1]] * 2)):
        assert not skin.correction(rest).offsets.any()


def test_pose_that_is_not_finite(source, skin):
    pose = bent(30)
    pose[1, 0, 0] = np.nan
    with pytest.raises(InputError, match="1 bone has a pose in 'Rig' that is not finite: 'b'"):
        check_finite_pose("Rig", source.bones, pose)
    with pytest.raises(InputError, match="The pose cannot be solved"):
        skin.correction(pose)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"weights": entries()}, "No vertex of 'Arm' has weight"),
        ({"weights": entries((0, 1, 1.0), (1, 1, 0.5))}, "'Arm' follows the single bone 'b'"),
        ({"weights": entries((4, 1, np.nan), (1, 0, 0.5))}, "The weight of vertex 4 of 'Arm' on 'b' is nan"),
        ({"weights": entries((4, 1, -0.5), (1, 0, 0.5))}, "The weight of vertex 4 of 'Arm' on 'b' is -0.5"),
        ({"bones": NO_BONES}, "Armature 'Rig' has no deforming bone"),
        ({"settings": SkinSettings(stiffness=-1.0)}, "'Arm' cannot have a PBD skin: stiffness"),
        ({"settings": SkinSettings(cell_size=1e-6)}, "'Arm' cannot have a PBD skin: "),
    ],
)
def test_bad_input(source, change, match):
    with pytest.raises(InputError, match=match):
        Skin(replace(source, **change))


def test_geometry_key_sees_every_part(source):
    key = source.geometry_key()
    assert key == replace(source, name="Other", settings=SkinSettings(iterations=3)).geometry_key()
    surface, bones, weights = source.surface, source.bones, source.weights
    moved = surface.vertices.copy()
    moved[7, 1] = np.nextafter(moved[7, 1], 9)
    others = [
        replace(source, surface=Surface(moved, surface.loop_counts, surface.loop_indices)),
        replace(source, surface=surface.flipped()),
        replace(source, bones=Bones(bones.names, bones.heads + 1e-6, bones.tails, bones.parents)),
        replace(source, bones=Bones(("a", "c"), bones.heads, bones.tails, bones.parents)),
        replace(source, bones=Bones(bones.names, bones.heads, bones.tails, bones.parents - 1)),
        replace(source, weights=BoneWeights(weights.vertex, weights.bone, weights.value * np.float32(0.5))),
    ]
    keys = [other.geometry_key() for other in others]
    assert len({key, *keys}) == 1 + len(keys)


def test_store_builds_once_and_forgets_the_oldest(source):
    store = SkinStore(spare=2)
    first = store.get("a", source, set())
    assert store.get("a", source, set()) is first
    for key in "bcd":
        store.get(key, source, {"a"})
    assert len(store) == 4, "a is in use, b and c are spare, d is new"
    assert store.get("a", source, {"a"}) is first
    store.get("e", source, set())
    assert store.get("a", source, set()) is first
    store.clear()
    assert len(store) == 0


@pytest.mark.parametrize("preset", PRESETS)
def test_presets(source, preset):
    """The values that a preset shows are those that it solves with."""
    values = preset_values(preset)
    assert tuple(values) == ADJUSTABLE
    pose = bent(90)
    named = Skin(replace(source, settings=SkinSettings(preset))).solved(pose)
    filled = Skin(replace(source, settings=SkinSettings(preset, **values))).solved(pose)
    np.testing.assert_array_equal(named, filled)
