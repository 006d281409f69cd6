# SPDX-License-Identifier: GPL-3.0-or-later
"""Characters as Blender objects, a small studio around them, and pictures of it."""

from __future__ import annotations

import colorsys
from pathlib import Path

import bpy
import numpy as np
from makehuman import Character
from mathutils import Vector

CLAY = {"Source clay": (0.46, 0.27, 0.19), "Target clay": (0.20, 0.33, 0.38)}  # linear RGB
BACKGROUND = (0.82, 0.83, 0.85)
GOLDEN_RATIO = 0.618033988749895
WEIGHTS = "Weights"  # colour attribute and material of the weight pictures


def add_armature(character: Character) -> bpy.types.Object:
    """An armature object with the character's bones, in Pose Mode's rotation by quaternions."""
    armature = bpy.data.objects.new(f"{character.name} rig", bpy.data.armatures.new(f"{character.name} rig"))
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bones = armature.data.edit_bones
    for index, name in enumerate(character.bone_names):
        bone = bones.new(name)
        bone.head, bone.tail = character.heads[index], character.tails[index]
        bone.roll = character.rolls[index]
        if character.parents[index] >= 0:
            bone.parent = bones[character.bone_names[character.parents[index]]]
    bpy.ops.object.mode_set(mode="OBJECT")
    for pose_bone in armature.pose.bones:
        pose_bone.rotation_mode = "QUATERNION"
    armature.data.display_type = "STICK"
    armature.show_in_front = True
    return armature


def add_mesh(character: Character, material: str) -> bpy.types.Object:
    """A smooth-shaded mesh object of the character's surface, without weights."""
    mesh = bpy.data.meshes.new(character.name)
    counts, corners = character.loop_counts, character.loop_indices
    mesh.vertices.add(len(character.vertices))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(character.vertices, np.float32).ravel())
    mesh.loops.add(len(corners))
    mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(corners, np.int32))
    mesh.polygons.add(len(counts))
    mesh.polygons.foreach_set("loop_start", np.ascontiguousarray(np.cumsum(counts) - counts, np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(counts), bool))
    mesh.update(calc_edges=True)
    if mesh.validate(verbose=True):
        raise RuntimeError(f"Blender had to repair the mesh of {character.name}")
    mesh.materials.append(clay_material(material))
    body = bpy.data.objects.new(character.name, mesh)
    bpy.context.scene.collection.objects.link(body)
    return body


def attach(body: bpy.types.Object, armature: bpy.types.Object) -> None:
    """Parent a mesh to an armature and let it follow, as Parent > Armature Deform does."""
    body.parent = armature
    body.modifiers.new("Armature", "ARMATURE").object = armature


def paint(body: bpy.types.Object, character: Character) -> None:
    """Write the character's own weights into vertex groups."""
    for column, name in enumerate(character.bone_names):
        group = body.vertex_groups.new(name=name)
        for vertex in np.nonzero(character.weights[:, column])[0]:
            group.add([int(vertex)], float(character.weights[vertex, column]), "REPLACE")


def read_weights(body: bpy.types.Object, bone_names: tuple[str, ...]) -> np.ndarray:
    """(V,B) weights in the mesh's vertex groups, columns in the order of the names."""
    column = {body.vertex_groups[name].index: i for i, name in enumerate(bone_names) if name in body.vertex_groups}
    dense = np.zeros((len(body.data.vertices), len(bone_names)))
    for vertex in body.data.vertices:
        for element in vertex.groups:
            if element.group in column:
                dense[vertex.index, column[element.group]] = element.weight
    return dense


def colour_by_weights(body: bpy.types.Object, weights: np.ndarray) -> None:
    """Store one colour for each bone, mixed by the weights, as a colour attribute."""
    colours = np.array([bone_colour(bone) for bone in range(weights.shape[1])])
    mixed = np.ones((len(weights), 4), np.float32)
    mixed[:, :3] = weights @ colours
    attribute = body.data.color_attributes.new(WEIGHTS, "FLOAT_COLOR", "POINT")
    attribute.data.foreach_set("color", mixed.ravel())


def bone_colour(bone: int) -> tuple[float, float, float]:
    """Colours of neighbouring numbers lie far apart."""
    return colorsys.hsv_to_rgb(bone * GOLDEN_RATIO % 1.0, 0.75, (0.9, 0.55, 0.75)[bone % 3])


def clay_material(name: str) -> bpy.types.Material:
    """A matt material of the given name and colour."""
    material = bpy.data.materials.get(name)
    if material is None:
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        shader = material.node_tree.nodes["Principled BSDF"]
        shader.inputs["Base Color"].default_value = (*CLAY[name], 1.0)
        shader.inputs["Roughness"].default_value = 0.55
        material.diffuse_color = (*CLAY[name], 1.0)
    return material


def weight_material() -> bpy.types.Material:
    """Shows the colour attribute of the weights."""
    material = bpy.data.materials.new(WEIGHTS)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    colour = nodes.new("ShaderNodeVertexColor")
    colour.layer_name = WEIGHTS
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.8
    material.node_tree.links.new(colour.outputs["Color"], shader.inputs["Base Color"])
    return material


def build_studio(height: float, width: float) -> None:
    """Camera, lights, floor and render settings for bodies of this height, standing in this width."""
    scene = bpy.context.scene
    world = scene.world or bpy.data.worlds.new("World")
    scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*BACKGROUND, 1.0)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.3

    centre = Vector((0.0, 0.0, 0.47 * height))
    for name, place, size, power in [
        ("Key", (-2.2, -3.0, 3.2), 1.4, 160.0),
        ("Fill", (3.2, -2.6, 1.8), 2.5, 45.0),
        ("Rim", (1.2, 3.0, 3.0), 1.6, 70.0),
    ]:
        data = bpy.data.lights.new(name, "AREA")
        data.size, data.energy = size, power
        light = bpy.data.objects.new(name, data)
        light.location = place
        light.rotation_euler = (centre - Vector(place)).to_track_quat("-Z", "Y").to_euler()
        scene.collection.objects.link(light)

    bpy.ops.mesh.primitive_plane_add(size=40.0)
    floor = bpy.context.object
    floor.name = "Floor"
    floor.is_shadow_catcher = True

    data = bpy.data.cameras.new("Camera")
    data.lens = 70.0
    camera = bpy.data.objects.new("Camera", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    render = scene.render
    render.resolution_x, render.resolution_y = 800, 680
    aspect = render.resolution_x / render.resolution_y
    # The sensor's longer side is 36 mm and spans the picture's width.
    distance = data.lens / data.sensor_width * max(width, aspect * height) * 1.08
    direction = Vector((0.18, -1.0, 0.16)).normalized()
    camera.location = centre + distance * direction
    camera.rotation_euler = (-direction).to_track_quat("-Z", "Y").to_euler()

    render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 12
    scene.cycles.use_denoising = True
    scene.cycles.max_bounces = 2
    render.film_transparent = True
    render.use_persistent_data = True
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode = "RGBA"
    scene.view_settings.view_transform = "Standard"


def render(path: Path, frame: int) -> None:
    """A picture of one frame."""
    scene = bpy.context.scene
    scene.frame_set(frame)
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
