"""What bakes of the skin keep on a walking MakeHuman body, how many keys and bytes they take, and how long.

Prints a table and writes `bench/bake.json`. Needs the built extension:

    python bench/bake.py
"""

import json
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "demo"))

import extension  # noqa: E402  before bpy, which looks for its profile when it starts

# isort: split
import bpy  # noqa: E402
import makehuman  # noqa: E402
import numpy as np  # noqa: E402
import poses  # noqa: E402
import scene  # noqa: E402

FRAMES = 32
LEFT, UP, BACK = poses.LEFT, poses.UP, poses.BACK


def walk(share):
    """Turns of a walk at a share of its cycle; the right side is half a cycle behind."""
    found = {
        "spine_01": [(UP, 6 * np.sin(2 * np.pi * share))],
        "spine_02": [(UP, 6 * np.sin(2 * np.pi * share))],
        "head": [(UP, -9 * np.sin(2 * np.pi * share))],
    }
    for side, at in (("l", share), ("r", share + 0.5)):
        swing = np.sin(2 * np.pi * at)
        lift = max(0.0, np.sin(2 * np.pi * at + 0.9)) ** 2
        found[f"thigh_{side}"] = [(LEFT, -28 * swing)]
        found[f"calf_{side}"] = [(LEFT, 12 + 55 * lift)]
        found[f"foot_{side}"] = [(LEFT, -14 * np.cos(2 * np.pi * at))]
        found[f"upperarm_{side}"] = [(BACK, 45), (LEFT, 26 * swing)]
        found[f"lowerarm_{side}"] = [(UP, -18 - 22 * max(0.0, -swing))]
    return found


def walking_body():
    """The body with its skin, walking over the frames."""
    character = makehuman.body("Body", **makehuman.YOUNG_MALE)
    rig = scene.add_armature(character)
    ob = scene.add_mesh(character, "Source clay")
    scene.attach(ob, rig)
    scene.paint(ob, character)
    for frame in range(1, FRAMES + 1):
        turns = walk((frame - 1) / FRAMES)
        for bone in rig.pose.bones:
            if bone.name in turns:
                bone.rotation_quaternion = poses.local_rotation(bone, turns[bone.name])
                bone.keyframe_insert("rotation_quaternion", frame=frame)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, FRAMES
    for each in bpy.context.view_layer.objects:
        each.select_set(each == rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.dermis.skin_enable()
    return ob


def motion(ob, frames=FRAMES):
    """What every frame shows (F,V,3)."""
    shown = []
    for frame in range(1, frames + 1):
        bpy.context.scene.frame_set(frame)
        mesh = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        flat = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", flat)
        shown.append(flat.reshape(-1, 3).astype(np.float64))
    return np.array(shown)


def check_parts(folder):
    """A bake in parts, out of order, and another of the whole range have the same bytes."""
    ranges = {"whole": (1, FRAMES), "c": (21, FRAMES), "a": (1, 10), "b": (11, 20), "again": (1, FRAMES)}
    files = {}
    for name, (start, end) in ranges.items():
        bpy.ops.dermis.bake(
            directory=str(folder / name), use_scene_range=False, frame_start=start, frame_end=end, play=False
        )
        files[name] = next((folder / name).iterdir())
    join = sys.modules["bl_ext.user_default.dermis.core.point_cache"].join_caches
    join([files[name] for name in "cab"], folder / "joined")
    same = files["whole"].read_bytes() == files["again"].read_bytes() == (folder / "joined").read_bytes()
    print(f"  the same bytes when baked again and in three parts: {'yes' if same else 'NO'}")
    if not same:
        raise AssertionError("bakes differ")


def main():
    """Bake in every way, measure, print, write."""
    extension.install(extension.built_zip())
    ob = walking_body()
    live = motion(ob)
    key = ob.data.shape_keys.key_blocks["Dermis"]
    key.mute = True
    plain = motion(ob)
    key.mute = False
    whole = np.sqrt(np.square(plain - live).sum(axis=2).mean())
    farthest = 1000 * np.sqrt(np.square(plain - live).sum(axis=2).max())
    print(f"{len(ob.data.vertices)} vertices, {FRAMES} frames; without a correction {farthest:.1f} mm off at most")
    report = {"vertices": len(ob.data.vertices), "frames": FRAMES, "millimetres_without": round(farthest, 2)}
    ways = {"point cache, PC2": ("bake", {"samples_per_frame": 1})}
    for kept in (0.8, 0.9, 0.95):
        ways[f"driven keys, {kept:.0%} asked for"] = ("bake_driven_keys", {"kept": kept, "most_keys": 200})
    for limit in ("4", "8"):
        ways[f"refit, {limit} influences"] = ("bake_weights", {"influences": limit, "least": 0.0})
    with tempfile.TemporaryDirectory() as folder:
        check_parts(Path(folder))
    with tempfile.TemporaryDirectory() as folder:
        for name, (operator, options) in ways.items():
            if operator == "bake":
                options = {**options, "directory": folder}
            keys = len(ob.data.shape_keys.key_blocks)
            began = time.perf_counter()
            getattr(bpy.ops.dermis, operator)(**options)
            seconds = time.perf_counter() - began
            off = np.square(motion(ob) - live).sum(axis=2)
            row = {
                "kept": round(1 - float(np.sqrt(off.mean()) / whole), 4),
                "millimetres": round(1000 * float(np.sqrt(off.max())), 3),
                "keys": len(ob.data.shape_keys.key_blocks) - keys,
                "megabytes": round(sum(p.stat().st_size for p in Path(folder).iterdir()) / 1e6, 2),
                "seconds": round(seconds, 2),
            }
            report[name] = row
            print(
                f"  {name:<32} keeps {row['kept']:7.2%}, {row['millimetres']:7.3f} mm off at most, "
                f"{row['keys']:3d} keys, {row['seconds']:5.1f} s"
                + (f", {row['megabytes']} MB" if operator == "bake" else ""),
                flush=True,
            )
            bpy.ops.dermis.bake_remove(delete_files=True)
    assert np.array_equal(motion(ob), live), "the way back is exact"
    (ROOT / "bench" / "bake.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    extension.run(main)
