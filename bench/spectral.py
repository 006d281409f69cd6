"""Eigenpairs and biharmonic distance beside scipy's `eigsh`, in one run on one body.

Prints a table and writes `bench/spectral.json`. The body is MakeHuman's, subdivided and decimated
to about the vertex counts asked for:

    python bench/spectral.py [VERTICES ...]
"""

import argparse
import json
import platform
import resource
import sys
import time
from pathlib import Path

import dermis_native
import fast_simplification
import igl
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "demo"))

import makehuman  # noqa: E402

PAIRS, LANDMARKS = 100, 40


def surface(vertex_count):
    """One closed body with about `vertex_count` vertices."""
    character = makehuman.body("average")
    vertices, triangles = character.vertices, character.triangles.astype(np.int64)
    while len(vertices) < vertex_count:
        vertices, triangles = igl.loop(vertices, triangles, 1)
    if len(vertices) > 1.01 * vertex_count:
        vertices, triangles = fast_simplification.simplify(
            vertices.astype(np.float32), triangles.astype(np.int32), target_count=2 * vertex_count
        )
    return dermis_native.TriangleMesh(vertices, triangles)


def seconds(call):
    """How long a call takes, and what it returns."""
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


def measure(vertex_count):
    """One row of the table."""
    mesh = surface(vertex_count)
    t_laplacian, (data, indices, starts, areas) = seconds(lambda: dermis_native.laplacian(mesh))
    t_pairs, (values, _) = seconds(lambda: dermis_native.eigenpairs(mesh, PAIRS))
    t_all, distance = seconds(lambda: dermis_native.BiharmonicDistance(mesh, eigenpairs=PAIRS))
    chosen = np.linspace(0, len(areas) - 1, LANDMARKS).astype(int)
    t_columns, _ = seconds(lambda: [distance.from_vertex(int(vertex)) for vertex in chosen])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    stiffness = sp.csc_matrix((data, indices, starts), shape=(len(areas),) * 2)
    # Shifted just below zero, so that scipy factorises a regular matrix.
    shift = -1e-6 * values[0]
    t_scipy, (expected, _) = seconds(lambda: sla.eigsh(stiffness, PAIRS + 1, sp.diags(areas), sigma=shift))
    return {
        "vertices": len(areas),
        "laplacian_s": round(t_laplacian, 3),
        "eigenpairs_s": round(t_pairs, 3),
        "everything_s": round(t_all + t_columns, 3),
        "eigsh_s": round(t_scipy, 3),
        "eigsh_over_eigenpairs": round(t_scipy / t_pairs, 2),
        "eigsh_over_everything": round(t_scipy / (t_all + t_columns), 2),
        "largest_relative_difference": float(np.abs(values / np.sort(expected)[1:] - 1).max()),
        "peak_megabytes_before_scipy": round(peak),
    }


def main():
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("vertices", nargs="*", type=int, default=[15_000, 24_000, 100_000])
    rows = [measure(count) for count in parser.parse_args().vertices]
    print(f"{PAIRS} eigenpairs; everything = Laplacian, eigenpairs, exact diagonal, {LANDMARKS} landmark columns")
    print(" vertices  eigenpairs  everything  scipy eigsh  ratio pairs  ratio all  peak MB")
    for row in rows:
        print(
            f"{row['vertices']:9d} {row['eigenpairs_s']:10.2f}s {row['everything_s']:10.2f}s {row['eigsh_s']:11.2f}s"
            f" {row['eigsh_over_eigenpairs']:12.1f} {row['eigsh_over_everything']:10.1f}"
            f" {row['peak_megabytes_before_scipy']:8d}"
        )
    report = {"machine": platform.processor() or platform.machine(), "rows": rows}
    (ROOT / "bench" / "spectral.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
