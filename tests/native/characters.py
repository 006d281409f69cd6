"""Pairs of characters to retarget between, and how good weights are against the target's own.

Everything is a `makehuman.Character`. The bodies that MakeHuman's data makes are always there; the
others come from a folder of characters beside the checkout and are left out where it is missing.
"""

import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import makehuman
import numpy as np
from bad_characters import subdivided
from deformation import turned
from dermis_native import Skeleton, SkinWeights, TriangleMesh, linear_blend_skinning

SHARED = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"

TRIANGLES = 12_000  # of a decimated target
LARGE_TRIANGLES = 200_000
POSES = 12
POSE_DEGREES = 25.0  # standard deviation of a bone's turn in a random pose
JOINT_ERROR = 0.01  # of the height

BABY = {"age": 0.02}
THIN_AND_TALL = {"gender": 0.6, "weight": 0.0, "height": 0.95, "muscle": 0.3}

# Turns in degrees about x (to the left), y (to the back) and z (up): another rest pose than MakeHuman's.
REST_POSE = {
    "upperarm_l": (0, -38, 0),
    "upperarm_r": (0, 38, 0),
    "lowerarm_l": (0, 0, 35),
    "lowerarm_r": (0, 0, -35),
    "hand_l": (12, 0, 0),
    "hand_r": (12, 0, 0),
    "thigh_l": (-20, -14, 0),
    "thigh_r": (-8, 14, 0),
    "calf_l": (32, 0, 0),
    "calf_r": (18, 0, 0),
    "spine_02": (6, 0, 5),
    "head": (-8, 0, 10),
}


@dataclass(frozen=True)
class Pair:
    """Source, target with its true weights, and the character whose skeleton a method is given.

    `worn` says that the target is a garment on the source.
    """

    source: makehuman.Character
    target: makehuman.Character
    given: makehuman.Character
    worn: bool = False


def mesh_of(character):
    return TriangleMesh.from_polygons(character.vertices, character.loop_counts, character.loop_indices)


def skeleton_of(character):
    return Skeleton(character.heads, character.tails, character.parents, list(character.bone_names))


def weights_of(character):
    return SkinWeights.from_dense(np.asarray(character.weights, np.float64))


def extent(character):
    """Longest side of the bounding box: the height of whoever stands upright."""
    return float(np.ptp(character.vertices, axis=0).max())


def remeshed(character, triangles=TRIANGLES, seed=1):
    """The same body decimated where it has more triangles, its vertices in another order."""
    if len(character.triangles) > triangles:
        character = makehuman.decimated(character, triangles)
    return makehuman.permuted(character, seed)


def refined(character, triangles):
    """The same body with more triangles: every one cut in four, then decimated to the number."""
    vertices, faces = character.vertices, character.triangles
    while len(faces) <= triangles:
        vertices, faces = subdivided(vertices, faces)
    fine = replace(
        character,
        vertices=vertices,
        loop_counts=np.full(len(faces), 3, dtype=np.int64),
        loop_indices=np.ascontiguousarray(faces.ravel(), dtype=np.int64),
        weights=makehuman.interpolated_weights(character, vertices),
    )
    return makehuman.decimated(fine, triangles)


def posed(character, degrees=REST_POSE):
    """The character with another rest pose."""
    skeleton = skeleton_of(character)
    transforms = turned(skeleton, {bone: np.radians(turns) for bone, turns in degrees.items()})
    vertices = linear_blend_skinning(character.vertices, weights_of(character), transforms).astype(np.float64)
    carry = lambda points: np.einsum("bij,bj->bi", transforms[:, :3, :3], points) + transforms[:, :3, 3]  # noqa: E731
    return replace(character, vertices=vertices, heads=carry(character.heads), tails=carry(character.tails))


def with_joint_errors(character, share=JOINT_ERROR, seed=0):
    """The character with every joint moved in a random direction by a share of its height."""
    points = np.concatenate([character.heads, character.tails])
    _, joint = np.unique(points.round(6), axis=0, return_inverse=True)
    steps = np.random.default_rng(seed).normal(size=(joint.max() + 1, 3))
    steps *= share * extent(character) / np.linalg.norm(steps, axis=1, keepdims=True)
    moved = points + steps[joint.ravel()]
    return replace(character, heads=moved[: len(character.heads)], tails=moved[len(character.heads) :])


@cache
def body(name, **macro):
    return makehuman.body(name, **macro)


def random_body(seed):
    """A body of any age from a child's on, its other macro values drawn at random too."""
    random = np.random.default_rng(1000 + seed)
    values = {key: round(float(random.uniform(0.2 if key == "age" else 0.0, 1.0)), 3) for key in makehuman.DEFAULTS}
    return body(f"random {seed}", **values)


@cache
def shared(name):
    """A character of the folder beside the checkout."""
    with np.load(SHARED / f"{name}.npz") as data:
        vertices, bones = data["verts"].astype(np.float64), len(data["bone_names"])
        weights = np.zeros((len(vertices), bones))
        np.add.at(weights, (data["w_vert"], data["w_bone"]), data["w_val"])
        return makehuman.Character(
            name=name,
            vertices=vertices,
            loop_counts=data["loop_counts"].astype(np.int64),
            loop_indices=data["loop_indices"].astype(np.int64),
            heads=data["heads"].astype(np.float64),
            tails=data["tails"].astype(np.float64),
            rolls=np.zeros(bones),
            parents=data["parents"].astype(np.int64),
            bone_names=tuple(str(bone) for bone in data["bone_names"]),
            weights=(weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)).astype(np.float32),
        )


def _male():
    return body("male", **makehuman.YOUNG_MALE)


def _to(target, given=None) -> Callable[[], Pair]:
    def make():
        true = target()
        return Pair(_male(), true, true if given is None else given(true))

    return make


def _between(source, target, worn=False) -> Callable[[], Pair]:
    def make():
        true = remeshed(shared(target))
        return Pair(shared(source), true, true, worn)

    return make


def makehuman_pairs():
    """Pairs by name that need nothing but MakeHuman's data; the source is a young man."""
    macros = {
        "same": makehuman.YOUNG_MALE,
        "child": makehuman.CHILD,
        "heavy": makehuman.HEAVY,
        "baby": BABY,
        "thin_tall": THIN_AND_TALL,
        "old_woman": makehuman.OLD_WOMAN,
    }
    pairs = {name: _to(lambda n=name, m=macro: remeshed(body(n, **m))) for name, macro in macros.items()}
    for name in ("same", "heavy", "child", "baby"):
        pairs[f"{name}_posed"] = _to(lambda n=name: posed(remeshed(body(n, **macros[n]))))
    pairs["child_joints"] = _to(lambda: remeshed(body("child", **makehuman.CHILD)), with_joint_errors)
    for seed in range(6):
        pairs[f"random_{seed}"] = _to(lambda s=seed: remeshed(random_body(s)))
    return pairs


def shared_pairs():
    """Pairs by name of the characters beside the checkout; empty without them."""
    if not SHARED.is_dir():
        return {}
    animals = {"wolf": "quat_wolf", "husky": "quat_husky"}
    humans = {"male": "m2m_human_male", "zombie": "m2m_zombie"}
    bodies = {"default": "mh_default", "child": "mh_child", "heavy": "mh_heavy"}
    others = {"dec6k": "mh_child_dec6k", "male1591": "mh_default_male1591"}
    garments = {"tights": "mh_default_tights", "casualsuit": "mh_heavy_casualsuit04"}
    rigs = {"mixamo": "mh_default_rig_mixamo", "default": "mh_default_rig_default", "game": "mh_default"}
    pairs = {}
    for family, targets in (
        (animals, animals),
        ({"wolf": "quat_wolf"}, {"trex": "quat_trex"}),
        (humans, humans),
        ({name: bodies[name] for name in ("default", "heavy")}, garments),
        (bodies, bodies | others),
        (rigs, rigs),
    ):
        for source, target in itertools.product(family, targets):
            if family[source] != targets[target]:
                worn = (source, target) in (("default", "tights"), ("heavy", "casualsuit"))
                pairs[f"{source}_{target}"] = _between(family[source], targets[target], worn)
    return pairs


def large_pairs():
    """Pairs by name of 100,000 vertices on either side."""

    def make():
        source, target = (
            refined(body(name, **macro), LARGE_TRIANGLES)
            for name, macro in (("male", makehuman.YOUNG_MALE), ("child", makehuman.CHILD))
        )
        target = makehuman.permuted(target, 1)
        return Pair(source, target, target)

    return {"child_100k": make}


def pairs():
    """All pairs that can be made here, by name."""
    return makehuman_pairs() | shared_pairs() | large_pairs()


def random_poses(character, count=POSES, seed=7):
    """Transforms (count,B,4,4): every bone turned at random about its head."""
    random = np.random.default_rng(seed)
    skeleton = skeleton_of(character)
    turns = np.radians(POSE_DEGREES / np.sqrt(3)) * random.normal(size=(count, len(skeleton), 3))
    return np.array([turned(skeleton, dict(enumerate(pose))) for pose in turns])


def l1_error(weights, truth):
    """(V,) sum of the differences of a vertex's weights from the true ones, 0 to 2."""
    return np.abs(weights - truth).sum(axis=1)


def pose_error(character, weights):
    """Root mean square distance from the truly skinned surface over random poses, relative to the extent."""
    weights = SkinWeights.from_dense(np.asarray(weights, np.float64))
    true = weights_of(character)
    squares = []
    for transforms in random_poses(character):
        surfaces = [linear_blend_skinning(character.vertices, w, transforms) for w in (weights, true)]
        squares.append(((surfaces[0] - surfaces[1]) ** 2).sum(axis=1).mean())
    return float(np.sqrt(np.mean(squares)) / extent(character))


FINGERS = ("thumb", "index", "middle", "ring", "pinky|little")


def side_of(name):
    """1 for a bone on the left, -1 on the right, 0 for others, by its name."""
    words = re.sub(r"([a-z])([A-Z])", r"\1 \2", name).replace(":", " ")
    words = set(re.split(r"[\W_]+", words.lower()))
    return int(bool(words & {"l", "left"})) - int(bool(words & {"r", "right"}))


def finger_of(name):
    """0 (thumb) to 4 for a bone of a finger, -1 for others, by its name."""
    numbered = re.match(r"finger(\d)-", name)
    if numbered:
        return int(numbered[1]) - 1
    found = [i for i, words in enumerate(FINGERS) if re.search(words, name.lower())]
    return found[0] if found else -1


def misplaced(character, weights):
    """(V,) whether the largest weight lies on the other side's limb or another finger than in truth."""
    sides = np.array([side_of(name) for name in character.bone_names])
    fingers = np.array([finger_of(name) for name in character.bone_names])
    found, true = weights.argmax(axis=1), character.weights.argmax(axis=1)
    other_side = sides[found] * sides[true] < 0
    other_finger = (fingers[found] >= 0) & (fingers[true] >= 0) & (fingers[found] != fingers[true])
    return other_side | other_finger
