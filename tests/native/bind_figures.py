"""Bodies to bind, and what a bind is judged by beside the distance from the artist's weights."""

import characters
import makehuman
import numpy as np
from dermis_native import SkinWeights, linear_blend_skinning

BODIES = {
    "young man": makehuman.YOUNG_MALE,
    "child": makehuman.CHILD,
    "heavy man": makehuman.HEAVY,
    "old woman": makehuman.OLD_WOMAN,
    "baby": characters.BABY,
    "thin and tall": characters.THIN_AND_TALL,
    "strong": {"gender": 1.0, "muscle": 1.0, "height": 0.8},
    "heavy woman": {"gender": 0.0, "age": 0.6, "weight": 1.0, "height": 0.3},
    "long legs": {"gender": 0.2, "proportions": 1.0, "height": 0.7},
    "short": {"gender": 0.7, "proportions": 0.0, "height": 0.1, "weight": 0.7},
}


def character(name, triangles=8000):
    return characters.remeshed(characters.body(name, **BODIES[name]), triangles)


def on_the_other_side(it, weights):
    """Share of all weight that bones of one side have on vertices of the other."""
    sides = np.array([characters.side_of(name) for name in it.bone_names])
    margin = 0.01 * characters.extent(it)
    x = it.vertices[:, 0]
    return (weights[x > margin][:, sides < 0].sum() + weights[x < -margin][:, sides > 0].sum()) / len(weights)


def stretched_edges(it, weights):
    """Share of edges longer than twice their rest length, over random poses."""
    edges = np.unique(np.sort(it.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    length = lambda points: np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)  # noqa: E731
    skin = SkinWeights.from_dense(weights)
    poses = [linear_blend_skinning(it.vertices, skin, transforms) for transforms in characters.random_poses(it)]
    return np.mean([(length(pose) > 2 * length(it.vertices)).mean() for pose in poses])
