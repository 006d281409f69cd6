"""Ways to give a target weights without Dermis' retargeting, for comparison.

Each takes a `characters.Pair` and returns dense weights over the target's bones. What comes from
the source's surface goes over Dermis' bone map where the two skeletons differ. Two bodies are brought
to the same height and centre first; a garment stays where it is worn.
"""

import igl
import numpy as np
import robust_laplacian
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from characters import mesh_of, skeleton_of
from dermis_native import Skeleton, SkinWeights, bind_weights, map_bones

# Abdrashitov, Raichstat, Monsen, Hill: Robust Skin Weights Transfer via Weight Inpainting (2023), the
# thresholds that the paper gives.
LARGEST_DISTANCE = 0.05  # of the diagonal of the target's bounding box
LARGEST_ANGLE = 30.0  # between normals, degrees
SMOOTHING_STEPS, SMOOTHING = 10, 0.2


def closest_points(pair):
    """Interpolated source weights (V,B) at the closest points, distances (V,), normals (V,3) there."""
    source = pair.source
    triangles = source.triangles
    squared, face, closest = igl.point_mesh_squared_distance(brought_over(pair), source.vertices, triangles)
    corners = triangles[face]
    barycentric = igl.barycentric_coordinates(
        closest, *(np.ascontiguousarray(source.vertices[corners[:, k]]) for k in range(3))
    )
    barycentric[~np.isfinite(barycentric).all(axis=1)] = (1.0, 0.0, 0.0)
    barycentric = np.clip(barycentric, 0.0, None)
    barycentric /= barycentric.sum(axis=1, keepdims=True)
    weights = np.einsum("vk,vkb->vb", barycentric, source.weights[corners].astype(np.float64))
    normals = np.einsum("vk,vki->vi", barycentric, vertex_normals(source.vertices, triangles)[corners])
    return weights, np.sqrt(squared), normals


def brought_over(pair):
    """Vertices (V,3) of the target as high as the source and in its place; a garment's as they are."""
    if pair.worn:
        return pair.target.vertices
    middle = lambda vertices: 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))  # noqa: E731
    own, goal = pair.target.vertices, pair.source.vertices
    scale = np.ptp(goal[:, 2]) / np.ptp(own[:, 2])
    return np.ascontiguousarray((own - middle(own)) * scale + middle(goal))


def vertex_normals(vertices, triangles):
    """Area-weighted normals (V,3), not of unit length."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], np.cross(b - a, c - a))
    return normals


def over_bones(pair, weights):
    """Source columns as columns of the target's bones."""
    from_, to = skeleton_of(pair.source), skeleton_of(pair.given)
    rows = SkinWeights.from_dense(np.maximum(weights, 0.0)).normalized()
    return map_bones(from_, to).transfer(rows, pair.target.vertices, to).to_dense()


def closest_point(pair):
    """What copying from the nearest surface gives."""
    return over_bones(pair, closest_points(pair)[0])


def robust_inpainting(pair):
    """Closest points where distance and normals agree, weights of least bi-Laplacian energy between them."""
    weights, distances, normals = closest_points(pair)
    vertices, triangles = brought_over(pair), pair.target.triangles
    own = vertex_normals(vertices, triangles)
    cosine = np.einsum("vi,vi->v", own, normals)
    cosine /= np.maximum(np.linalg.norm(own, axis=1) * np.linalg.norm(normals, axis=1), 1e-300)
    diagonal = np.linalg.norm(np.ptp(vertices, axis=0))
    matched = (distances <= LARGEST_DISTANCE * diagonal) & (cosine >= np.cos(np.radians(LARGEST_ANGLE)))
    stiffness, mass = robust_laplacian.mesh_laplacian(vertices, triangles)
    # A piece of the mesh without any match keeps its closest points.
    _, piece = sp.csgraph.connected_components(stiffness != 0)
    matched |= ~np.isin(piece, np.unique(piece[matched]))
    energy = (stiffness + stiffness @ sp.diags(1.0 / mass.diagonal()) @ stiffness).tocsc()
    unknown = np.flatnonzero(~matched)
    if len(unknown):
        right = -energy[unknown][:, matched] @ weights[matched]
        # Regular up to rounding: a tiny multiple of the diagonal keeps slivers from breaking the factors.
        block = energy[unknown][:, unknown]
        block = block + sp.diags(1e-10 * block.diagonal())
        weights[unknown] = np.clip(sla.splu(block.tocsc()).solve(right), 0.0, 1.0)
        weights = smoothed(weights, matched, vertices, triangles, LARGEST_DISTANCE * diagonal)
    totals = weights.sum(axis=1, keepdims=True)
    return over_bones(pair, np.where(totals > 0, weights / np.where(totals > 0, totals, 1.0), weights))


def smoothed(weights, matched, vertices, triangles, reach):
    """Averages with neighbours within `reach`, along the surface, of vertices that were filled in."""
    count = len(vertices)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    graph = sp.csr_matrix((np.maximum(lengths, 1e-12), (edges[:, 0], edges[:, 1])), shape=(count, count))
    graph.data = np.maximum(graph.data, 1e-12)
    near = sp.csgraph.dijkstra(graph, indices=np.flatnonzero(~matched), limit=reach, min_only=True) <= reach
    adjacency = (graph != 0).astype(float)
    average = sp.diags(1.0 / np.maximum(adjacency.sum(axis=1).A1, 1.0)) @ adjacency
    for _ in range(SMOOTHING_STEPS):
        weights = np.where(near[:, None], (1 - SMOOTHING) * weights + SMOOTHING * (average @ weights), weights)
    return weights


def eq_2(pair):
    """Weights from the target's skeleton alone (eq. 2)."""
    return from_bones(pair, "paper")


def volumetric(pair):
    """Weights from the target's skeleton alone, through the volume."""
    return from_bones(pair, "volumetric")


def bone_heat(pair):
    """Blender's automatic weights; needs Blender as a Python module."""
    import bone_heat as blender

    return blender.bone_heat(pair.given, used_bones(pair))


def used_bones(pair):
    """The bones that move skin in truth; the others are no part of a skeleton for weights from it alone."""
    return np.flatnonzero(pair.target.weights.any(axis=0))


def from_bones(pair, method):
    """Weights by `bind_weights` among the bones used."""
    target, used = pair.given, used_bones(pair)
    place = np.full(len(target.parents) + 1, -1)
    place[used] = np.arange(len(used))
    parents = place[[nearest_used(target.parents, used, bone) for bone in used]]
    skeleton = Skeleton(target.heads[used], target.tails[used], parents)
    weights = np.zeros(pair.target.weights.shape)
    weights[:, used] = bind_weights(mesh_of(pair.target), skeleton, method=method).to_dense()
    return weights


def nearest_used(parents, used, bone):
    """The nearest ancestor among the bones used, -1 without one."""
    parent = parents[bone]
    while parent >= 0 and parent not in used:
        parent = parents[parent]
    return parent
