# SPDX-License-Identifier: GPL-3.0-or-later
"""The main job of Dermis on two MakeHuman bodies, in Blender without a window.

A painted young man is the source; the target is another body with its own skeleton, decimated and
shuffled so that no vertex number tells anything, and without weights. The installed extension's
operator retargets the weights; then both take the same poses.

Writes demo/*.png, demo/demo.blend and demo/report.json, and prints a table. `--docs` also renews
the picture in the README.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from pathlib import Path
from typing import Any

import extension  # before bpy, which looks for its profile when it starts

# isort: split
import bpy
import makehuman
import numpy as np
import pictures
import poses
import scene

FOLDER = Path(__file__).resolve().parent
README_PICTURE = FOLDER.parent / "docs" / "images" / "retarget.png"
BODIES = {
    "old_woman": makehuman.OLD_WOMAN,
    "heavy": makehuman.HEAVY,
    "child": makehuman.CHILD,
    "average": makehuman.AVERAGE,
}
TARGET_TRIANGLES = 12000
SEPARATION = 0.6  # metres from the middle to each body


def say(text: str) -> None:
    """One line of progress."""
    print(f"==> {text}", flush=True)


def make_bodies(target_body: str) -> tuple[makehuman.Character, makehuman.Character]:
    """The painted source and the target with its true weights."""
    source = makehuman.body("Source", **makehuman.YOUNG_MALE)
    target = makehuman.body("Target", **BODIES[target_body])
    return source, makehuman.permuted(makehuman.decimated(target, TARGET_TRIANGLES), seed=1)


def place(character: makehuman.Character, x: float) -> bpy.types.Object:
    """A mesh with its armature, moved aside."""
    armature = scene.add_armature(character)
    body = scene.add_mesh(character, f"{character.name} clay")
    scene.attach(body, armature)
    armature.location.x = x
    return body


def retarget(source: bpy.types.Object, target: bpy.types.Object, options: dict[str, Any]) -> float:
    """Call the operator as a user would; returns its seconds."""
    bpy.ops.object.select_all(action="DESELECT")
    source.select_set(True)
    target.select_set(True)
    bpy.context.view_layer.objects.active = source
    start = time.perf_counter()
    result = bpy.ops.dermis.retarget_weights(**options)
    if result != {"FINISHED"}:
        raise RuntimeError(f"dermis.retarget_weights returned {result}")
    return time.perf_counter() - start


def check(weights: np.ndarray) -> None:
    """What holds for every result."""
    if not np.isfinite(weights).all() or weights.min() < 0.0:
        raise RuntimeError("a weight is negative or not a number")
    worst = np.abs(weights.sum(axis=1) - 1.0).max()
    if worst > 1e-6:
        raise RuntimeError(f"the weights of a vertex miss a sum of 1 by {worst:.2e}")


def errors(weights: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """L1 distance between each vertex's weights and the true ones: 0 is equal, 2 has no bone in common."""
    distance = np.abs(weights - truth).sum(axis=1)
    return {
        "mean": float(distance.mean()),
        "median": float(np.median(distance)),
        "percentile_95": float(np.percentile(distance, 95)),
    }


def render_all(source: bpy.types.Object, target: bpy.types.Object) -> list[Path]:
    """One picture for each pose, and one of the weights."""
    for old in FOLDER.glob("*.png"):
        old.unlink()
    paths = []
    for number, pose in enumerate(poses.POSES):
        say(f"Rendering the pose: {pose}")
        path = FOLDER / f"pose_{number}_{pose}.png"
        scene.render(path, poses.frame_of(pose))
        paths.append(path)
    say("Rendering the weights")
    clay = {body: body.data.materials[0] for body in (source, target)}
    shown = scene.weight_material()
    for body in clay:
        body.data.materials[0] = shown
    paths.append(FOLDER / "weights.png")
    scene.render(paths[-1], 1)
    for body, material in clay.items():
        body.data.materials[0] = material
    for path in paths:
        pictures.flatten(path)
    return paths


def table(report: dict[str, Any]) -> str:
    """The report for human eyes."""
    counts, seconds, error = report["counts"], report["seconds"], report["l1_error"]
    rows = [
        ("source", f"{counts['source_vertices']} vertices, {counts['bones']} bones"),
        ("target", f"{counts['target_vertices']} vertices ({report['target_body']}, decimated, shuffled)"),
        ("retargeting", f"{seconds['retarget']:.1f} s, method {report['method']}"),
        ("mean L1 weight error", f"{error['retargeted']['mean']:.3f} (0 equal, 2 nothing in common)"),
        ("median, 95th percentile", f"{error['retargeted']['median']:.3f}, {error['retargeted']['percentile_95']:.3f}"),
        (
            "plain closest point",
            f"{error['closest_point']['mean']:.3f} (the error of copying from the nearest surface)",
        ),
        ("rendering", f"{seconds['render']:.0f} s, {counts['pictures']} pictures"),
    ]
    return "\n".join(f"  {name:<24} {value}" for name, value in rows)


def parse_arguments() -> argparse.Namespace:
    """What to run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--target", choices=BODIES, default="old_woman", help="body of the target")
    parser.add_argument("--method", choices=["auto", "paper"], default="auto", help="method of the operator")
    parser.add_argument("--no-render", action="store_true", help="leave out the pictures")
    parser.add_argument("--docs", action="store_true", help="renew the picture in the README")
    return parser.parse_args()


def main(arguments: argparse.Namespace) -> None:
    """Retarget, pose, render, save, report."""
    start = time.perf_counter()
    zip_path = extension.built_zip()
    say(f"Installing {zip_path.name} into a scratch profile of Blender {bpy.app.version_string}")
    extension.install(zip_path)

    say("Building two MakeHuman bodies")
    source_character, target_character = make_bodies(arguments.target)
    source = place(source_character, -SEPARATION)
    target = place(target_character, SEPARATION)
    scene.paint(source, source_character)

    say("Retargeting the weights with dermis.retarget_weights")
    seconds = retarget(source, target, {"method": arguments.method.upper()})
    names = source_character.bone_names
    weights = scene.read_weights(target, names)
    check(weights)

    scene.colour_by_weights(source, source_character.weights)
    scene.colour_by_weights(target, weights)
    for body in (source, target):
        poses.key_poses(body.parent, body)
    scene.build_studio(height=1.95, width=2.5)
    rendering = time.perf_counter()
    paths = [] if arguments.no_render else render_all(source, target)
    rendered = time.perf_counter() - rendering

    bpy.context.scene.frame_set(1)
    bpy.context.scene.render.filepath = "//"
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "demo.blend"), compress=True)

    report = {
        "blender": bpy.app.version_string,
        "extension": zip_path.name,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "method": arguments.method,
        "target_body": arguments.target,
        "result": target.dermis_retarget.result,
        "counts": {
            "bones": len(names),
            "source_vertices": len(source_character.vertices),
            "target_vertices": len(target_character.vertices),
            "pictures": len(paths),
        },
        "l1_error": {
            "retargeted": errors(weights, target_character.weights),
            "closest_point": errors(
                makehuman.interpolated_weights(source_character, target_character.vertices), target_character.weights
            ),
        },
        "seconds": {"retarget": seconds, "render": rendered, "total": time.perf_counter() - start},
    }
    (FOLDER / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    if arguments.docs and paths:
        chosen = [
            FOLDER / "weights.png",
            *(path for path in paths if path.stem.startswith("pose_") and path != paths[0]),
        ]
        captions = ["weights: source, target", *(f"pose: {path.stem.split('_')[-1]}" for path in chosen[1:])]
        pictures.contact_sheet(chosen, captions, README_PICTURE)
    say(f"Done: {'demo/*.png, ' if paths else ''}demo/demo.blend, demo/report.json")
    print(table(report), flush=True)


if __name__ == "__main__":
    chosen_arguments = parse_arguments()
    extension.run(lambda: main(chosen_arguments))
