# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex groups in bulk: read, write, and put back exactly as they were.

Blender shows no array of vertex weights to Python, so this file holds the only loops over
vertices of the add-on. A BMesh gives all entries of a vertex at once, in less than half the time that
they take one by one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import bmesh
import bpy
import numpy as np

from ..core.character import BoneWeights


@dataclass(frozen=True)
class GroupWeights:
    """All vertex groups of an object.

    names and locked (G); active index; counts (V,) entries of each vertex; group and value (n,) of
    the entries, vertex after vertex in Blender's own order.
    """

    names: tuple[str, ...]
    locked: np.ndarray
    active: int
    counts: np.ndarray
    group: np.ndarray
    value: np.ndarray

    @property
    def vertex(self) -> np.ndarray:
        """Vertex of each entry (n,)."""
        return np.repeat(np.arange(len(self.counts), dtype=np.int32), self.counts)

    def of_bones(self, bone_names: Sequence[str]) -> BoneWeights:
        """The entries of groups named after bones, columns in the order of the names."""
        position = {name: i for i, name in enumerate(bone_names)}
        column = np.array([position.get(name, -1) for name in self.names], np.int32)
        if not len(column):
            return BoneWeights(np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0, np.float32))
        bone = column[self.group]
        return BoneWeights(self.vertex, bone, self.value).where(bone >= 0)

    def column(self, name: str) -> np.ndarray:
        """Weights (V,) of the group with this name, 0 where a vertex is not in it."""
        weights = np.zeros(len(self.counts), np.float32)
        if name in self.names:
            mine = self.group == self.names.index(name)
            weights[self.vertex[mine]] = self.value[mine]
        return weights

    def locked_bones(self, bone_names: Sequence[str]) -> np.ndarray:
        """Which bones (B,) have a group that is locked."""
        names = {name for name, locked in zip(self.names, self.locked, strict=True) if locked}
        return np.array([name in names for name in bone_names], np.bool_)


def read_groups(ob: bpy.types.Object) -> GroupWeights:
    """Everything about the object's vertex groups."""
    counts, group, value = _entries(ob.data)
    return GroupWeights(
        names=tuple(g.name for g in ob.vertex_groups),
        locked=np.array([g.lock_weight for g in ob.vertex_groups], np.bool_),
        active=ob.vertex_groups.active_index,
        counts=np.array(counts, np.int32),
        group=np.array(group, np.int32),
        value=np.array(value, np.float32),
    )


def _entries(mesh: bpy.types.Mesh) -> tuple[list[int], list[int], list[float]]:
    """How many entries each vertex (V) has, and the group and the value of all of them (n), vertex after vertex."""
    copy = bmesh.new()
    try:
        copy.from_mesh(mesh, face_normals=False, vertex_normals=False)
        layer = copy.verts.layers.deform.active
        if layer is None:
            return [0] * len(mesh.vertices), [], []
        counts: list[int] = []
        group: list[int] = []
        value: list[float] = []
        for vertex in copy.verts:
            entries = vertex[layer]
            counts.append(len(entries))
            group += entries.keys()
            value += entries.values()
        return counts, group, value
    finally:
        copy.free()


def write_groups(
    ob: bpy.types.Object,
    bone_names: Sequence[str],
    weights: BoneWeights,
    replaced: np.ndarray,
    created: Sequence[int],
    written: np.ndarray | None = None,
) -> None:
    """Replace the weights of the vertices `replaced` (m,) in the unlocked groups of the bones `written` (B,).

    Missing groups of the bones `created` are added at the end, in that order. Groups that are
    locked or belong to no bone are not touched, and the active group stays active.
    """
    groups = ob.vertex_groups
    active = groups.active_index
    for bone in created:
        if bone_names[bone] not in groups:
            groups.new(name=bone_names[bone])
    if active >= 0:
        groups.active_index = active
    found = ((bone, groups.get(name)) for bone, name in enumerate(bone_names))
    unlocked = [
        (bone, group)
        for bone, group in found
        if group is not None and not group.lock_weight and (written is None or written[bone])
    ]
    clear = replaced.tolist()
    if clear:
        for _, group in unlocked:
            group.remove(clear)
    for bone, group in unlocked:
        mine = weights.bone == bone
        _add(group, weights.vertex[mine], weights.value[mine])


def restore_groups(ob: bpy.types.Object, before: GroupWeights) -> None:
    """Bring the groups back to what `before` holds, the order of each vertex's entries included."""
    groups = ob.vertex_groups
    for group in reversed(list(groups)):
        if group.name not in before.names:
            groups.remove(group)
    everything = list(range(len(ob.data.vertices)))
    for group in groups:
        group.remove(everything)
    if len(before.counts):
        vertex = before.vertex
        starts = np.cumsum(before.counts) - before.counts
        slot = np.arange(len(vertex)) - starts[vertex]
        for position in range(int(before.counts.max())):
            for index, group in enumerate(groups):
                mine = (slot == position) & (before.group == index)
                _add(group, vertex[mine], before.value[mine])
    for group, locked in zip(groups, before.locked, strict=True):
        group.lock_weight = bool(locked)
    if before.active >= 0:
        groups.active_index = before.active


def _add(group: bpy.types.VertexGroup, vertex: np.ndarray, value: np.ndarray) -> None:
    """Put vertices into a group, those of equal weight in one call."""
    if not len(vertex):
        return
    order = np.lexsort((vertex, value))
    vertex, value = vertex[order], value[order]
    first = np.flatnonzero(np.concatenate([[True], value[1:] != value[:-1]])).tolist()
    vertices, values = vertex.tolist(), value.tolist()
    for start, end in zip(first, [*first[1:], len(vertices)], strict=True):
        group.add(vertices[start:end], values[start], "REPLACE")
