"""Retargeted weights beside those of other methods, on pairs of characters.

Prints a table and writes `bench/retarget.json`, the picture of the errors `bench/retarget.png` and, for each
pair, the weights as `bench/retarget_PAIR.png`:

    python bench/retarget.py [--pairs child,heavy] [--methods auto,paper] [--no-pictures]

Every method runs in a process of its own, which reads the pair, calls the method once and tells the
seconds of that call and the largest memory that the process ever had.
"""

import argparse
import importlib.util
import json
import os
import pickle
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "demo"), str(ROOT / "tests" / "native")]

import characters  # noqa: E402
import retarget_summary  # noqa: E402
import weight_peers  # noqa: E402
import weight_pictures  # noqa: E402
from dermis_native import retarget_weights  # noqa: E402


def ours(method):
    """Dermis' retargeting by one of its methods."""

    def run(pair):
        result = retarget_weights(
            characters.mesh_of(pair.source),
            characters.weights_of(pair.source),
            characters.mesh_of(pair.target),
            source_skeleton=characters.skeleton_of(pair.source),
            target_skeleton=characters.skeleton_of(pair.given),
            method=method,
        )
        return result.weights.to_dense()

    return run


METHODS = {
    "auto": ours("auto"),
    "closest point": weight_peers.closest_point,
    "inpainting": weight_peers.robust_inpainting,
    "paper": ours("paper"),
    "eq. 2": weight_peers.eq_2,
    "volumetric": weight_peers.volumetric,
}
if importlib.util.find_spec("bpy") is not None:
    METHODS["bone heat"] = weight_peers.bone_heat
# What a large pair is not asked: it takes minutes.
SMALL_ONLY = ("paper", "bone heat")
TIME_LIMIT = 600


def peak_megabytes():
    """Largest resident memory of this process; the system's own count where it tells it."""
    status = Path("/proc/self/status")
    if status.is_file():
        lines = status.read_text(encoding="ascii").splitlines()
        peaks = [int(line.split()[1]) for line in lines if line.startswith("VmHWM:")]
        if peaks:
            return peaks[0] / 1024
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def run_method(method, folder):
    """Runs one method on the pair in a folder and leaves what it gave there."""
    with (folder / "pair.pickle").open("rb") as file:
        pair = pickle.load(file)
    start = time.perf_counter()
    weights = METHODS[method](pair)
    seconds = time.perf_counter() - start
    np.savez(folder / "result.npz", weights=weights, seconds=seconds, megabytes=peak_megabytes())
    # Blender as a module may hang at its own exit.
    sys.stdout.flush()
    os._exit(0)


def measure(method, pair, folder):
    """One row of the table and the weights, or what went wrong."""
    command = [sys.executable, __file__, "--run", method, "--folder", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIME_LIMIT)
    except subprocess.TimeoutExpired:
        return {"error": f"not done after {TIME_LIMIT} s"}, None
    if done.returncode:
        return {"error": (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]}, None
    with np.load(folder / "result.npz") as result:
        weights, seconds, megabytes = result["weights"], float(result["seconds"]), float(result["megabytes"])
    errors = characters.l1_error(weights, pair.target.weights)
    row = {
        "l1": round(float(errors.mean()), 4),
        "pose_error": round(characters.pose_error(pair.target, weights), 5),
        "misplaced": round(float(characters.misplaced(pair.target, weights).mean()), 5),
        "off_by_more_than_1": round(float((errors > 1).mean()), 4),
        "seconds": round(seconds, 2),
        "megabytes": round(megabytes),
    }
    return row, weights


def report(pair_name, pair, methods, pictures):
    """Measures the methods on one pair, prints its lines, draws its picture."""
    print(f"{pair_name}: {len(pair.source.vertices)} -> {len(pair.target.vertices)} vertices")
    rows = {}
    images = {}
    if pictures:
        images["source"] = picture(pair.source, pair.source.weights, pair)
        images["truth"] = picture(pair.target, pair.target.weights, pair)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with (folder / "pair.pickle").open("wb") as file:
            pickle.dump(pair, file)
        for method in methods:
            row, weights = measure(method, pair, folder)
            rows[method] = row
            if weights is None:
                print(f"  {method:<14} {row['error']}")
                continue
            print(
                f"  {method:<14} {row['l1']:7.3f} {100 * row['pose_error']:9.3f} % {100 * row['misplaced']:8.2f} %"
                f" {100 * row['off_by_more_than_1']:8.1f} % {row['seconds']:8.2f} s {row['megabytes']:7d} MB",
                flush=True,
            )
            if pictures:
                images[method] = picture(pair.target, weights, pair)
    if pictures:
        weight_pictures.sheet(images, ROOT / "bench" / f"retarget_{pair_name}.png")
    return {
        "source": pair.source.name,
        "target": pair.target.name,
        "source_vertices": len(pair.source.vertices),
        "target_vertices": len(pair.target.vertices),
        "methods": rows,
    }


def picture(character, weights, pair):
    """A character coloured by its weights; equal names have equal colours on both sides."""
    names = list(pair.target.bone_names)
    if character is pair.source:
        known = {name: i for i, name in enumerate(names)}
        columns = [known.setdefault(name, len(known)) for name in character.bone_names]
        spread = np.zeros((len(weights), len(known)))
        spread[:, columns] = weights
        weights = spread
    return weight_pictures.draw(character.vertices, character.triangles, np.asarray(weights, float))


def chosen(text, known, what):
    """The names of a comma-separated list, all of them without one."""
    names = list(known) if text is None else text.split(",")
    unknown = [name for name in names if name not in known]
    if unknown:
        sys.exit(f"unknown {what} {unknown[0]!r}; there are {', '.join(known)}")
    return names


def main():
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--pairs", help="names separated by commas; all without it")
    parser.add_argument("--methods", help="names separated by commas; all without it")
    parser.add_argument("--no-pictures", action="store_true")
    parser.add_argument("--run", choices=METHODS, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.run:
        run_method(options.run, options.folder)
        return
    known = characters.pairs()
    methods = chosen(options.methods, METHODS, "method")
    names = chosen(options.pairs, known, "pair")
    print("L1 error (0 to 2), pose error (share of the extent), vertices on another side's limb or another finger,")
    print("vertices off by more than 1, seconds of the call, peak memory of its process")
    results = {}
    for name in names:
        suited = [method for method in methods if name not in characters.large_pairs() or method not in SMALL_ONLY]
        results[name] = report(name, known[name](), suited, not options.no_pictures)
    summary = retarget_summary.summary(results, methods)
    print(retarget_summary.table(summary))
    retarget_summary.draw(results, methods, ROOT / "bench" / "retarget.png")
    content = {
        "machine": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "summary": summary,
        "pairs": results,
    }
    (ROOT / "bench" / "retarget.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
