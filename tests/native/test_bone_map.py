"""`map_bones` on the rigs of real characters, and retargeting over a bone map."""

from pathlib import Path

import numpy as np
import pytest
from dermis_native import BoneMap, RetargetError, Skeleton, SkinWeights, map_bones, retarget_weights
from surfaces import adult, child, skin

DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"

GAME_TO_MIXAMO = {
    "pelvis": "Hips",
    "spine_02": "Spine1",
    "neck_01": "Neck",
    "clavicle_l": "LeftShoulder",
    "upperarm_r": "RightArm",
    "lowerarm_l": "LeftForeArm",
    "thigh_r": "RightUpLeg",
    "calf_l": "LeftLeg",
    "ball_r": "RightToeBase",
    "thumb_01_l": "LeftHandThumb1",
    "pinky_03_r": "RightHandPinky3",
}
GAME_TO_MAKEHUMAN = {
    "pelvis": ["spine05"],
    "neck_01": ["neck01", "neck02", "neck03"],
    "upperarm_l": ["upperarm01.L", "upperarm02.L"],
    "lowerarm_r": ["lowerarm01.R", "lowerarm02.R"],
    "clavicle_l": ["clavicle.L", "shoulder01.L"],
    "calf_r": ["lowerleg01.R", "lowerleg02.R"],
    "thumb_02_r": ["finger1-2.R"],
    "index_03_l": ["finger2-3.L"],
    "head": ["head"],
}


def shared(name):
    """Skeleton and bone indices of a character of the shared data; skips without it."""
    path = DATA / f"{name}.npz"
    if not path.is_file():
        pytest.skip("the shared characters are not here")
    with np.load(path) as data:
        names = [str(bone) for bone in data["bone_names"]]
        return Skeleton(data["heads"], data["tails"], data["parents"].astype(int), names)


def named_targets(source, target):
    bone_map = map_bones(source, target)
    targets = [[target.names[bone] for bone in bones] for bones in bone_map.targets]
    return dict(zip(source.names, targets, strict=True))


def without_names(skeleton):
    return Skeleton(skeleton.heads, skeleton.tails, skeleton.parents)


def sides_agree(source, target, bone_map):
    for bone, targets in enumerate(bone_map.targets):
        x = source.tails[bone, 0]
        for other in targets:
            assert x * target.tails[other, 0] >= 0 or abs(x) < 0.05, (bone, other)


def test_makehuman_rigs_map_to_each_other():
    game, mixamo = shared("mh_default"), shared("mh_default_rig_mixamo")
    default = shared("mh_default_rig_default")
    to_mixamo = named_targets(game, mixamo)
    assert {bone: to_mixamo[bone] for bone in GAME_TO_MIXAMO} == {
        bone: [f"mixamorig:{other}"] for bone, other in GAME_TO_MIXAMO.items()
    }
    to_default = named_targets(game, default)
    assert {bone: to_default[bone] for bone in GAME_TO_MAKEHUMAN} == GAME_TO_MAKEHUMAN
    from_default = named_targets(default, mixamo)
    assert from_default["lowerarm01.L"] == from_default["lowerarm02.L"] == ["mixamorig:LeftForeArm"]
    assert from_default["finger5-1.R"] == ["mixamorig:RightHandPinky1"]
    face = map_bones(default, mixamo)
    assert face.carriers[default.names.index("oris02")] == default.names.index("head")
    for source in (game, mixamo, default):
        for target in (game, mixamo, default):
            sides_agree(source, target, map_bones(source, target))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("quat_wolf", "quat_husky"),
        ("quat_wolf", "m2m_fox"),
        ("m2m_human_male", "m2m_zombie"),
        ("mh_default", "m2m_zombie"),
        ("mh_default", "cesium_man"),
        ("quat_wolf", "khronos_fox"),
    ],
)
@pytest.mark.parametrize("named", [True, False])
def test_left_stays_left(first, second, named):
    for source, target in ((shared(first), shared(second)), (shared(second), shared(first))):
        if not named:
            source, target = without_names(source), without_names(target)
        bone_map = map_bones(source, target)
        assert any(bone_map.targets)
        sides_agree(source, target, bone_map)


def renamed(skeleton, names):
    return Skeleton(skeleton.heads, skeleton.tails, skeleton.parents, names)


def test_a_body_without_names_is_mapped_by_order():
    _, source, _ = adult(1200)
    _, target, _ = child(1200)
    for names in (None, [f"bone {i}" for i in range(len(target))]):
        bone_map = map_bones(source, renamed(target, names))
        assert bone_map.targets == [[bone] for bone in range(len(source))]
        assert set(bone_map.how) == {"structure"}


def test_other_names_give_the_same_weights():
    source, source_skeleton, weights = adult(1200)
    target, target_skeleton, _ = child(1200)
    plain = retarget_weights(
        source, skin(weights), target, source_skeleton=source_skeleton, target_skeleton=target_skeleton, method="paper"
    )
    swap = {"l": "Left", "r": "Right"}
    parts = {"upperarm": "Arm", "lowerarm": "ForeArm", "thigh": "UpLeg", "calf": "Leg", "clavicle": "Shoulder"}
    names = []
    for name in target_skeleton.names:
        part, _, side = name.rpartition("_")
        names.append(f"mixamorig:{swap[side]}{parts[part]}" if part in parts else name)
    result = retarget_weights(
        source,
        skin(weights),
        target,
        source_skeleton=source_skeleton,
        target_skeleton=renamed(target_skeleton, names),
        method="paper",
    )
    assert np.abs(result.weights.to_dense() - plain.weights.to_dense()).max() < 1e-6


def test_a_split_bone_is_split_along_its_length():
    source, skeleton, weights = adult(1200)
    plain = retarget_weights(
        source, skin(weights), source, source_skeleton=skeleton, target_skeleton=skeleton, method="paper"
    )
    # The forearm in two, and no fingers.
    arm = skeleton.names.index("lowerarm_l")
    kept = [
        b for b, name in enumerate(skeleton.names) if not name.startswith(("thumb", "index", "middle", "ring", "pink"))
    ]
    place = {bone: i for i, bone in enumerate(kept)}
    heads, tails = skeleton.heads[kept], skeleton.tails[kept]
    parents = [place.get(int(skeleton.parents[b]), -1) for b in kept]
    names = [skeleton.names[b] for b in kept]
    middle = 0.5 * (skeleton.heads[arm] + skeleton.tails[arm])
    tails[place[arm]] = middle
    heads = np.concatenate([heads, [middle]])
    tails = np.concatenate([tails, [skeleton.tails[arm]]])
    parents = [len(kept) if parent == place[arm] else parent for parent in parents] + [place[arm]]
    target_skeleton = Skeleton(heads, tails, parents, [*names, "lowerarm_twist_01_l"])
    result = retarget_weights(
        source, skin(weights), source, source_skeleton=skeleton, target_skeleton=target_skeleton, method="paper"
    )
    before, after = plain.weights.to_dense(), result.weights.to_dense()
    assert np.abs(after.sum(axis=1, dtype=float) - 1).max() <= 1e-6
    both = after[:, [place[arm], -1]]
    assert np.abs(both.sum(axis=1) - before[:, arm]).max() < 1e-5
    axis = (skeleton.tails[arm] - skeleton.heads[arm]) / np.linalg.norm(skeleton.tails[arm] - skeleton.heads[arm])
    along = (source.vertices - middle) @ axis
    length = np.linalg.norm(skeleton.tails[arm] - skeleton.heads[arm])
    assert (both[along > 0.21 * length, 0] == 0).all()
    assert (both[along < -0.21 * length, 1] == 0).all()
    hand = [b for b, name in enumerate(skeleton.names) if name == "hand_l" or (b not in kept and name.endswith("_l"))]
    assert np.abs(after[:, place[skeleton.names.index("hand_l")]] - before[:, hand].sum(axis=1)).max() < 1e-5


def test_your_own_map_decides():
    source, skeleton, weights = adult(1200)
    head, neck = skeleton.names.index("head"), skeleton.names.index("neck_01")
    targets = [[bone] for bone in range(len(skeleton))]
    targets[head] = [neck]
    bone_map = BoneMap(skeleton, skeleton, targets)
    assert set(bone_map.how) == {"user"}
    result = retarget_weights(
        source,
        skin(weights),
        source,
        source_skeleton=skeleton,
        target_skeleton=skeleton,
        bone_map=bone_map,
        method="paper",
        max_influences=3,
    )
    dense = result.weights.to_dense()
    assert (dense[:, head] == 0).all()
    assert (np.count_nonzero(dense, axis=1) <= 3).all()


def test_transfer_checks_its_counts():
    _, skeleton, weights = adult(1200)
    bone_map = map_bones(skeleton, skeleton)
    with pytest.raises(ValueError, match="vertices"):
        bone_map.transfer(skin(weights), np.zeros((2, 3)), skeleton)
    with pytest.raises(ValueError, match="53 source bones"):
        bone_map.transfer(SkinWeights.from_dense(np.ones((1, 2))), np.zeros((1, 3)), skeleton)
    aligned = bone_map.aligned_skeleton(skeleton, skeleton)
    assert np.array_equal(aligned.heads, skeleton.heads)
    assert np.array_equal(aligned.tails, skeleton.tails)


def test_skeletons_without_anything_in_common_are_listed_side_by_side():
    heads = np.array([[0.0, 0, 0], [0, 0, 1]])
    ends = heads, np.add(heads, (0, 0, 1)), [-1, 0]
    with pytest.raises(RetargetError, match='source: "hip", "arm"; target: "a", "b"'):
        BoneMap(Skeleton(*ends, ["hip", "arm"]), Skeleton(*ends, ["a", "b"]), [[], []])
