"""Weights from the skeleton alone: Blender's bone heat, eq. 2 and Dermis' volumetric bind.

For every body the mean L1 distance from the artist's weights (0 to 2), the share of edges that are
longer than twice their rest length over twelve random poses, and the share of all weight that bones
of one side have on the other. Prints tables and writes `bench/bind.json`:

    python bench/bind.py
"""

import json
import platform
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "demo"), str(ROOT / "tests" / "native")]

import characters  # noqa: E402
from bind_figures import BODIES, character, on_the_other_side, stretched_edges  # noqa: E402
from dermis_native import Skeleton, bind_weights  # noqa: E402

try:
    from bone_heat import bone_heat
except ImportError:
    bone_heat = None

# Characters beside the checkout. Bone heat comes so near to the weights of some of them (m2m, quat) that they
# were most likely made with it and corrected by hand; there it is no rival but the origin.
OTHERS = (
    "cesium_man",
    "khronos_fox",
    "mh_default_rig_mixamo",
    "mh_default_rig_default",
    "quat_wolf",
    "quat_husky",
    "quat_trex",
    "m2m_human_male",
    "m2m_zombie",
    "m2m_fox",
)
METHODS = ("bone heat", "eq. 2", "volumetric")


def bound(it, method):
    """Dense weights (V,B) by a method, and the seconds it took."""
    used = np.flatnonzero(it.weights.max(axis=0) > 0)
    start = time.perf_counter()
    if method == "bone heat":
        weights = bone_heat(it, used)
    else:
        skeleton = Skeleton(it.heads, it.tails, it.parents)
        name = {"eq. 2": "paper", "volumetric": "volumetric"}[method]
        weights = bind_weights(characters.mesh_of(it), skeleton, method=name, bones=used).to_dense()
    return np.asarray(weights, np.float64), time.perf_counter() - start


def figures(it):
    """What each method gives on one body, and what the artist's weights give."""
    true = np.asarray(it.weights, np.float64)
    row = {"vertices": len(it.vertices), "true": {"stretched": stretched_edges(it, true)}}
    for method in METHODS:
        if method == "bone heat" and bone_heat is None:
            continue
        weights, seconds = bound(it, method)
        row[method] = {
            "error": characters.l1_error(weights, it.weights).mean(),
            "stretched": stretched_edges(it, weights),
            "other side": on_the_other_side(it, weights),
            "without weights": int((weights.sum(axis=1) <= 0).sum()),
            "seconds": seconds,
        }
    return row


def main():
    """Print the table and write the report."""
    bodies = {name: lambda name=name: character(name) for name in BODIES}
    if characters.SHARED.is_dir():
        bodies |= {name: lambda name=name: characters.shared(name) for name in OTHERS}
    report = {"machine": platform.machine(), "python": platform.python_version(), "bodies": {}}
    methods = [method for method in METHODS if method != "bone heat" or bone_heat is not None]
    print(f"{'':24}" + "".join(f"{method:^34}" for method in methods) + "   true")
    print(f"{'':24}" + f"{'error':>9}{'stretched':>10}{'other':>8}{'time':>7}" * len(methods) + "  stretched")
    for name, make in bodies.items():
        row = report["bodies"][name] = figures(make())
        cells = "".join(
            f"{row[m]['error']:9.3f}{row[m]['stretched']:10.2%}{row[m]['other side']:8.2%}{row[m]['seconds']:6.1f}s"
            for m in methods
        )
        print(f"{name:24}{cells}{row['true']['stretched']:11.2%}", flush=True)
    for method in methods:
        report[method] = float(np.mean([report["bodies"][name][method]["error"] for name in BODIES]))
    print("mean error over the MakeHuman bodies:", {method: round(report[method], 3) for method in methods})
    (ROOT / "bench" / "bind.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
