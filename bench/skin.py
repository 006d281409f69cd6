"""What the skin keeps at every joint, beside plain linear blend and dual quaternion skinning.

Prints the tables of a capped cylinder and of a MakeHuman body and writes `bench/skin.json`:

    python bench/skin.py
"""

import json
import platform
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "demo"), str(ROOT / "tests" / "native")]

from deformation import crossing_pairs, joint_volume, longest_stretch, volume  # noqa: E402
from dermis_native import (  # noqa: E402
    PbdSkin,
    SkinWeights,
    dual_quaternion_skinning,
    linear_blend_skinning,
)
from skin_poses import CYLINDER, body_poses, cylinder, cylinder_pose  # noqa: E402
from surfaces import body  # noqa: E402

METHODS = ("linear blend", "dual quaternions", "Dermis")
RUNS = 5


def deformed(mesh, weights, skin, transforms):
    """The surface by each method, and the median milliseconds of the skin."""
    rest = mesh.vertices
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        solved = skin.solve(transforms)
        times.append(1000 * (time.perf_counter() - start))
    surfaces = (
        linear_blend_skinning(rest, weights, transforms),
        dual_quaternion_skinning(rest, weights, transforms),
        solved,
    )
    return dict(zip(METHODS, surfaces, strict=True)), float(np.median(times))


def cylinder_rows():
    """Joint volume of the cylinder, as a share of rest."""
    mesh, skeleton, weights = cylinder()
    skin = PbdSkin(mesh, skeleton, weights)
    whole = joint_volume(mesh.vertices, mesh.vertices, mesh.triangles)
    for kind, degrees in CYLINDER:
        surfaces, milliseconds = deformed(mesh, weights, skin, cylinder_pose(skeleton, kind, degrees))
        yield {
            "pose": f"{kind} {degrees}",
            "volume": {
                name: round(joint_volume(mesh.vertices, surface, mesh.triangles) / whole, 4)
                for name, surface in surfaces.items()
            },
            "inverted": skin.stats["inverted"],
            "milliseconds": round(milliseconds, 2),
        }


def body_rows():
    """Volume error in cm³, new crossing pairs and longest edge of a body, one joint at a time."""
    mesh, skeleton, weights = body("average")
    weights = SkinWeights.from_dense(weights)
    skin = PbdSkin(mesh, skeleton, weights)
    rest, triangles = mesh.vertices, mesh.triangles
    whole, at_rest = volume(rest, triangles), crossing_pairs(rest, triangles)
    for pose, transforms in body_poses(skeleton).items():
        surfaces, milliseconds = deformed(mesh, weights, skin, transforms)
        yield {
            "pose": pose,
            "volume_error_cm3": {n: round(1e6 * (volume(s, triangles) - whole)) for n, s in surfaces.items()},
            "crossing_pairs": {n: len(crossing_pairs(s, triangles) - at_rest) for n, s in surfaces.items()},
            "longest_edge": {n: round(float(longest_stretch(rest, s, triangles)), 2) for n, s in surfaces.items()},
            "inverted": skin.stats["inverted"],
            "milliseconds": round(milliseconds, 2),
        }


def main():
    """Measure, print, write."""
    report = {"machine": platform.processor() or platform.machine()}
    report["cylinder"] = list(cylinder_rows())
    print("Capped cylinder: volume of the joint, share of rest (linear blend / dual quaternions / Dermis)")
    for row in report["cylinder"]:
        shares = " / ".join(f"{share:6.1%}" for share in row["volume"].values())
        print(f"  {row['pose']:<18} {shares}   inverted {row['inverted']}   {row['milliseconds']:.1f} ms")
    report["body"] = list(body_rows())
    print("MakeHuman body: volume error in cm³, new crossing pairs, longest edge (same order)")
    for row in report["body"]:
        parts = [
            " / ".join(str(v) for v in row[k].values()) for k in ("volume_error_cm3", "crossing_pairs", "longest_edge")
        ]
        print(f"  {row['pose']:<18} {parts[0]:>22}   {parts[1]:>14}   {parts[2]:>18}   {row['milliseconds']:.1f} ms")
    total = {name: sum(abs(row["volume_error_cm3"][name]) for row in report["body"]) for name in METHODS}
    crossings = {name: sum(row["crossing_pairs"][name] for row in report["body"]) for name in METHODS}
    report["volume_error_share_of_plain"] = round(total["Dermis"] / total["linear blend"], 4)
    print(
        f"  sum of volume errors {total}: {report['volume_error_share_of_plain']:.1%} of plain; crossings {crossings}"
    )
    (ROOT / "bench" / "skin.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
