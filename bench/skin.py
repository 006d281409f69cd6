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

from deformation import (  # noqa: E402
    crossing_pairs,
    joint_volume,
    limb_part,
    longest_stretch,
    part_volume,
    volume,
)
from dermis_native import (  # noqa: E402
    PbdSkin,
    SkinWeights,
    dual_quaternion_skinning,
    linear_blend_skinning,
)
from skin_poses import CYLINDER, body_poses, cylinder, cylinder_pose  # noqa: E402
from surfaces import body  # noqa: E402

# Fast Projective Skinning (Komaritzan and Botsch) on shapes of its own: joint volume as a share of
# rest, without and with its collision handling, and crossing triangle pairs. Published figures,
# measured with its authors' program on comparable shapes (a cylinder of 800 and a man of 4,651
# vertices), not in this run; None where it was not measured.
PEER = "Fast Projective Skinning"
PEER_SHARES = {
    "cylinder bend 90": ((0.90, 0.89), (None, None)),
    "cylinder bend 130": ((0.81, 0.75), (54, 75)),
    "cylinder twist 120": ((0.86, None), (None, None)),
    "elbow 120": ((0.60, 0.54), (70, 55)),
    "knee 120": ((0.79, 0.78), (41, 40)),
    "forearm twist 120": ((0.85, None), (None, None)),
}
JOINTS = {"elbow 120": "lowerarm_l", "knee 120": "calf_l", "forearm twist 120": "lowerarm_l"}

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


def peer_rows():
    """Joint volume and new crossing pairs in the poses of the published figures."""
    tube, tube_skeleton, tube_weights = cylinder()
    tube_skin = PbdSkin(tube, tube_skeleton, tube_weights)
    mesh, skeleton, dense = body("average")
    weights = SkinWeights.from_dense(dense)
    skin = PbdSkin(mesh, skeleton, weights)
    poses = body_poses(skeleton)
    for pose, (published, crossing) in PEER_SHARES.items():
        if pose in JOINTS:
            rest, triangles = mesh.vertices, mesh.triangles
            part = limb_part(skeleton, dense, rest, triangles, JOINTS[pose])
            surfaces, _ = deformed(mesh, weights, skin, poses[pose])
            shares = {name: part_volume(surface, part) / part_volume(rest, part) for name, surface in surfaces.items()}
        else:
            _, kind, degrees = pose.split()
            rest, triangles = tube.vertices, tube.triangles
            transforms = cylinder_pose(tube_skeleton, kind, int(degrees))
            surfaces, _ = deformed(tube, tube_weights, tube_skin, transforms)
            whole = joint_volume(rest, rest, triangles)
            shares = {name: joint_volume(rest, surface, triangles) / whole for name, surface in surfaces.items()}
        at_rest = crossing_pairs(rest, triangles)
        yield {
            "pose": pose,
            "volume": {name: round(float(share), 4) for name, share in shares.items()},
            "crossing_pairs": {n: len(crossing_pairs(s, triangles) - at_rest) for n, s in surfaces.items()},
            "published": {"method": PEER, "volume": published, "crossing_pairs": crossing},
        }


def figures(values, form):
    """Figures side by side; a dash where there is none."""
    return " / ".join("-" if value is None else format(value, form) for value in values)


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
    report["published"] = list(peer_rows())
    print(f"Joint volume and new crossing pairs (same order), and published figures of {PEER},")
    print("without / with collision: measured with that program on comparable shapes, not in this run")
    for row in report["published"]:
        ours = f"{figures(row['volume'].values(), '.0%'):>20}   {figures(row['crossing_pairs'].values(), 'd'):>12}"
        published = row["published"]
        theirs = f"{figures(published['volume'], '.0%'):>10}   {figures(published['crossing_pairs'], 'd')}"
        print(f"  {row['pose']:<18} {ours}   published {theirs}")
    (ROOT / "bench" / "skin.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
