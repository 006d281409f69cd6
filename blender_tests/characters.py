# SPDX-License-Identifier: GPL-3.0-or-later
"""Small characters for the tests, and everything about an object as one comparable value."""

import bpy
import numpy as np
from mathutils import Vector

BODY = {
    # bone: (parent, head, tail, radius of the limb); the left side is mirrored
    "hips": (None, (0, 0, 1.0), (0, 0, 1.2), 0.16),
    "chest": ("hips", (0, 0, 1.2), (0, 0, 1.5), 0.17),
    "head": ("chest", (0, 0, 1.55), (0, 0, 1.8), 0.12),
    "arm": ("chest", (0.17, 0, 1.45), (0.5, 0, 1.45), 0.07),
    "hand": ("arm", (0.5, 0, 1.45), (0.85, 0, 1.45), 0.06),
    "thigh": ("hips", (0.1, 0, 0.95), (0.13, 0, 0.5), 0.09),
    "shin": ("thigh", (0.13, 0, 0.5), (0.14, 0, 0.05), 0.07),
}


def armature(name, bones):
    """An armature of bones (name, parent name or None, head, tail)."""
    ob = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    bpy.context.collection.objects.link(ob)
    activate(ob)
    bpy.ops.object.mode_set(mode="EDIT")
    for bone_name, parent, head, tail in bones:
        bone = ob.data.edit_bones.new(bone_name)
        bone.head, bone.tail = head, tail
        if parent is not None:
            bone.parent = ob.data.edit_bones[parent]
    bpy.ops.object.mode_set(mode="OBJECT")
    return ob


def mesh_object(name, vertices, faces):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(map(float, v)) for v in vertices], [], faces)
    ob = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(ob)
    return ob


def tube(segments, rings, height=3.0, radius=0.5):
    """Vertices and faces of a capped cylinder along z."""
    angles = np.arange(segments) * (2 * np.pi / segments)
    circle = np.stack([np.cos(angles), np.sin(angles)], 1) * radius
    heights = np.linspace(0, height, rings)
    vertices = [(x, y, z) for z in heights for x, y in circle] + [(0, 0, 0), (0, 0, height)]
    faces = []
    for ring in range(rings - 1):
        for i in range(segments):
            a, b = ring * segments + i, ring * segments + (i + 1) % segments
            faces.append((a, b, b + segments, a + segments))
    last = (rings - 1) * segments
    for i in range(segments):
        j = (i + 1) % segments
        faces.append((j, i, rings * segments))
        faces.append((last + i, last + j, rings * segments + 1))
    return vertices, faces


def tube_bones(height=3.0):
    return [
        (name, parent, (0, 0, i * height / 3), (0, 0, (i + 1) * height / 3))
        for i, (name, parent) in enumerate([("lower", None), ("middle", "lower"), ("upper", "middle")])
    ]


def paint(ob, rig, falloff=8.0):
    """Smooth weights by distance to the bones of the armature, one group for each bone."""
    points = np.array([ob.matrix_world @ v.co for v in ob.data.vertices])
    distances = []
    for bone in rig.data.bones:
        head = np.array(rig.matrix_world @ bone.head_local)
        axis = np.array(rig.matrix_world @ bone.tail_local) - head
        along = np.clip((points - head) @ axis / (axis @ axis), 0, 1)
        distances.append(np.linalg.norm(points - head - along[:, None] * axis, axis=1))
    values = np.exp(-falloff * (np.array(distances).T - np.min(distances, axis=0)[:, None]))
    values[values < 0.02] = 0
    values /= values.sum(axis=1, keepdims=True)
    for bone, column in zip(rig.data.bones, values.T, strict=True):
        group = ob.vertex_groups.new(name=bone.name)
        for vertex in np.flatnonzero(column):
            group.add([int(vertex)], float(column[vertex]), "REPLACE")
    return values


def deform(ob, rig, parent=True):
    modifier = ob.modifiers.new("Armature", "ARMATURE")
    modifier.object = rig
    if parent:
        ob.parent = rig


def source_tube(name="Source", segments=12, rings=13):
    """A painted tube with its armature of three bones."""
    rig = armature(f"{name}Rig", tube_bones())
    ob = mesh_object(name, *tube(segments, rings))
    paint(ob, rig)
    deform(ob, rig)
    return ob, rig


def target_tube(name="Target", segments=9, rings=16, radius=0.6):
    """A bare tube with another topology at the same place."""
    return mesh_object(name, *tube(segments, rings, radius=radius))


def biped_bones(arm=1.0, leg=1.0):
    bones = []
    for name, (parent, head, tail, _) in BODY.items():
        head, tail = _stretched(name, head, arm, leg), _stretched(name, tail, arm, leg)
        if name in ("hips", "chest", "head"):
            bones.append((name, parent, head, tail))
            continue
        for side, sign in (("L", 1), ("R", -1)):
            above = f"{parent}.{side}" if parent in ("arm", "thigh") else parent
            bones.append((f"{name}.{side}", above, (sign * head[0], *head[1:]), (sign * tail[0], *tail[1:])))
    return bones


def biped(name, arm=1.0, leg=1.0, voxel=0.05, seed=None):
    """A closed body grown around its bones, with its armature; vertices shuffled by a seed."""
    bones = biped_bones(arm, leg)
    rig = armature(f"{name}Rig", bones)
    vertices, faces = [], []
    for bone, _, head, tail in bones:
        ball_vertices, ball_faces = _capsule(Vector(head), Vector(tail), BODY[bone.split(".")[0]][3])
        faces += [tuple(len(vertices) + i for i in face) for face in ball_faces]
        vertices += ball_vertices
    ob = mesh_object(name, vertices, faces)
    remesh = ob.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", voxel
    joined = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.array([v.co for v in joined.vertices])
    polygons = [tuple(p.vertices) for p in joined.polygons]
    bpy.data.objects.remove(ob)
    bpy.context.view_layer.update()
    order = np.arange(len(points)) if seed is None else np.random.default_rng(seed).permutation(len(points))
    place = np.argsort(order)
    return mesh_object(name, points[order], [tuple(int(place[i]) for i in face) for face in polygons]), rig


def activate(source, *others):
    """Make an object active and select it and the others, nothing else."""
    for ob in bpy.context.view_layer.objects:
        ob.select_set(False)
    for ob in (source, *others):
        ob.select_set(True)
    bpy.context.view_layer.objects.active = source


def retarget(source, *targets, **options):
    """The operator on these objects."""
    activate(source, *targets)
    return bpy.ops.dermis.retarget_weights(**options)


def add_landmarks(source, target, pairs):
    """Landmark pairs (source vertex, target vertex) on the target."""
    for source_vertex, target_vertex in pairs:
        landmark = target.dermis_retarget.landmarks.add()
        landmark.source_vertex, landmark.target_vertex = source_vertex, target_vertex
    target.dermis_retarget.landmark_source = source


def dense(ob, names):
    """Weights (V,B) of the groups with these names."""
    index = {ob.vertex_groups[name].index: i for i, name in enumerate(names) if name in ob.vertex_groups}
    weights = np.zeros((len(ob.data.vertices), len(names)))
    for vertex in ob.data.vertices:
        for entry in vertex.groups:
            if entry.group in index:
                weights[vertex.index, index[entry.group]] = entry.weight
    return weights


def bone_names(rig):
    return [bone.name for bone in rig.data.bones if bone.use_deform]


def state(ob):
    """Everything that a retargeting could change, exactly."""
    mesh = ob.data
    return {
        "groups": [(g.name, g.index, g.lock_weight) for g in ob.vertex_groups],
        "active group": ob.vertex_groups.active_index,
        "weights": [[(entry.group, entry.weight) for entry in v.groups] for v in mesh.vertices],
        "points": [repr(tuple(v.co)) for v in mesh.vertices],
        "modifiers": [(m.name, m.type, m.show_viewport, getattr(m, "object", None)) for m in ob.modifiers],
        "active modifier": ob.modifiers.active and ob.modifiers.active.name,
        "parent": (ob.parent, ob.parent_type, ob.parent_bone),
        "parent inverse": [tuple(row) for row in ob.matrix_parent_inverse],
        "basis": [tuple(row) for row in ob.matrix_basis],
        "mode": ob.mode,
        "data": (mesh.name, mesh.users),
        "result": ob.dermis_retarget.result,
    }


def _stretched(name, point, arm, leg):
    x, y, z = point
    if name in ("arm", "hand"):
        return (0.17 + (x - 0.17) * arm, y, z)
    if name in ("thigh", "shin"):
        return (x, y, 0.95 + (z - 0.95) * leg)
    return point


def _capsule(head, tail, radius, segments=10, rings=8):
    axis = (tail - head).normalized()
    turn = Vector((0, 0, 1)).rotation_difference(axis)
    vertices, faces = [], []
    for ring in range(rings + 1):
        angle = np.pi * ring / rings
        centre = head if ring > rings / 2 else tail
        for i in range(segments):
            around = 2 * np.pi * i / segments
            spot = Vector((np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)))
            vertices.append(tuple(centre + turn @ (spot * radius)))
    for ring in range(rings):
        for i in range(segments):
            a, b = ring * segments + i, ring * segments + (i + 1) % segments
            faces.append((a, a + segments, b + segments, b))
    return vertices, faces
