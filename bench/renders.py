"""Render a walk in the background again and again with the live skin: no crash, and always the same pictures.

    python bench/renders.py [--frames 300] [--rounds 20]

The pictures of each round must be those of the first, and those that the same scene gives without the skin when a
point cache plays what the viewport showed in each frame. Needs the built extension.
"""

import argparse
import hashlib
import struct
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "demo"))

import extension  # noqa: E402  before bpy, which looks for its profile when it starts

# isort: split
import bake  # noqa: E402
import bpy  # noqa: E402
import scene  # noqa: E402
from PIL import Image  # noqa: E402


def play(ob, points, path):
    """Let a modifier of Blender show the points (F,V,3) in the place of the skin."""
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, points.shape[1], 1.0, 1.0, len(points))
    path.write_bytes(head + points.astype("<f4").tobytes())
    bpy.context.view_layer.objects.active = ob.parent
    if bpy.ops.dermis.skin_disable() != {"FINISHED"}:
        raise RuntimeError("the skin was not disabled")
    cache = ob.modifiers.new("Shown", "MESH_CACHE")
    cache.cache_format, cache.filepath, cache.frame_start = "PC2", str(path), 1


def walk_for(frames):
    """The walking body, walking on as long as is wanted."""
    ob = bake.walking_body()
    action = ob.parent.animation_data.action
    for curve in action.fcurves:
        curve.modifiers.new("CYCLES")
    action.update_tag()
    scene.build_studio(height=1.95, width=1.2)
    setting = bpy.context.scene
    setting.frame_start, setting.frame_end = 1, frames
    setting.render.engine = "CYCLES"
    setting.cycles.device, setting.cycles.samples, setting.cycles.use_denoising = "CPU", 1, False
    setting.render.resolution_x, setting.render.resolution_y, setting.render.resolution_percentage = 48, 64, 100
    return ob


def rendered(frames):
    """Digests of all pictures, and the seconds that each took."""
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="dermis-renders-") as folder:
        bpy.context.scene.render.filepath = f"{folder}/"
        bpy.ops.render.render(animation=True)
        seconds = (time.monotonic() - start) / frames
        pictures = []
        for path in sorted(Path(folder).glob("*.png")):
            with Image.open(path) as image:
                pictures.append(hashlib.sha256(image.tobytes()).hexdigest())
    if len(pictures) != frames:
        raise SystemExit(f"{len(pictures)} pictures instead of {frames}")
    return pictures, seconds


def compare(what, pictures, wanted):
    """End the program where a picture differs."""
    differing = [frame for frame, pair in enumerate(zip(pictures, wanted, strict=True), 1) if pair[0] != pair[1]]
    if differing:
        raise SystemExit(f"{what}: {len(differing)} pictures differ, the first in frame {differing[0]}")


def main(frames, rounds):
    """Render, compare, and print a line for each round."""
    extension.install(extension.built_zip())
    ob = walk_for(frames)
    points = bake.motion(ob, frames)
    first, seconds = rendered(frames)
    print(f"{frames} frames, {len(set(first))} different pictures, {seconds:.3f} s each", flush=True)
    for number in range(2, rounds + 1):
        pictures, seconds = rendered(frames)
        compare(f"round {number}", pictures, first)
        print(f"round {number:2d}: all pictures equal, {seconds:.3f} s each", flush=True)
    with tempfile.TemporaryDirectory(prefix="dermis-renders-") as folder:
        play(ob, points, Path(folder) / "shown.pc2")
        pictures, seconds = rendered(frames)
    compare("what the viewport showed", pictures, first)
    print(f"without the skin, from what the viewport showed: all pictures equal, {seconds:.3f} s each", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=20)
    chosen = parser.parse_args()
    extension.run(lambda: main(chosen.frames, chosen.rounds))
