"""Surfaces for the tests: closed forms, bad meshes, MakeHuman bodies."""

from functools import cache

import makehuman
import numpy as np
import scipy.sparse as sp
from dermis_native import Skeleton, SkinWeights, TriangleMesh, laplacian


def sphere(subdivisions=3):
    """Icosphere of radius 1; its Laplacian has eigenvalues l(l+1), each 2l+1 times."""
    golden = (1 + 5**0.5) / 2
    vertices = [(a, b, 0) for a in (-1, 1) for b in (-golden, golden)]
    vertices = np.array(vertices + [(0, a, b) for a, b, _ in vertices] + [(b, 0, a) for a, b, _ in vertices], float)
    near = np.linalg.norm(vertices[:, None] - vertices, axis=2) < 2.1
    triangles = np.array(
        [(i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]]
    )
    outward = np.einsum("ti,ti->t", np.cross(*_edges(vertices, triangles)), vertices[triangles].sum(1)) > 0
    triangles[~outward] = triangles[~outward][:, ::-1]
    for _ in range(subdivisions):
        sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
        unique, middle = np.unique(sides, axis=0, return_inverse=True)
        ab, bc, ca = middle.reshape(3, -1) + len(vertices)
        vertices = np.concatenate([vertices, vertices[unique].mean(1)])
        a, b, c = triangles.T
        triangles = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), triangles


def _edges(vertices, triangles):
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return b - a, c - a


def torus(around=36, across=14, radius=2.0, tube=0.7):
    """Torus around z; its symmetry makes most eigenvalues double."""
    u, v = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij")
    ring = radius + tube * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), tube * np.sin(v)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    corners = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], -2)
    return vertices, corners.reshape(-1, 3)


def bad_meshes():
    """Names and meshes that break a plain cotangent Laplacian."""
    vertices, triangles = torus(12, 8)
    random = np.random.default_rng(5)
    needles = vertices.copy()
    needles[::7] = needles[1::7][: len(needles[::7])] + 1e-9
    flat = vertices * [1, 1, 0]
    yield "needles and nearly coincident vertices", needles, triangles
    yield "flattened with folded triangles", flat, triangles
    yield "three sheets at an edge", vertices, np.concatenate([triangles, [[0, 8, 50], [8, 0, 60]]])
    yield "doubled triangles", vertices, np.concatenate([triangles, triangles[::3], triangles[::5, ::-1]])
    yield (
        "inconsistent orientation",
        vertices,
        np.where(random.random((len(triangles), 1)) < 0.5, triangles, triangles[:, ::-1]),
    )
    yield "open", vertices, triangles[random.random(len(triangles)) < 0.9]
    yield "triangle soup", random.normal(size=(30, 3)), random.permuted(np.tile(np.arange(30), (80, 1)), axis=1)[:, :3]


def csc(mesh):
    """Our Laplacian as scipy's sparse stiffness matrix and diagonal mass."""
    data, indices, starts, areas = laplacian(mesh)
    return sp.csc_matrix((data, indices, starts), shape=(len(areas),) * 2), areas


@cache
def body(name, triangle_count=None, **macro):
    """A MakeHuman body as (TriangleMesh, Skeleton, dense weights); decimated and permuted on request."""
    character = makehuman.body(name, **macro)
    if triangle_count is not None:
        character = makehuman.permuted(makehuman.decimated(character, triangle_count), seed=3)
    mesh = TriangleMesh.from_polygons(character.vertices, character.loop_counts, character.loop_indices)
    skeleton = Skeleton(character.heads, character.tails, character.parents, list(character.bone_names))
    return mesh, skeleton, np.asarray(character.weights, np.float64)


def child(triangle_count=None):
    return body("child", triangle_count, age=0.1875)


def adult(triangle_count=None):
    return body("adult", triangle_count)


def skin(weights):
    return SkinWeights.from_dense(weights)
