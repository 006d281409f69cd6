"""Poses for the tests and measures of a deformed surface."""

import numpy as np
from scipy.spatial.transform import Rotation


def about(axis, degrees):
    """Rotation matrix about an axis."""
    axis = np.asarray(axis, float)
    return Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()


def pose(skeleton, turns):
    """Transforms (B,4,4) = pose · rest⁻¹ of bones turned about their heads by matrices, {bone: (3,3)}."""
    transforms = np.tile(np.eye(4), (len(skeleton), 1, 1))
    placed = set()

    def place(bone):
        if bone in placed:
            return
        placed.add(bone)
        local = np.eye(4)
        if bone in turns:
            local[:3, :3] = turns[bone]
            local[:3, 3] = skeleton.heads[bone] - turns[bone] @ skeleton.heads[bone]
        parent = skeleton.parents[bone]
        if parent >= 0:
            place(parent)
            local = transforms[parent] @ local
        transforms[bone] = local

    for bone in range(len(skeleton)):
        place(bone)
    return transforms


def joint_turns(skeleton, share=1.0):
    """Eight poses of one turned joint of a MakeHuman body, {name: transforms}."""

    def along(bone):
        return skeleton.tails[bone] - skeleton.heads[bone]

    def bend(name, degrees, towards):
        bone = skeleton.names.index(name)
        return pose(skeleton, {bone: about(np.cross(along(bone), towards), share * degrees)})

    def twist(name, degrees):
        bone = skeleton.names.index(name)
        return pose(skeleton, {bone: about(along(bone), share * degrees)})

    back, front, up = np.array([[0, 1, 0], [0, -1, 0], [0, 0, 1]], float)
    return {
        "knee 120": bend("calf_l", 120, back),
        "knee 90": bend("calf_l", 90, back),
        "elbow 120": bend("lowerarm_l", 120, up),
        "forearm twist 120": twist("lowerarm_l", 120),
        "hip 90": bend("thigh_l", 90, front),
        "shoulder 60": bend("upperarm_l", 60, up),
        "wrist twist 90": twist("hand_l", 90),
        "spine 35": bend("spine_01", 35, front),
    }


def volume(vertices, triangles):
    """Volume inside a closed surface."""
    a, b, c = (vertices[triangles[:, k]].astype(float) for k in range(3))
    return np.einsum("ti,ti->", a, np.cross(b, c)) / 6


def longest_edge(vertices, triangles, rest):
    """Largest ratio of an edge's length to its rest length."""
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    length = [np.linalg.norm(v[edges[:, 0]] - v[edges[:, 1]], axis=1) for v in (vertices, rest)]
    usable = length[1] > 1e-6
    return np.max(length[0][usable] / length[1][usable])


def crossings(vertices, triangles):
    """Number of pairs of triangles without a common vertex that pass through each other."""
    corners = vertices[triangles].astype(float)
    low, high = corners.min(1), corners.max(1)
    order = np.argsort(low[:, 2], kind="stable")
    ends = np.searchsorted(low[order, 2], high[order, 2], side="right")
    found = 0
    for start in range(0, len(order), 512):
        rows = range(start, min(start + 512, len(order)))
        a = np.concatenate([np.full(ends[i] - i - 1, order[i]) for i in rows])
        b = np.concatenate([order[i + 1 : ends[i]] for i in rows])
        near = np.all((low[a] <= high[b]) & (low[b] <= high[a]), axis=1)
        a, b = a[near], b[near]
        apart = ~np.any(triangles[a][:, :, None] == triangles[b][:, None, :], axis=(1, 2))
        s, t = corners[a[apart]], corners[b[apart]]
        found += np.count_nonzero(_pierces(s, t) | _pierces(t, s))
    return found


def _pierces(s, t):
    """True where an edge of s passes through t by more than rounding."""

    def side(a, b, c, d):
        return np.einsum("ni,ni->n", np.cross(b - a, c - a), d - a)

    a, b, c = t[:, 0], t[:, 1], t[:, 2]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    result = np.zeros(len(s), bool)
    for k in range(3):
        p, q = s[:, k], s[:, (k + 1) % 3]
        start, end = side(a, b, c, p), side(a, b, c, q)
        rounding = 1e-5 * area * np.linalg.norm(q - p, axis=1)
        through = (start * end < 0) & (abs(start) > rounding) & (abs(end) > rounding)
        around = np.stack([side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)])
        result |= through & (np.all(around > 0, axis=0) | np.all(around < 0, axis=0))
    return result
