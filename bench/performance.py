"""Speed and scale of the skin: figures with their bounds, peers and a roofline in the same run.

Prints ratios first, writes `bench/performance.json` and the chart `bench/performance.png`. Peer pyPBD takes
part where it is installed (`pip install --no-deps pyPBD`). Every time is the least of many, since other work
on the machine can only add to it. Where a bound is one of wall time, the processor time of all threads counts
if it is less: without other work no call takes longer than that.

    python bench/performance.py [--vertices N ...] [--repeats N]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from dermis_native import PbdSkin, dual_quaternion_skinning, linear_blend_skinning
from performance_chart import draw
from roofline import PyPbd, least_milliseconds, roofline
from scaled_bodies import MOTION, generated_figure, makehuman_body

ROOT = Path(__file__).resolve().parent.parent
ITERATIONS = 10
BODY = 24_000
# Cells of a cage of about 51,000 tetrahedra through the whole body.
WHOLE_BODY = {"region": "all", "cell_size": 0.0252}
GROWTH = (3_000, 13_380, 53_514, 214_050, 856_194)
ENABLING_BOUNDS = {24_000: 2.0, 250_000: 15.0, 1_000_000: 60.0}
PHASES = ("skinning", "solve", "surface", "total")


def machine():
    """Name of the processor and number of cores that this process may use."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = (line for line in info.read_text(encoding="utf-8").splitlines() if line.startswith("model name"))
        name = next(lines, name).split(":")[-1].strip()
    return f"{name}, {len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()} cores"


def least(calls, repeats):
    """Least milliseconds of wall and of processor time of each named call, all in turns."""
    found = {name: {"wall_ms": np.inf, "processor_ms": np.inf} for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            wall, processor = time.perf_counter(), time.process_time()
            call()
            times = {
                "wall_ms": 1e3 * (time.perf_counter() - wall),
                "processor_ms": 1e3 * (time.process_time() - processor),
            }
            found[name] = {key: min(value, times[key]) for key, value in found[name].items()}
    return {name: {key: round(value, 3) for key, value in row.items()} for name, row in found.items()}


def swung(body, share):
    """A pose with the joints of `MOTION` turned by a share of their angles."""
    return body.pose({bone: share * np.array(turn) for bone, turn in MOTION.items()})


def everywhere(body, share):
    """A pose in which every bone has turned a little, so that no part of the body rests."""
    random = np.random.default_rng(1)
    return body.pose({bone: share * random.normal(0, 12, 3) for bone in body.skeleton.names[1:]})


class Turns:
    """Calls a skin with one of two poses after the other, so that no island can keep its solution."""

    def __init__(self, skin, first, second):
        self._skin, self._poses, self._turn = skin, (first, second), 0
        self.phases = dict.fromkeys(PHASES, np.inf)

    def __call__(self):
        """Solve the next pose."""
        self._turn += 1
        self._skin.solve_offsets(self._poses[self._turn % 2])
        times = self._skin.stats["milliseconds"]
        self.phases = {phase: min(self.phases[phase], times[phase]) for phase in PHASES}


def peer_child(path, threads, repeats):
    """Steps of pyPBD on the tetrahedra kept in a file; None where it is not installed."""
    kept = np.load(path)
    try:
        peer = PyPbd(kept["vertices"], kept["tetrahedra"], ITERATIONS, int(threads))
    except ImportError:
        return None
    return {"stretch": peer.stretch, "volume": peer.volume} | least({"step": peer.step}, int(repeats))["step"]


def distance_and_volume(body, peaks, repeats):
    """The whole body with distance and volume constraints alone, beside pyPBD and the roofline.

    The sweeps' own time is the difference to the same pose without iterations, by processor time on one thread.
    """
    only = {"bind": 0.0, "energy": 0.0, "self_collision": False, "volume_sweeps": 0, "start": "linear"} | WHOLE_BODY
    calls, skins = {}, {}
    for name, changes in {
        "one thread": {"iterations": ITERATIONS, "threads": 1},
        "two threads": {"iterations": ITERATIONS, "threads": 2},
        "no sweeps": {"iterations": 0, "threads": 1},
    }.items():
        skins[name] = PbdSkin(body.mesh, body.skeleton, body.weights, **only, **changes)
        calls[name] = Turns(skins[name], everywhere(body, 1.0), everywhere(body, 0.9))
    times = least(calls, repeats)
    constraints = {kind: skins["one thread"].stats["constraints"][kind] for kind in ("stretch", "volume")}
    sweeps = times["one thread"]["processor_ms"] - times["no sweeps"]["processor_ms"]
    cage = skins["one thread"].cage
    bound = least_milliseconds(peaks, len(cage.vertices), constraints["stretch"], constraints["volume"], ITERATIONS)
    found = {
        "iterations": ITERATIONS,
        "constraints": constraints,
        "frame": times,
        "sweeps_ms_one_thread": round(sweeps, 3),
        "solve_ms_two_threads": round(calls["two threads"].phases["solve"], 3),
        "ns_per_projection": round(1e6 * sweeps / (ITERATIONS * sum(constraints.values())), 2),
        "roofline": bound,
        "over_roofline": round(sweeps / bound["ms"], 2),
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cage.npz"
        np.savez(path, vertices=cage.vertices, tetrahedra=cage.tetrahedra)
        peers = {threads: child("peer", path, threads, max(repeats // 2, 5)) for threads in (1, 2)}
    if peers[1] is None:
        print("pyPBD is not installed and left out: pip install --no-deps pyPBD")
        return found
    # Its barriers spin, so that other work on the machine can stretch its two threads without measure: what
    # counts is no more than half of its one thread. Ours are not helped so.
    peer = min(peers[2]["wall_ms"], 0.5 * peers[1]["processor_ms"])
    ours = min(found["solve_ms_two_threads"], sweeps)
    return found | {"pyPBD": peers, "peer_ms": round(peer, 2), "peer_over_dermis": round(peer / ours, 1)}


def frames(body, repeats):
    """Whole frames of a body: offsets of all vertices from a pose, every phase included."""
    default = PbdSkin(body.mesh, body.skeleton, body.weights)
    one_finger = PbdSkin(body.mesh, body.skeleton, body.weights)
    still = PbdSkin(body.mesh, body.skeleton, body.weights)
    paper = PbdSkin(body.mesh, body.skeleton, body.weights, preset="paper", **WHOLE_BODY)
    finger = [{"index_01_l": (0.0, angle, 0.0)} for angle in (40.0, 45.0)]
    posed = swung(body, 1.0)
    calls = {
        "the paper's whole frame": Turns(paper, everywhere(body, 1.0), everywhere(body, 0.9)),
        "default, eleven joints": Turns(default, swung(body, 1.0), swung(body, 0.9)),
        "one finger bent": Turns(one_finger, body.pose(finger[0]), body.pose(finger[1])),
        "nothing moved": Turns(still, body.rest(), body.rest()),
        "the same pose again": Turns(still, posed, posed),
    }
    times = least(calls, repeats)
    skins = (paper, default, one_finger)
    for (name, call), skin in zip(calls.items(), (*skins, still, still), strict=True):
        stats = skin.stats
        times[name]["phases_ms"] = {phase: round(value, 3) for phase, value in call.phases.items()}
        if name != "nothing moved":
            times[name] |= {"work": stats["work"], "inverted": stats["inverted"]}
    for name, skin in (("the paper's whole frame", paper), ("default, eleven joints", default)):
        stats = skin.stats
        times[name] |= {"tetrahedra": stats["tetrahedra"], "constraints": stats["constraints"]}
    return times


def profile(body, repeats):
    """Where the processor time of a frame with eleven joints goes: what it is less by without each part."""
    start = {"start": "dual_quaternion", "threads": 1}
    variants = {
        "all": {},
        "no contact": {"self_collision": False},
        "no stretch": {"stretch": 0.0},
        "no volume": {"volume": 0.0, "self_collision": False},
        "no sweeps": {"iterations": 0, "volume_sweeps": 0, "self_collision": False},
    }
    calls, first = {}, swung(body, 1.0)
    for name, changes in variants.items():
        skin = PbdSkin(body.mesh, body.skeleton, body.weights, **start, **changes)
        calls[name] = Turns(skin, first, swung(body, 0.9))
        # The islands keep their solutions: what is left is the surface.
        again = PbdSkin(body.mesh, body.skeleton, body.weights, **start, **changes)
        calls[f"{name}, again"] = Turns(again, first, first)
    times = {name: row["processor_ms"] for name, row in least(calls, repeats).items()}
    solve = {name: times[name] - times[f"{name}, again"] for name in variants}
    skinning = calls["all"].phases["skinning"]
    parts = {
        "plain skinning": skinning,
        "start state, active part": solve["no sweeps"],
        "stretch": solve["all"] - solve["no stretch"],
        "volume, untangling": solve["no contact"] - solve["no volume"],
        "self-collision in the cage": solve["all"] - solve["no contact"],
        "surface from cage, offsets to rest": times["no contact, again"] - skinning,
        "self-collision of the surface": times["all, again"] - times["no contact, again"],
        "the whole frame": times["all"],
    }
    return {name: round(value, 3) for name, value in parts.items()}


def child(*arguments, threads=None):
    """What this file prints in a process of its own, as JSON."""
    environment = dict(os.environ) | ({} if threads is None else {"RAYON_NUM_THREADS": str(threads)})
    command = [sys.executable, __file__, "--child", *map(str, arguments)]
    output = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    return json.loads(output.splitlines()[-1])


def skinning_child(vertex_count, repeats):
    """Plain skinning on one thread: a body, and 60 bones with four on every vertex."""
    body, figure = makehuman_body(int(vertex_count)), generated_figure(int(vertex_count), 59)
    random = np.random.default_rng(2)
    bone = np.argsort(random.random((figure.size, 60)), axis=1)[:, :4]
    weights = type(figure.weights).from_triplets(
        np.repeat(np.arange(figure.size), 4), bone.ravel(), random.dirichlet(np.ones(4), figure.size).ravel(),
        figure.size, 60,
    )  # fmt: skip
    subjects = {
        "own weights": (body.vertices.astype(np.float32), body.weights, everywhere(body, 1.0)),
        "60 bones": (
            figure.vertices.astype(np.float32),
            figure.weights,
            figure.pose({f"bone{i}": (0, 0, 3) for i in range(1, 60)}),
        ),
        "60 bones, four on each vertex": (figure.vertices.astype(np.float32), weights, figure.rest()),
    }
    calls = {}
    for name, arguments in subjects.items():
        calls[f"LBS, {name}"] = lambda a=arguments: linear_blend_skinning(*a)
        calls[f"DQS, {name}"] = lambda a=arguments: dual_quaternion_skinning(*a)
    return least(calls, int(repeats))


def peak_kilobytes():
    """Largest memory of this process so far; a new program's `ru_maxrss` begins with that of the one that ran it."""
    status = Path("/proc/self/status")
    if status.exists():
        lines = status.read_text(encoding="utf-8").splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def enabling_child(kind, vertex_count, repeats):
    """Building the skin of a body of this size, then frames of it; memory is that of the whole process."""
    vertex_count = int(vertex_count)
    if kind == "generated":
        body = generated_figure(vertex_count)
        joints = {f"bone{i}": (0.0, 0.0, 40.0) for i in (3, 6, 9)}
    else:
        levels = {53_514: 1, 214_050: 2, 856_194: 3}.get(vertex_count)
        body = makehuman_body(None if levels else vertex_count, levels or 0)
        joints = MOTION
    before = peak_kilobytes()
    wall, processor = time.perf_counter(), time.process_time()
    skin = PbdSkin(body.mesh, body.skeleton, body.weights)
    built = {"enabling_s": time.perf_counter() - wall, "enabling_processor_s": time.process_time() - processor}
    turns = [body.pose({b: share * np.array(turn) for b, turn in joints.items()}) for share in (1.0, 0.9)]
    frame = Turns(skin, *turns)
    times = least({"frame": frame}, int(repeats))["frame"]
    peak = peak_kilobytes()
    stats = skin.stats
    return {
        "kind": kind,
        "vertices": body.size,
        **{key: round(value, 3) for key, value in built.items()},
        "megabytes": round(peak / 1024),
        "megabytes_before": round(before / 1024),
        "tetrahedra": stats["tetrahedra"],
        "islands": stats["islands"],
        "joints": len(joints),
        "frame": times,
        "processor_us_per_joint": round(1e3 * times["processor_ms"] / len(joints), 1),
        "phases_ms": {phase: round(value, 3) for phase, value in frame.phases.items()},
        "work": stats["work"],
    }


def exponents(rows, value):
    """Growth exponents of a value from each size to the next, and from the first to the last."""
    sizes, values = np.log([row["vertices"] for row in rows]), np.log([value(row) for row in rows])
    return {
        "steps": [round(float(step), 2) for step in np.diff(values) / np.diff(sizes)],
        "whole": round(float((values[-1] - values[0]) / (sizes[-1] - sizes[0])), 2),
    }


def quiet(wall, processor):
    """Upper bound of the wall time on a machine without other work: no call takes longer than all its threads."""
    return min(wall, processor)


def figures(report):
    """Name, value, bound and unit of every figure that has a bound; larger is worse except where `least`."""
    solver = report["distance and volume"]
    if "peer_over_dermis" in solver:
        yield "pyPBD on two threads over Dermis", solver["peer_over_dermis"], 10.0, "times, at least"
    yield "sweeps of one core over its roofline", solver["over_roofline"], 2.5, "times"
    for name, bound in (
        ("the paper's whole frame", 12.0),
        ("default, eleven joints", 5.0),
        ("one finger bent", 1.0),
        ("nothing moved", 0.3),
    ):
        row = report["frames"][name]
        yield name, quiet(row["wall_ms"], row["processor_ms"]), bound, "ms"
    for method, bound in (("LBS", 0.3), ("DQS", 0.7)):
        row = report["skinning"][f"{method}, 60 bones"]
        yield f"{method}, one thread, 60 bones", quiet(row["wall_ms"], row["processor_ms"]), bound, "ms"
    for row in report["enabling"]:
        if row["kind"] == "body":
            bound = next((b for size, b in ENABLING_BOUNDS.items() if row["vertices"] <= 1.05 * size), None)
            if bound is not None and row["vertices"] >= 20_000:
                seconds = quiet(row["enabling_s"], row["enabling_processor_s"])
                yield f"enabling {row['vertices']:,} vertices", seconds, bound, f"s ({row['megabytes']} MB)"
    for kind, growth in report["growth"].items():
        yield f"growth of a frame's processor time, {kind}", growth["frame"]["whole"], 1.1, "exponent"


def main(sizes, repeats):
    """Measure, print, write."""
    report = {"machine": machine(), "load_before": [round(x, 2) for x in os.getloadavg()]}
    report["roofline"] = peaks = roofline()
    body = makehuman_body(BODY)
    report["vertices"] = body.size
    report["distance and volume"] = distance_and_volume(body, peaks, repeats)
    report["frames"] = frames(body, repeats)
    report["profile_processor_ms"] = profile(body, repeats)
    report["skinning"] = child("skinning", BODY, 5 * repeats, threads=1)
    rows = [("body", size) for size in sorted({*sizes, BODY})] + [("generated", size) for size in sizes]
    report["enabling"] = [child("enabling", kind, size, max(repeats // 2, 3)) for kind, size in rows]
    report["growth"] = {}
    for kind in ("body", "generated"):
        grown = [row for row in report["enabling"] if row["kind"] == kind]
        if len(grown) > 1:
            report["growth"][kind] = {
                "frame": exponents(grown, lambda row: row["processor_us_per_joint"]),
                "enabling": exponents(grown, lambda row: row["enabling_processor_s"]),
                "memory": exponents(grown, lambda row: max(row["megabytes"] - row["megabytes_before"], 1)),
            }
    report["figures"] = [
        {
            "name": name,
            "value": value,
            "bound": bound,
            "unit": unit,
            "met": bool(value >= bound if "at least" in unit else value <= bound),
        }
        for name, value, bound, unit in figures(report)
    ]
    show(report)
    report["load_after"] = [round(x, 2) for x in os.getloadavg()]
    (ROOT / "bench" / "performance.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    draw(report, ROOT / "bench" / "performance.png")


def show(report):
    """The report as text, ratios first."""
    print(f"{report['machine']}; other work on it: load {report['load_before'][0]}")
    print("Figure                                               value     bound")
    for row in report["figures"]:
        sign = " " if row["met"] else "!"
        print(f"{sign} {row['name']:<48} {row['value']:9.2f} {row['bound']:9.2f} {row['unit']}")
    solver = report["distance and volume"]
    print(
        f"Distance and volume, {solver['constraints']}, {ITERATIONS} iterations: one thread"
        f" {solver['sweeps_ms_one_thread']} ms ({solver['ns_per_projection']} ns a projection), two threads"
        f" {solver['solve_ms_two_threads']} ms; pyPBD {solver.get('peer_ms', '-')} ms;"
        f" roofline {solver['roofline']['ms']:.2f} ms; {report['roofline']}"
    )
    for name, row in report["frames"].items():
        print(f"  {name:<26} {row['wall_ms']:7.2f} ms, processor {row['processor_ms']:7.2f}; {row['phases_ms']}")
    print(f"  by part, eleven joints: {report['profile_processor_ms']}")
    print("   vertices   enabling (processor)      MB   frame, processor   a joint  tetrahedra")
    for row in report["enabling"]:
        print(
            f"  {row['vertices']:9d} {row['enabling_s']:8.2f} s ({row['enabling_processor_s']:6.2f} s)"
            f" {row['megabytes']:8d} {row['frame']['processor_ms']:14.2f} ms {row['processor_us_per_joint']:8.1f} us"
            f" {row['tetrahedra']:9d}  {row['kind']}"
        )
    for kind, growth in report["growth"].items():
        print(f"  growth exponents, {kind}: {growth}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vertices", nargs="*", type=int, default=GROWTH, help="sizes of the growth table")
    parser.add_argument("--repeats", type=int, default=30, help="how often each frame is measured")
    parser.add_argument("--child", nargs="*", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        job = {"skinning": skinning_child, "enabling": enabling_child, "peer": peer_child}[options.child[0]]
        print(json.dumps(job(*options.child[1:])))
    else:
        main(options.vertices, options.repeats)
