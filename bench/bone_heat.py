"""Blender's automatic weights, for comparison; needs Blender as a Python module."""

import bpy
import numpy as np

SHORTEST = 1e-4  # Blender removes bones without length


def bone_heat(character, used):
    """Weights (V,B) that Parent > With Automatic Weights gives for the bones `used`; rows sum to 1 or are empty."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("Mesh")
    mesh.from_pydata(character.vertices.tolist(), [], character.triangles.tolist())
    ob = bpy.data.objects.new("Mesh", mesh)
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    for each in (ob, rig):
        bpy.context.collection.objects.link(each)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bones = []
    for index, name in enumerate(character.bone_names):
        bone = rig.data.edit_bones.new(name)
        head, tail = character.heads[index], character.tails[index]
        upwards = head + np.array([0, 0, 10 * SHORTEST])
        bone.head, bone.tail = head, tail if np.linalg.norm(tail - head) > SHORTEST else upwards
        bone.use_deform = bool((used == index).any())
        bones.append(bone)
    for bone, parent in zip(bones, character.parents, strict=True):
        if parent >= 0:
            bone.parent = bones[parent]
    bpy.ops.object.mode_set(mode="OBJECT")
    for each in (ob, rig):
        each.select_set(True)
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    weights = np.zeros((len(character.vertices), len(character.bone_names)))
    column = {name: i for i, name in enumerate(character.bone_names)}
    place = {group.index: column[group.name] for group in ob.vertex_groups}
    for vertex in mesh.vertices:
        for entry in vertex.groups:
            weights[vertex.index, place[entry.group]] = entry.weight
    return weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
