"""Garments cut from the surface of a body, and the weights that they have from it."""

from dataclasses import replace

import characters
import igl
import makehuman
import numpy as np
import scipy.sparse as sparse

TRUNK = ("spine", "clavicle", "upperarm", "lowerarm")
LEGS = ("pelvis", "thigh", "calf")
JACKET = (*TRUNK, "pelvis")
SUIT = (*TRUNK, *LEGS)


def cut(body, bones):
    """The part of a body that is mainly moved by bones whose names begin so."""
    chosen = np.array([name.startswith(bones) for name in body.bone_names])
    keep = body.weights[:, chosen].sum(axis=1) > 0.5
    triangles = body.triangles
    return _of(body, body.vertices, triangles[keep[triangles].all(axis=1)], body.weights)


def cloth(body, bones, distance, rounds=10, layers=1):
    """What covers that part at a distance, as a share of the height, its hollows spanned in some rounds.

    A second layer lies under the first, joined to it at every hem.
    """
    part = cut(body, bones)
    vertices, triangles, weights = part.vertices, part.triangles, part.weights.astype(np.float64)
    adjacency = igl.adjacency_matrix(triangles).astype(np.float64)
    around = sparse.diags(1 / np.maximum(np.asarray(adjacency.sum(axis=1)).ravel(), 1)) @ adjacency
    normals = igl.per_vertex_normals(vertices, triangles)
    for _ in range(10):
        normals = around @ normals
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    off = distance * characters.extent(body)
    points = vertices + off * normals
    for _ in range(rounds):
        points += 0.5 * (around @ points - points)
    for _ in range(2):
        weights += 0.5 * (around @ weights - weights)
    if layers == 2:
        count, hem = len(points), _boundary(triangles)
        points = np.concatenate([points, points - 0.15 * off * igl.per_vertex_normals(points, triangles)])
        a, b = hem.T
        rim = np.concatenate([np.stack([b, a, b + count], 1), np.stack([b + count, a, a + count], 1)])
        triangles = np.concatenate([triangles, triangles[:, ::-1] + count, rim])
        weights = np.concatenate([weights, weights])
    return _of(part, points, triangles, weights)


def skirt(body, bones=LEGS, width=0.03, rings=24, around=40):
    """A cone of cloth from the hips to the calves, without weights of its own."""
    part = cut(body, bones)
    low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
    top = part.vertices[part.vertices[:, 2] > high[2] - 0.1 * (high[2] - low[2])]
    middle, radii = top.mean(axis=0), np.ptp(top, axis=0) / 2 + width * characters.extent(body)
    share, angle = np.meshgrid(np.linspace(0, 1, rings), np.arange(around) * 2 * np.pi / around, indexing="ij")
    x, y = (middle[k] + radii[k] * (1 + 0.4 * share) * f(angle) for k, f in ((0, np.cos), (1, np.sin)))
    z = high[2] - 0.85 * share * (high[2] - low[2])
    points = np.stack([x, y, z], -1).reshape(-1, 3)
    a = (np.arange((rings - 1) * around)).reshape(rings - 1, around)
    b = np.roll(a, -1, axis=1)
    corners = (a, a + around, b), (b, a + around, b + around)
    triangles = np.concatenate([np.stack(triangle, -1).reshape(-1, 3) for triangle in corners])
    return _of(body, points, triangles, np.full((len(points), len(body.bone_names)), 1.0))


def _boundary(triangles):
    """Edges of one triangle alone (E,2), in its direction."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, first, counts = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return edges[first[counts == 1]]


def _of(character, vertices, triangles, weights):
    used, corners = np.unique(triangles, return_inverse=True)
    return replace(
        character,
        vertices=np.ascontiguousarray(vertices[used]),
        loop_counts=np.full(len(triangles), 3, dtype=np.int64),
        loop_indices=corners.ravel().astype(np.int64),
        weights=makehuman.normalized(np.asarray(weights[used], np.float64)),
    )
