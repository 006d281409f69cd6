"""Skeletons fitted into bodies: Dermis beside the template scaled to the body's bounding box.

The template is the young man's skeleton; the bodies stand as he does, or in another pose. Errors are the
distances of the main joints (no fingers) from the artist's, in percent of the height. Prints a table and
writes `bench/fit.json` and `bench/fit.png`:

    python bench/fit.py
"""

import json
import platform
import re
import sys
import time
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "demo"), str(ROOT / "tests" / "native")]

import characters  # noqa: E402
from bind_figures import BODIES, character  # noqa: E402
from dermis_native import fit_skeleton  # noqa: E402

FINGER = re.compile("|".join(characters.FINGERS))
TRIANGLES = 12_000
SIZE, MARGIN, CAPTION = (300, 380), 12, 20
PICTURES = ("young man posed", "child", "heavy man posed", "baby", "old woman", "long legs posed")


def scaled_to_box(it, template):
    """Heads of the template scaled to the body's height and moved to the middle of its bounding box."""
    ends = np.concatenate([template.heads[1:], template.tails[1:]])  # without the root on the ground
    low, high = ends.min(axis=0), ends.max(axis=0)
    scale = np.ptp(it.vertices[:, 2]) / (high - low)[2]
    middle = 0.5 * (it.vertices.min(axis=0) + it.vertices.max(axis=0))
    return (template.heads - 0.5 * (low + high)) * scale + middle


def errors(heads, it, template):
    """Errors of the main joints in percent of the height."""
    main = [i for i, name in enumerate(template.names) if not FINGER.search(name) and name != "Root"]
    order = [it.bone_names.index(template.names[i]) for i in main]
    return 100 * np.linalg.norm(heads[main] - it.heads[order], axis=1) / np.ptp(it.vertices[:, 2])


def drawn(mesh, found, axes):
    """The skeleton over the body's silhouette."""
    low, high = mesh.vertices[:, axes].min(axis=0), mesh.vertices[:, axes].max(axis=0)
    scale = min((np.array(SIZE) - 2 * MARGIN) / (high - low))
    place = lambda points: (points[..., axes] - 0.5 * (low + high)) * [scale, -scale] + np.array(SIZE) / 2  # noqa: E731
    image = Image.new("RGB", SIZE, (247, 247, 245))
    canvas = ImageDraw.Draw(image)
    for corners in place(mesh.vertices[mesh.triangles]):
        canvas.polygon([tuple(corner) for corner in corners], fill=(205, 212, 224))
    skeleton = found.skeleton
    for head, tail, is_found in zip(place(skeleton.heads), place(skeleton.tails), found.found, strict=True):
        colour = (176, 30, 30) if is_found else (60, 96, 190)
        canvas.line([tuple(head), tuple(tail)], fill=colour, width=2)
        canvas.ellipse([*(head - 2), *(head + 2)], fill=colour)
    return image


def main():
    """Print the table and write the report and the pictures."""
    template = characters.skeleton_of(character("young man", TRIANGLES))
    report = {"machine": platform.machine(), "python": platform.python_version(), "bodies": {}}
    images = []
    print(f"{'':24}{'fitted: mean':>13}{'worst':>8}{'score':>8}{'seconds':>9}{'scaled: mean':>15}{'worst':>8}")
    for body in BODIES:
        for name in (body, f"{body} posed"):
            it = character(body, TRIANGLES)
            it = characters.posed(it) if name.endswith("posed") else it
            mesh = characters.mesh_of(it)
            start = time.perf_counter()
            found = fit_skeleton(mesh, template)
            seconds = time.perf_counter() - start
            ours = errors(found.skeleton.heads, it, template)
            scaled = errors(scaled_to_box(it, template), it, template)
            report["bodies"][name] = {
                "fitted": {"mean": ours.mean(), "worst": ours.max()},
                "scaled": {"mean": scaled.mean(), "worst": scaled.max()},
                "method": found.method,
                "score": found.score,
                "seconds": seconds,
            }
            print(
                f"{name:24}{ours.mean():12.2f}%{ours.max():7.2f}%{found.score:8.2f}{seconds:8.1f}s"
                f"{scaled.mean():14.2f}%{scaled.max():7.2f}%",
                flush=True,
            )
            if name in PICTURES:
                images.append((name, [drawn(mesh, found, [0, 2]), drawn(mesh, found, [1, 2])]))
    rows = report["bodies"].values()
    for method in ("fitted", "scaled"):
        report[method] = {
            "mean": float(np.mean([row[method]["mean"] for row in rows])),
            "worst": float(np.max([row[method]["worst"] for row in rows])),
        }
    print({method: report[method] for method in ("fitted", "scaled")})
    sheet = Image.new("RGB", (SIZE[0] * len(images), 2 * SIZE[1] + CAPTION), (247, 247, 245))
    for column, (name, views) in enumerate(images):
        ImageDraw.Draw(sheet).text((column * SIZE[0] + MARGIN, 4), name, fill=(40, 40, 40))
        for row, view in enumerate(views):
            sheet.paste(view, (column * SIZE[0], CAPTION + row * SIZE[1]))
    sheet.save(ROOT / "bench" / "fit.png")
    (ROOT / "bench" / "fit.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
