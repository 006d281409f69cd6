# SPDX-License-Identifier: GPL-3.0-or-later
"""From a bare mesh to a moving character in three clicks, in Blender without a window.

A MakeHuman body without bones and weights, decimated and shuffled, gets one of Rigify's metarigs. The
installed extension's operators fit the metarig into the body, bind it, and switch the PBD skin on; then
it takes poses. Writes demo/fit.png and demo/fit.blend; `--docs` also renews the picture in the README.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import extension  # before bpy, which looks for its profile when it starts

# isort: split
import addon_utils
import bpy
import makehuman
import numpy as np
import pictures
import poses
import scene
from mathutils import Vector

FOLDER = Path(__file__).resolve().parent
README_PICTURE = FOLDER.parent / "docs" / "images" / "fit.png"
BODIES = {
    "average": makehuman.AVERAGE,
    "young_male": makehuman.YOUNG_MALE,
    "old_woman": makehuman.OLD_WOMAN,
    "heavy": makehuman.HEAVY,
    "child": makehuman.CHILD,
}
TRIANGLES = 12000
POSES = ("arms", "knees", "twist")
# Rigify's bones for those of the demo's poses.
RIGIFY = {
    "spine_01": "spine.001",
    "spine_02": "spine.002",
    "spine_03": "spine.003",
    "neck_01": "spine.004",
    "head": "spine.006",
    "clavicle": "shoulder",
    "upperarm": "upper_arm",
    "lowerarm": "forearm",
    "thigh": "thigh",
    "calf": "shin",
    "foot": "foot",
}
BONE_COLOUR = (1.0, 0.45, 0.05, 1.0)
JOINT_COLOUR = (1.0, 0.85, 0.3, 1.0)


def say(text: str) -> None:
    """One line of progress."""
    print(f"==> {text}", flush=True)


def add_metarig(kind: str) -> bpy.types.Object:
    """A metarig where Blender puts it, in its own size."""
    addon_utils.enable("rigify", default_set=True)
    add = getattr(bpy.ops.object, f"armature_{kind}_metarig_add")
    if add() != {"FINISHED"}:
        raise RuntimeError(f"the metarig {kind} was not added")
    rig = bpy.context.object
    for bone in rig.pose.bones:
        bone.rotation_mode = "QUATERNION"
    return rig


def click(operator: str, rig: bpy.types.Object, body: bpy.types.Object) -> None:
    """Call an operator as a user would, with the body and the active armature selected."""
    bpy.ops.object.select_all(action="DESELECT")
    body.select_set(True)
    rig.select_set(True)
    bpy.context.view_layer.objects.active = rig
    if getattr(bpy.ops.dermis, operator)() != {"FINISHED"}:
        raise RuntimeError(f"dermis.{operator} did not finish")


def check(rig: bpy.types.Object, body: bpy.types.Object) -> None:
    """What holds for every character that the three clicks made."""
    names = tuple(bone.name for bone in rig.data.bones if bone.use_deform)
    worst = np.abs(scene.read_weights(body, names).sum(axis=1) - 1.0).max()
    if worst > 1e-5:
        raise RuntimeError(f"the weights of a vertex miss a sum of 1 by {worst:.2e}")
    if "Dermis" not in body.data.shape_keys.key_blocks:
        raise RuntimeError("the body has no PBD skin")


def pose(rig: bpy.types.Object, body: bpy.types.Object, name: str) -> None:
    """Take a pose, with the lowest point of the body on the floor."""
    turns = {}
    for bone, bone_turns in poses.POSES[name].items():
        stem, side = (bone[:-2], bone[-2:]) if bone.endswith(("_l", "_r")) else (bone, "")
        turns[RIGIFY[stem] + {"_l": ".L", "_r": ".R", "": ""}[side]] = bone_turns
    for bone in rig.pose.bones:
        bone.rotation_quaternion = poses.local_rotation(bone, turns.get(bone.name, []))
    rig.location.z = 0.0
    bpy.context.view_layer.update()
    rig.location.z = -poses.lowest_point(body)
    bpy.context.view_layer.update()


def bone_mesh(rig: bpy.types.Object) -> bpy.types.Object:
    """The bones at rest as octahedra with balls at their joints, in flat colours."""
    vertices, faces, materials = [], [], []
    for bone in rig.data.bones:
        head, tail = (rig.matrix_world @ point for point in (bone.head_local, bone.tail_local))
        across = (rig.matrix_world.to_3x3() @ bone.matrix_local.to_3x3()).normalized()
        width = min(0.1 * bone.length, 0.012)
        waist = head.lerp(tail, 0.12)
        ring = [waist + width * sign * across.col[axis] for axis, sign in ((0, 1), (2, 1), (0, -1), (2, -1))]
        corners = [head, tail, *ring]
        sides = [(end, 2 + i, 2 + (i + 1) % 4) for end in (0, 1) for i in range(4)]
        add_part(vertices, faces, materials, corners, sides, 0)
        for end in (head, tail):
            radius = min(0.12 * bone.length, 0.011)
            corners = [end + radius * Vector(step) for step in OCTAHEDRON]
            add_part(vertices, faces, materials, corners, OCTAHEDRON_FACES, 1)
    mesh = bpy.data.meshes.new("Bones")
    mesh.from_pydata(vertices, [], faces)
    for name, colour in (("Bone", BONE_COLOUR), ("Joint", JOINT_COLOUR)):
        mesh.materials.append(flat_material(name, colour))
    mesh.polygons.foreach_set("material_index", np.array(materials, np.int32))
    shown = bpy.data.objects.new("Bones", mesh)
    bpy.context.scene.collection.objects.link(shown)
    return shown


OCTAHEDRON = ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
OCTAHEDRON_FACES = [(end, i, (i + 1) % 4) for end in (4, 5) for i in range(4)]


def add_part(vertices: list, faces: list, materials: list, corners: list, sides: list, material: int) -> None:
    """Append faces over corners to the lists of a mesh."""
    faces += [tuple(len(vertices) + corner for corner in side) for side in sides]
    vertices += [tuple(corner) for corner in corners]
    materials += [material] * len(sides)


def flat_material(name: str, colour: tuple[float, float, float, float]) -> bpy.types.Material:
    """A material that shows its colour whatever the light."""
    material = bpy.data.materials.get(name) or bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    emission = nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = colour
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
    return material


def shoot(path: Path) -> None:
    """Render what is to be seen."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def shoot_skeleton(path: Path, rig: bpy.types.Object, body: bpy.types.Object) -> None:
    """The body from the front with the bones drawn over it."""
    shoot(path)
    bones = bone_mesh(rig)
    above = path.with_name("fit_bones.png")
    hidden = (body, bpy.data.objects["Floor"])
    shown = [ob.hide_render for ob in hidden]
    for ob in hidden:
        ob.hide_render = True
    shoot(above)
    for ob, state in zip(hidden, shown, strict=True):
        ob.hide_render = state
    bpy.data.objects.remove(bones)
    pictures.lay_over(path, above)
    above.unlink()


def look_from_the_front(height: float) -> None:
    """A studio whose camera has a body of this height in the middle of a square picture."""
    scene.build_studio(height=height, width=height)
    camera = bpy.context.scene.camera
    target = Vector((0.0, 0.0, 0.57 * height))
    distance = camera.data.lens / camera.data.sensor_width * 1.35 * height
    camera.location = target + distance * Vector((0.0, -1.0, 0.0))
    camera.rotation_euler = (target - camera.location).to_track_quat("-Z", "Y").to_euler()


def main(arguments: argparse.Namespace) -> None:
    """Build, fit, bind, pose, render."""
    zip_path = extension.built_zip()
    say(f"Installing {zip_path.name} into a scratch profile of Blender {bpy.app.version_string}")
    extension.install(zip_path)
    say(f"A bare body ({arguments.body}) and Rigify's metarig ({arguments.metarig})")
    character = makehuman.body("Body", **BODIES[arguments.body])
    body = scene.add_mesh(makehuman.permuted(makehuman.decimated(character, TRIANGLES), seed=2), "Target clay")
    rig = add_metarig(arguments.metarig)
    look_from_the_front(float(character.vertices[:, 2].max()))
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 520
    shots = []

    def picture(caption: str, take) -> None:
        if arguments.no_render:
            return
        say(f"Rendering: {caption}")
        path = FOLDER / f"fit_{len(shots)}.png"
        take(path)
        pictures.flatten(path)
        shots.append((path, caption))

    picture("bare mesh, metarig", lambda path: shoot_skeleton(path, rig, body))
    for operator in ("fit_skeleton", "bind_weights", "skin_enable"):
        say(f"dermis.{operator}")
        click(operator, rig, body)
        if operator == "fit_skeleton":
            picture("Fit Skeleton", lambda path: shoot_skeleton(path, rig, body))
    check(rig, body)
    for name in POSES:
        pose(rig, body, name)
        picture(f"Bind, PBD skin: {name}", shoot)
    bpy.context.preferences.filepaths.save_version = 0
    bpy.context.scene.render.filepath = "//"
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "fit.blend"), compress=True)
    if shots:
        paths, captions = [path for path, _ in shots], [caption for _, caption in shots]
        for target in (FOLDER / "fit.png", *([README_PICTURE] if arguments.docs else [])):
            pictures.contact_sheet(paths, captions, target, width=300)
        for path in paths:
            path.unlink()
    say(f"Done: {'demo/fit.png, ' if shots else ''}demo/fit.blend")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--body", choices=BODIES, default="average", help="the body without bones")
    parser.add_argument("--metarig", choices=["human", "basic_human"], default="human", help="the template")
    parser.add_argument("--no-render", action="store_true", help="leave out the pictures")
    parser.add_argument("--docs", action="store_true", help="renew the picture in the README")
    chosen = parser.parse_args()
    extension.run(lambda: main(chosen))
