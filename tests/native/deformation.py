"""Poses of a skeleton and what they do to a surface: volume, crossing triangles, stretched edges."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation


def turned(skeleton, rotations):
    """Transforms (B,4,4), pose · rest⁻¹, of a skeleton whose bones turn about their heads.

    rotations maps bone names or indices to rotation vectors in radians, in the rest pose's axes.
    """
    names = skeleton.names
    by_bone = {names.index(bone) if isinstance(bone, str) else bone: vector for bone, vector in rotations.items()}
    transforms = np.tile(np.eye(4), (len(skeleton), 1, 1))
    for bone in np.argsort([len(ancestors(skeleton, b)) for b in range(len(skeleton))], kind="stable"):
        own = np.eye(4)
        if bone in by_bone:
            own[:3, :3] = Rotation.from_rotvec(by_bone[bone]).as_matrix()
            own[:3, 3] = skeleton.heads[bone] - own[:3, :3] @ skeleton.heads[bone]
        parent = skeleton.parents[bone]
        transforms[bone] = own if parent < 0 else transforms[parent] @ own
    return transforms


def ancestors(skeleton, bone):
    """Bones from a bone's parent to its root."""
    found = []
    while (bone := skeleton.parents[bone]) >= 0:
        found.append(int(bone))
    return found


def volume(vertices, triangles):
    """Signed volume inside a closed surface."""
    a, b, c = (vertices[triangles[:, i]].astype(float) for i in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def longest_stretch(rest, deformed, triangles):
    """Largest ratio of an edge's length to its rest length."""
    sides = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(int), axis=1), axis=0)
    length = lambda points: np.linalg.norm(points[sides[:, 0]] - points[sides[:, 1]], axis=1)  # noqa: E731
    before = length(rest)
    return (length(deformed)[before > 1e-9] / before[before > 1e-9]).max()


def crossing_pairs(vertices, triangles):
    """Set of pairs of triangles without a common vertex that pass through each other."""
    corners = vertices[triangles].astype(float)
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    pairs = []
    # Triangles of like size are searched together, so that a few large ones do not pair everything.
    classes = np.floor(np.log2(np.maximum(radii, 1e-12))).astype(int)
    trees = {c: (np.flatnonzero(classes == c), cKDTree(centres[classes == c])) for c in np.unique(classes)}
    for c, (members, tree) in trees.items():
        for d, (others, other_tree) in trees.items():
            if d > c:
                continue
            reach = radii[members].max() + radii[others].max()
            for i, near in zip(members, tree.query_ball_tree(other_tree, reach), strict=True):
                near = others[near]
                near = near[np.linalg.norm(centres[near] - centres[i], axis=1) <= radii[near] + radii[i]]
                pairs.append(np.stack([np.full(len(near), i), near], axis=1))
    pairs = np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    shared = (triangles[pairs[:, 0]][:, :, None] == triangles[pairs[:, 1]][:, None]).any(axis=(1, 2))
    pairs = pairs[~shared]
    first, second = corners[pairs[:, 0]], corners[pairs[:, 1]]
    crossing = np.zeros(len(pairs), bool)
    for side in range(3):
        crossing |= _pierces(first[:, side], first[:, (side + 1) % 3], second)
        crossing |= _pierces(second[:, side], second[:, (side + 1) % 3], first)
    return {tuple(pair) for pair in pairs[crossing].tolist()}


def _pierces(start, end, triangle):
    """Whether segments (n,3) pass through triangles (n,3,3)."""
    a, b, c = (triangle[:, i] for i in range(3))
    tetrahedron = lambda p, q, r, s: np.einsum("ij,ij->i", q - p, np.cross(r - p, s - p))  # noqa: E731
    sides = tetrahedron(start, a, b, c) * tetrahedron(end, a, b, c) < 0
    around = [tetrahedron(start, end, p, q) for p, q in ((a, b), (b, c), (c, a))]
    positive = np.all([v > 0 for v in around], axis=0)
    negative = np.all([v < 0 for v in around], axis=0)
    return sides & (positive | negative)


def capped_cylinder(rings=121, around=48, half_length=4.0, radius=1.0):
    """Cylinder along x with flat caps: vertices, triangles, ring coordinate x of each vertex."""
    x = np.linspace(-half_length, half_length, rings)
    angle = np.arange(around) * 2 * np.pi / around
    ring = np.stack([np.zeros(around), radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    side = (ring[None] + np.stack([x, 0 * x, 0 * x], axis=1)[:, None]).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    quads = np.stack([a, a + around, b + around, b], axis=-1).reshape(-1, 4)
    triangles = [quads[:, [0, 2, 1]], quads[:, [0, 3, 2]]]
    vertices = [side]
    count = len(side)
    for end, first in ((0, 0), (rings - 1, (rings - 1) * around)):
        # Concentric rings, so that the caps have triangles of the size of the side's.
        previous = first + np.arange(around)
        for share in (0.75, 0.5, 0.25):
            vertices.append(ring * share + [x[end], 0, 0])
            current = count + np.arange(around)
            count += around
            triangles += _band(previous, current, flip=end == 0)
            previous = current
        vertices.append([[x[end], 0, 0]])
        fan = np.stack([previous, np.roll(previous, -1), np.full(around, count)], axis=1)
        triangles.append(fan[:, ::-1] if end == 0 else fan)
        count += 1
    vertices, triangles = np.concatenate(vertices), np.concatenate(triangles)
    if volume(vertices, triangles) < 0:
        triangles = triangles[:, ::-1]
    return vertices, np.ascontiguousarray(triangles)


def _band(outer, inner, flip):
    next_outer, next_inner = np.roll(outer, -1), np.roll(inner, -1)
    band = [np.stack([outer, next_outer, next_inner], axis=1), np.stack([outer, next_inner, inner], axis=1)]
    return [t[:, ::-1] for t in band] if flip else band


def joint_volume(rest, deformed, triangles, half_width=1.3):
    """Volume of the part of a cylinder within |x| < half_width at rest, its ends closed by fans."""
    return part_volume(deformed, triangles[(np.abs(rest[triangles, 0]) < half_width + 1e-9).all(axis=1)])


def part_volume(vertices, part):
    """Volume inside a part of a closed surface, its openings closed by fans around their middles."""
    directed = part[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(int)
    keys = set(map(tuple, directed.tolist()))
    open_sides = np.array([side for side in keys if side[::-1] not in keys])
    corners, indices = np.unique(open_sides, return_inverse=True)
    indices = indices.reshape(-1, 2)
    graph = coo_array((np.ones(len(indices)), indices.T), shape=(len(corners), len(corners)))
    openings, of_corner = connected_components(graph, directed=False)
    total = volume(vertices, part)
    for opening in range(openings):
        sides = open_sides[of_corner[indices[:, 0]] == opening]
        centre = vertices[np.unique(sides)].mean(axis=0)
        fan = np.stack([sides[:, 1], sides[:, 0], np.full(len(sides), len(vertices))], axis=1)
        total += volume(np.concatenate([vertices, [centre]]), fan)
    return total


def limb_part(skeleton, weights, rest, triangles, bone, reach=1.5):
    """Triangles of a limb around the joint at the head of a bone: within so many of its radii."""
    joint = skeleton.names.index(bone)
    parent = skeleton.parents[joint]
    distance = np.linalg.norm(rest - skeleton.heads[joint], axis=1)
    blends = (weights[:, joint] > 0.2) & (weights[:, parent] > 0.2)
    near = (distance < reach * np.median(distance[blends])) & (weights[:, [joint, parent]].sum(axis=1) > 0.5)
    return triangles[near[triangles].all(axis=1)]
