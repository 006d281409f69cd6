"""What one frame costs inside Blender: `frame_set` of a moving body, by the skin and by Blender's own means.

All variants play the same motion of eleven joints in turns, so that other work on the machine
disturbs them alike. Prints medians and their ratios to the plain Armature modifier and writes
`bench/skin_frames.json`. Needs the built extension:

    python bench/skin_frames.py [--rounds N] [--vertices N]
"""

import argparse
import json
import platform
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "demo"))

import extension  # noqa: E402  before bpy, which looks for its profile when it starts

# isort: split
import bpy  # noqa: E402
import makehuman  # noqa: E402
import numpy as np  # noqa: E402
import scene  # noqa: E402
from mathutils import Quaternion  # noqa: E402

FRAMES = 40
PLAIN, SKIN = "Armature modifier", "Dermis"
VARIANTS = (PLAIN, "Preserve Volume", "Corrective Smooth, 5 iterations", SKIN)
AXES = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1)}
# Axis of the bone and largest degrees of each joint that moves.
MOTION = {
    "upperarm_l": ("X", 40), "lowerarm_l": ("X", 90), "upperarm_r": ("X", 30), "lowerarm_r": ("X", 60),
    "thigh_l": ("X", -50), "calf_l": ("X", 80), "thigh_r": ("X", 40), "calf_r": ("X", 60),
    "spine_01": ("Y", 10), "spine_02": ("Y", 10), "head": ("Z", 20),
}  # fmt: skip


def animated_body(vertex_count):
    """A MakeHuman body of about so many vertices, None for its own, whose joints swing there and back twice."""
    character = makehuman.body("Body", **makehuman.YOUNG_MALE)
    if vertex_count is not None:
        character = makehuman.decimated(makehuman.subdivided(character), 2 * vertex_count)
    rig = scene.add_armature(character)
    ob = scene.add_mesh(character, "Source clay")
    scene.attach(ob, rig)
    scene.paint(ob, character)
    for name, (axis, degrees) in MOTION.items():
        bone = rig.pose.bones[name]
        for frame in range(1, FRAMES + 1):
            share = np.sin(frame / FRAMES * 2 * np.pi) ** 2
            bone.rotation_quaternion = Quaternion(AXES[axis], np.radians(degrees * share))
            bone.keyframe_insert("rotation_quaternion", frame=frame)
    bpy.context.view_layer.update()
    return ob, rig


def choose(ob, rig, variant):
    """Deform the body by one of the variants; the seconds that enabling the skin took, or None."""
    bpy.context.view_layer.objects.active = rig
    rig.select_set(True)
    if ob.dermis_skin.enabled:
        bpy.ops.dermis.skin_disable()
    ob.modifiers["Armature"].use_deform_preserve_volume = variant == "Preserve Volume"
    smooth = ob.modifiers.get("Smooth")
    if variant.startswith("Corrective Smooth") and smooth is None:
        smooth = ob.modifiers.new("Smooth", "CORRECTIVE_SMOOTH")
        smooth.iterations = 5
    elif smooth is not None:
        ob.modifiers.remove(smooth)
    if variant != SKIN:
        return None
    began = time.perf_counter()
    bpy.ops.dermis.skin_enable()
    bpy.context.view_layer.update()
    return time.perf_counter() - began


def play():
    """Milliseconds of each frame: wall time, and processor time of all threads."""
    bpy.context.scene.frame_set(1)
    times = []
    for frame in range(2, FRAMES + 1):
        began = np.array([time.perf_counter(), time.process_time()])
        bpy.context.scene.frame_set(frame)
        times.append(1000 * (np.array([time.perf_counter(), time.process_time()]) - began))
    return times


def main(rounds, vertex_count):
    """Measure, print, write."""
    extension.install(extension.built_zip())
    ob, rig = animated_body(vertex_count)
    times = {variant: [] for variant in VARIANTS}
    enabling = []
    for _ in range(rounds):
        for variant in VARIANTS:
            seconds = choose(ob, rig, variant)
            enabling += [] if seconds is None else [seconds]
            times[variant] += play()
    medians = {variant: float(np.median(values, axis=0)[0]) for variant, values in times.items()}
    processor = {variant: float(np.median(values, axis=0)[1]) for variant, values in times.items()}
    bound = 3 * medians[PLAIN] + 6
    print(f"One frame in Blender, {len(ob.data.vertices)} vertices, {len(MOTION)} joints moving (median of {rounds})")
    for variant, median in medians.items():
        print(
            f"  {variant:<32} {median:6.2f} ms   {median / medians[PLAIN]:5.1f} times the plain modifier"
            f"   processor {processor[variant]:6.2f} ms"
        )
    peer = "Corrective Smooth, 5 iterations"
    ratios = [found[SKIN] / found[peer] for found in (medians, processor)]
    print(f"  Dermis over Corrective Smooth with 5 iterations: {ratios[0]:.2f}, by processor time {ratios[1]:.2f}")
    print(f"  three times the plain modifier and 6 ms: {bound:.2f} ms; enabling the skin: {max(enabling):.2f} s")
    report = {
        "machine": platform.processor() or platform.machine(),
        "blender": bpy.app.version_string,
        "vertices": len(ob.data.vertices),
        "frames": rounds * (FRAMES - 1),
        "milliseconds": {variant: round(median, 3) for variant, median in medians.items()},
        "processor_milliseconds": {variant: round(median, 3) for variant, median in processor.items()},
        "dermis_over_corrective_smooth": [round(ratio, 3) for ratio in ratios],
        "bound_milliseconds": round(bound, 3),
        "enabling_seconds": round(max(enabling), 3),
    }
    name = "skin_frames.json" if vertex_count is None else f"skin_frames_{vertex_count}.json"
    (ROOT / "bench" / name).write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="how often each variant is played")
    parser.add_argument("--vertices", type=int, help="about so many vertices, at most four times those of the body")
    arguments = parser.parse_args()
    extension.run(lambda: main(arguments.rounds, arguments.vertices))
