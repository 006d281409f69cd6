"""Algorithm 2 of the paper in plain numpy, written from its equations alone: the oracle for `method="paper"`.

Distances come from the whole dense spectrum of robust_laplacian's operator, matches from trying
every pair of vertices.
"""

from functools import cache

import numpy as np
import robust_laplacian
from scipy.spatial.distance import cdist


def spectrum(mesh):
    """All eigenvalues (V,) and mass-orthonormal eigenfunctions (V,V), ascending."""
    return _spectrum(mesh.vertices.tobytes(), mesh.triangles.tobytes())


@cache
def _spectrum(vertices, triangles):
    vertices = np.frombuffer(vertices).reshape(-1, 3)
    triangles = np.frombuffer(triangles, np.uint32).reshape(-1, 3).astype(np.int64)
    stiffness, mass = robust_laplacian.mesh_laplacian(vertices, triangles)
    root = np.sqrt(mass.diagonal())
    values, functions = np.linalg.eigh(stiffness.toarray() / root / root[:, None])
    return values, functions / root[:, None]


def biharmonic_distances(mesh):
    """(V,V) distances by eq. 17 with every eigenpair."""
    values, functions = spectrum(mesh)
    points = functions[:, 1:] / values[1:]
    return cdist(points, points)


def descriptors(distances, landmarks):
    """(V,k) normalised distances to the landmarks, eq. 20 and 21."""
    columns = distances[:, landmarks]
    return columns / columns.max(axis=1, keepdims=True)


def decompose(vertices, skeleton, takes_part, joint_radius=0.3):
    """Region of each vertex (section 4.1, figure 3): (kind, bone) with kind 0 a joint, 1 a bone."""
    heads, tails, parents = skeleton.heads, skeleton.tails, skeleton.parents
    lengths = np.linalg.norm(tails - heads, axis=1)
    along = np.einsum("vbi,bi->vb", vertices[:, None] - heads, tails - heads) / np.maximum(lengths**2, 1e-300)
    nearest = heads + np.clip(along, 0, 1)[..., None] * (tails - heads)
    offset = vertices[:, None] - nearest
    to_bone = np.linalg.norm(offset, axis=2)
    to_bone[:, ~takes_part] = np.inf
    # Of bones that are equally near, the one in whose direction the vertex lies.
    inward = (heads + tails) / 2 - nearest
    lengths_of_both = np.maximum(np.linalg.norm(inward, axis=2) * to_bone, 1e-300)
    leaning = np.einsum("vbi,vbi->vb", offset, inward) / lengths_of_both
    leaning[to_bone > to_bone.min(axis=1, keepdims=True) * (1 + 1e-9)] = -np.inf
    is_joint = takes_part & (parents >= 0) & takes_part[parents]
    radius = joint_radius * np.minimum(lengths, lengths[parents])
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.linalg.norm(vertices[:, None] - heads, axis=2) / radius
    relative[:, ~(is_joint & (radius > 0))] = np.inf
    inside = relative.min(axis=1) <= 1
    bones = np.where(inside, relative.argmin(axis=1), leaning.argmax(axis=1))
    return np.stack([np.where(inside, 0, 1), bones], axis=1)


def retarget(source, source_weights, target, landmarks, regions=None):
    """First matches (Vt,) and weights (Vt,B); regions, where given, labels both sides."""
    source_distances = biharmonic_distances(source)
    x = descriptors(biharmonic_distances(target), landmarks[:, 1])
    y = descriptors(source_distances, landmarks[:, 0])
    prediction = cdist(x, y)  # eq. 22 with w_i = 1
    if regions is not None:
        of_source, of_target = regions
        same = (of_target[:, None] == of_source[None]).all(axis=2)
        same[~same.any(axis=1)] = True
        prediction[~same] = np.inf
    order = np.argsort(prediction, axis=1, kind="stable")[:, :5]
    rows = source_weights / source_weights.sum(axis=1, keepdims=True)
    weights = np.empty((len(x), rows.shape[1]))
    for vertex, (best, *others) in enumerate(order):
        others = [other for other in others if np.isfinite(prediction[vertex, other])]
        if prediction[vertex, best] <= 1e-12 or not others:
            weights[vertex] = rows[best]
            continue
        factors = 1 / source_distances[best, others]  # eq. 23
        weights[vertex] = factors @ rows[others] / factors.sum()
    return order[:, 0], weights
