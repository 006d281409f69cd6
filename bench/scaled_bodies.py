"""One rigged body at any resolution, and a generated figure that needs no data at all."""

import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from dermis_native import Skeleton, SkinWeights, TriangleMesh

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "demo"), str(ROOT / "tests" / "native")]

import makehuman  # noqa: E402
from deformation import turned  # noqa: E402

# Joints that move in a frame, and how far they turn about which axis of the world.
MOTION = {
    "upperarm_l": (0, 0, 40), "lowerarm_l": (0, 60, 30), "upperarm_r": (0, 0, -30), "lowerarm_r": (0, -50, 0),
    "thigh_l": (-50, 0, 0), "calf_l": (80, 0, 0), "thigh_r": (40, 0, 0), "calf_r": (60, 0, 0),
    "spine_01": (10, 0, 0), "spine_02": (0, 0, 10), "head": (0, 0, 20),
}  # fmt: skip


class Rigged:
    """Mesh, skeleton and weights for `PbdSkin`, with vertices (V,3), triangles (F,3) and sparse weights (V,B)."""

    def __init__(self, vertices, triangles, weights, heads, tails, parents, names):
        self.vertices, self.triangles, self.sparse = vertices, triangles, weights.tocsr()
        self.mesh = TriangleMesh(vertices, triangles)
        self.skeleton = Skeleton(heads, tails, parents, list(names))
        entries = self.sparse.tocoo()
        self.weights = SkinWeights.from_triplets(
            entries.row, entries.col, entries.data, len(vertices), entries.shape[1]
        )

    @property
    def size(self):
        """Number of vertices."""
        return len(self.vertices)

    @property
    def height(self):
        """Largest extent."""
        return float(np.ptp(self.vertices, axis=0).max())

    def rest(self):
        """Transforms of the rest pose."""
        return np.tile(np.eye(4), (len(self.skeleton.names), 1, 1))

    def pose(self, turns):
        """Transforms with bones turned by degrees (x, y, z) about the axes of the world."""
        return turned(self.skeleton, {bone: np.radians(np.asarray(turn, float)) for bone, turn in turns.items()})


def makehuman_body(vertex_count=None, levels=0):
    """A MakeHuman body of about `vertex_count` vertices, or else subdivided so often."""
    character = makehuman.body("average")
    if vertex_count is not None:
        if vertex_count > len(character.vertices):
            character = makehuman.subdivided(character)
        if vertex_count < len(character.vertices):
            character = makehuman.decimated(character, 2 * vertex_count)
    vertices, triangles = character.vertices, character.triangles.astype(np.int64)
    weights = sp.csr_matrix(character.weights.astype(float))
    for _ in range(levels):
        edges, triangles = makehuman.cut_in_four(triangles, len(vertices))
        row = np.repeat(np.arange(len(edges)), 2)
        halves = sp.csr_matrix((np.full(row.size, 0.5), (row, edges.ravel())), (len(edges), len(vertices)))
        weights = sp.vstack([weights, halves @ weights]).tocsr()
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
    return Rigged(
        vertices, triangles, weights, character.heads, character.tails, character.parents, character.bone_names
    )


def generated_figure(vertex_count, joints=12):
    """A smooth limb of radius 1 with so many joints, four radii apart: surface, bones and weights by formula."""
    length = 4.0 * (joints + 1)
    # Triangles as wide as long.
    sides = max(round(np.sqrt(vertex_count * 2 * np.pi / length)), 8)
    rings = max(round(vertex_count / sides), 8)
    x = np.repeat(np.linspace(0, length, rings), sides)
    angle = np.tile(np.arange(sides) * 2 * np.pi / sides, rings)
    vertices = np.stack([x, np.cos(angle), np.sin(angle)], axis=1)
    i, k = (grid.ravel() for grid in np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij"))
    a, b = i * sides + k, i * sides + (k + 1) % sides
    triangles = np.concatenate([np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1)])
    heads = np.stack([4.0 * np.arange(joints + 1), *np.zeros((2, joints + 1))], axis=1)
    tails = heads + np.array([4.0, 0, 0])
    # Share of the bone below each joint, from 0 to 1 over a radius on both sides.
    step = np.clip((x[:, None] - heads[1:, 0] + 1.0) / 2.0, 0, 1)
    below = np.concatenate([np.ones((len(x), 1)), step * step * (3 - 2 * step), np.zeros((len(x), 1))], axis=1)
    weights = sp.csr_matrix(below[:, :-1] - below[:, 1:])
    return Rigged(
        vertices,
        triangles.astype(np.int64),
        weights,
        heads,
        tails,
        np.arange(-1, joints),
        [f"bone{bone}" for bone in range(joints + 1)],
    )
