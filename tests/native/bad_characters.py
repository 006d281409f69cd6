"""Bad meshes and skeletons made from one MakeHuman body: what generators, scans and exports leave behind."""

import makehuman
import numpy as np
from dermis_native import Skeleton, TriangleMesh

TRIANGLES = 3000


def bad_characters():
    """Names, and functions that make (TriangleMesh, Skeleton)."""
    return {**bad_meshes(), **bad_skeletons()}


def body():
    """Vertices, triangles and (heads, tails, parents) of a child with a gap-free skeleton."""
    character = makehuman.permuted(makehuman.decimated(makehuman.body("child", age=0.1875), TRIANGLES), seed=1)
    return character.vertices, character.triangles, (character.heads, character.tails, character.parents)


def shifted(points, x=0.0, y=0.0, z=0.0):
    return points + np.array([x, y, z])


def split(vertices, triangles, shrink=1.0):
    """Every triangle by itself, scaled about its middle."""
    corners = vertices[triangles]
    middle = corners.mean(axis=1, keepdims=True)
    return ((corners - middle) * shrink + middle).reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def joined(*parts):
    """Meshes side by side."""
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([triangles + offset for (_, triangles), offset in zip(parts, offsets, strict=False)]),
    )


def specks(count, centre, spread, size=0.004, seed=0):
    """Small triangles around a centre."""
    random = np.random.default_rng(seed)
    centres = random.normal(size=(count, 1, 3)) * spread + centre
    return (centres + size * random.normal(size=(count, 3, 3))).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def shells(vertices, triangles, count):
    """The triangles dealt out to shells by place, cut apart and moved a little."""
    random = np.random.default_rng(2)
    seeds = vertices[random.choice(len(vertices), count, replace=False)]
    middles = vertices[triangles].mean(axis=1)
    owner = np.linalg.norm(middles[:, None] - seeds, axis=2).argmin(axis=1)
    parts = []
    for shell in np.unique(owner):
        used, corners = np.unique(triangles[owner == shell], return_inverse=True)
        parts.append((vertices[used] + 0.003 * random.normal(size=3), corners.reshape(-1, 3)))
    return joined(*parts)


def subdivided(vertices, triangles):
    """Every triangle as four."""
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    unique, middle = np.unique(sides, axis=0, return_inverse=True)
    ab, bc, ca = middle.reshape(3, -1) + len(vertices)
    a, b, c = triangles.T
    fourfold = [np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate([vertices, vertices[unique].mean(axis=1)]), np.concatenate(fourfold)


def bad_meshes():
    """Names, and functions that make (TriangleMesh, Skeleton) with a bad mesh."""
    vertices, triangles, bones = body()
    random = np.random.default_rng(3)
    some = random.random(len(triangles))
    flipped = triangles[:, ::-1]
    height = np.ptp(vertices[:, 2])

    def moved(amount):
        return vertices + amount * np.random.default_rng(4).normal(size=vertices.shape)

    def collapsed(share):
        result = vertices.copy()
        result[triangles[some < share, 1]] = result[triangles[some < share, 0]]
        return result

    needles = vertices.copy()
    needles[triangles[some < 0.2, 2]] = 0.5 * needles[triangles[some < 0.2, :2]].sum(axis=1) + 1e-9
    fins = np.stack([triangles[:, 0], triangles[:, 1], random.integers(0, len(vertices), len(triangles))], axis=1)
    meshes = {
        "a tenth of the faces missing": (vertices, triangles[some > 0.1]),
        "half of the faces missing": (vertices, triangles[some > 0.5]),
        "the back missing": (vertices, triangles[vertices[triangles].mean(axis=1)[:, 1] < 0]),
        "no head": (vertices, triangles[vertices[triangles].mean(axis=1)[:, 2] < 0.8 * height]),
        "66 shells": shells(vertices, triangles, 66),
        "every face by itself": split(vertices, triangles),
        "every face by itself with gaps": split(vertices, triangles, 0.8),
        "10,000 specks around": joined((vertices, triangles), specks(10_000, [0, 0, 0.5], 0.5)),
        "10,000 specks far away": joined((vertices, triangles), specks(10_000, [30.0, 0, 0], 2.0)),
        "nothing but specks": specks(3000, [0, 0, 0.5], 0.3),
        "debris 1,000 heights away": joined((vertices, triangles), specks(3, [1000.0, 0, 0], 1.0)),
        "random orientation": (vertices, np.where(some[:, None] < 0.5, triangles, flipped)),
        "inside out": (vertices, flipped),
        "doubled faces": (vertices, np.concatenate([triangles, triangles])),
        "doubled faces back to back": (vertices, np.concatenate([triangles, flipped])),
        "two bodies in one": joined((vertices, triangles), (shifted(vertices, 0.03, 0.02, 0.01), triangles)),
        "a body inside a body": joined((vertices, triangles), (shifted(vertices * 0.98, z=0.01), triangles)),
        "needle triangles": (needles, triangles),
        "collapsed triangles": (collapsed(0.2), triangles),
        "repeated corners": (vertices, np.where(some[:, None] < 0.1, triangles[:, [0, 0, 1]], triangles)),
        "three sheets at edges": (vertices, np.concatenate([triangles, fins[some < 0.05]])),
        "a scan's noise": (moved(0.006), triangles),
        "crumpled": (moved(0.05), triangles),
        "loose vertices": (np.concatenate([vertices, vertices[:200] * 1.3]), triangles),
        "flat": (vertices * [1, 0, 1], triangles),
        "a line": (vertices * [0, 0, 1], triangles),
        "a point": (vertices * 0, triangles),
        "one triangle": (vertices[triangles[0]], np.array([[0, 1, 2]])),
        "a crowd of hair cards": joined((vertices, triangles), specks(2000, [0, 0, 0.95 * height], 0.08, 0.05)),
        "100,000 triangles": subdivided(*subdivided(vertices, triangles)),
    }
    return {name: lambda mesh=mesh: (TriangleMesh(*mesh), Skeleton(*bones)) for name, mesh in meshes.items()}


def bad_skeletons():
    """Names, and functions that make (TriangleMesh, Skeleton) with a bad skeleton."""
    vertices, triangles, (heads, tails, parents) = body()
    middle = 0.5 * (heads + tails)
    count = len(heads)
    twice = np.concatenate([parents, np.where(parents >= 0, parents + count, -1)])
    skeletons = {
        "bones beside the body": (shifted(heads, 0.3), shifted(tails, 0.3), parents),
        "bones half outside": (shifted(heads, y=0.08), shifted(tails, y=0.08), parents),
        "bones a hundred heights away": (shifted(heads, 100.0), shifted(tails, 100.0), parents),
        "a skeleton of a millimetre": (shifted(0.001 * heads, z=0.5), shifted(0.001 * tails, z=0.5), parents),
        "a skeleton of a kilometre": (1000 * heads, 1000 * tails, parents),
        "bones without length": (heads, heads, parents),
        "all bones in one point": (shifted(0 * heads, z=0.5), shifted(0 * tails, z=0.5), parents),
        "one bone": (heads[1:2], tails[1:2], [-1]),
        "every bone a root": (middle, tails, np.full(count, -1)),
        "every bone twice": (np.concatenate([heads, heads]), np.concatenate([tails, tails]), twice),
        "turned round": (tails, heads, parents),
    }
    return {
        name: lambda bones=bones: (TriangleMesh(vertices, triangles), Skeleton(*bones))
        for name, bones in skeletons.items()
    }
