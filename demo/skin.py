# SPDX-License-Identifier: GPL-3.0-or-later
"""What the PBD skin does to joints: one MakeHuman body, one joint at a time, in Blender without a window.

Each pose is rendered with the plain Armature modifier, with Preserve Volume, and with the skin that
the installed extension's operator switches on. Writes demo/skin_*.png; `--docs` also renews the
picture in the README.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import extension  # before bpy, which looks for its profile when it starts

# isort: split
import bpy
import makehuman
import pictures
import poses
import scene
from mathutils import Vector

FOLDER = Path(__file__).resolve().parent
README_PICTURE = FOLDER.parent / "docs" / "images" / "skin.png"
METHODS = ("plain", "preserve volume", "Dermis")

# Pose: turns as in poses.py, the bone at whose head (or tail) the camera looks, metres across, and
# the direction from which it looks.
CLOSE_UPS = {
    "rest": ({}, "spine_02", 1.95, (0.2, -1.0, 0.1)),
    "elbow": ({"lowerarm_l": [(poses.LEFT, -80)]}, "lowerarm_l", 0.5, (0.9, -0.9, 0.1)),
    "knee": ({"thigh_l": [(poses.LEFT, -60)], "calf_l": [(poses.LEFT, 120)]}, "calf_l", 0.75, (1.0, -0.35, 0.1)),
    "forearm": ({"lowerarm_l": "twist"}, "lowerarm_l", 0.55, (0.2, -1.0, 0.25)),
    "hip": ({"thigh_l": [(poses.LEFT, -90)]}, "thigh_l", 0.8, (1.0, -0.5, 0.3)),
}
TWIST = 120.0


def say(text: str) -> None:
    """One line of progress."""
    print(f"==> {text}", flush=True)


def pose(armature: bpy.types.Object, turns: dict) -> None:
    """Turn the named bones, all others at rest."""
    for bone in armature.pose.bones:
        turn = turns.get(bone.name, [])
        if turn == "twist":
            turn = [(bone_axis(bone), TWIST)]
        bone.rotation_quaternion = poses.local_rotation(bone, turn)
    bpy.context.view_layer.update()


def bone_axis(bone: bpy.types.PoseBone) -> Vector:
    """Direction of a bone at rest, in the armature's axes."""
    return (bone.bone.tail_local - bone.bone.head_local).normalized()


def look_at(target: Vector, across: float, direction: tuple[float, float, float]) -> None:
    """Put the camera so that a square of this size around the target fills the picture."""
    camera = bpy.context.scene.camera
    towards = Vector(direction).normalized()
    camera.location = target + towards * (camera.data.lens / camera.data.sensor_width * across)
    camera.rotation_euler = (-towards).to_track_quat("-Z", "Y").to_euler()


def use(body: bpy.types.Object, method: str) -> None:
    """Deform the body by one of the methods."""
    bpy.ops.object.select_all(action="DESELECT")
    body.select_set(True)
    bpy.context.view_layer.objects.active = body
    if method == "Dermis":
        if bpy.ops.dermis.skin_enable() != {"FINISHED"}:
            raise RuntimeError("dermis.skin_enable did not finish")
    elif body.data.shape_keys:
        bpy.ops.dermis.skin_disable()
    body.modifiers["Armature"].use_deform_preserve_volume = method == "preserve volume"


def render_all(body: bpy.types.Object) -> list[Path]:
    """A strip for each pose: the methods side by side."""
    armature = body.parent
    shots: dict[str, list[Path]] = {name: [] for name in CLOSE_UPS}
    for method in METHODS:
        pose(armature, {})
        use(body, method)
        for name, (turns, bone, across, direction) in CLOSE_UPS.items():
            say(f"Rendering {name}: {method}")
            pose(armature, turns)
            look_at(armature.pose.bones[bone].head, across, direction)
            path = FOLDER / f"skin_{name}_{METHODS.index(method)}.png"
            bpy.context.scene.render.filepath = str(path)
            bpy.ops.render.render(write_still=True)
            pictures.flatten(path)
            shots[name].append(path)
    strips = []
    for name, paths in shots.items():
        strips.append(FOLDER / f"skin_{name}.png")
        pictures.contact_sheet(paths, [f"{name}: {method}" for method in METHODS], strips[-1])
        for path in paths:
            path.unlink()
    return strips


def main(docs: bool) -> None:
    """Build, pose, render."""
    zip_path = extension.built_zip()
    say(f"Installing {zip_path.name} into a scratch profile of Blender {bpy.app.version_string}")
    extension.install(zip_path)
    character = makehuman.body("Source", **makehuman.YOUNG_MALE)
    armature = scene.add_armature(character)
    body = scene.add_mesh(character, "Source clay")
    scene.attach(body, armature)
    scene.paint(body, character)
    scene.build_studio(height=1.95, width=1.0)
    bpy.data.objects["Floor"].hide_render = True
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 420
    strips = render_all(body)
    if docs:
        pictures.stack(strips[1:], README_PICTURE)
    say("Done: " + ", ".join(f"demo/{strip.name}" for strip in strips))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="renew the picture in the README")
    arguments = parser.parse_args()
    extension.run(lambda: main(arguments.docs))
