"""What this machine could do at best, and what another position-based solver does on the same constraints."""

import os
import threading
import time

import numpy as np

# Bytes of triad arrays: three of them far beyond any cache, or within a core's own.
BEYOND_CACHE, IN_CACHE = 96 << 20, 192 << 10
BLOCK = 2048  # rows of a block that two passes share in the first-level cache
# What a projection reads and writes: particles of 16 bytes, their indices, the rest length.
EDGE_BYTES, TETRAHEDRON_BYTES = 2 * 2 * 16 + 2 * 4 + 4, 4 * 2 * 16 + 4 * 4
# And computes: multiplications, additions, one root or division each.
EDGE_FLOPS, TETRAHEDRON_FLOPS = 30, 110


def fma_gflops(size=1024, repeats=6):
    """Peak of one core's multiply-adds in f32, as a matrix product reaches it (one BLAS thread)."""
    a, b = np.ones((2, size, size), np.float32)
    out = np.empty_like(a)
    best = np.inf
    for _ in range(repeats):
        began = time.perf_counter()
        np.matmul(a, b, out=out)
        best = min(best, time.perf_counter() - began)
    return 2 * size**3 / best / 1e9


def triad_gb_s(total_bytes, threads=1, repeats=8):
    """Gigabytes a second of a = b + s c in f32, three streams, on so many threads, each with its own arrays."""
    count = total_bytes // 12 // threads
    rounds = max(1, (16 << 20) // total_bytes)
    arrays = [np.ones((3, count), np.float32) for _ in range(threads)]

    def work(own):
        a, b, c = own
        for _ in range(rounds):
            for start in range(0, count, BLOCK * 8):
                part = slice(start, start + BLOCK * 8)
                np.multiply(c[part], np.float32(0.5), out=a[part])
                np.add(a[part], b[part], out=a[part])

    best = np.inf
    for _ in range(repeats):
        workers = [threading.Thread(target=work, args=(own,)) for own in arrays]
        began = time.perf_counter()
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        best = min(best, time.perf_counter() - began)
    return 12 * count * threads * rounds / best / 1e9


def roofline():
    """Both peaks of one core, and the bandwidth of two threads."""
    return {
        "fma_gflops_one_core": round(fma_gflops(), 1),
        "triad_gb_s_memory_one_thread": round(triad_gb_s(BEYOND_CACHE), 2),
        "triad_gb_s_memory_two_threads": round(triad_gb_s(BEYOND_CACHE, 2), 2),
        "triad_gb_s_cache_one_thread": round(triad_gb_s(IN_CACHE), 2),
    }


def least_milliseconds(machine, stretch, volume, iterations):
    """Least time of so many iterations on one core, and whether bandwidth or arithmetic bounds it.

    Every projection moves its particles and reads its constraint at the bandwidth of memory; what a cache
    saves of that is the solver's to win.
    """
    moved = stretch * EDGE_BYTES + volume * TETRAHEDRON_BYTES
    flops = stretch * EDGE_FLOPS + volume * TETRAHEDRON_FLOPS
    by_bandwidth = 1e-6 * iterations * moved / machine["triad_gb_s_memory_one_thread"]
    by_arithmetic = 1e-6 * iterations * flops / machine["fma_gflops_one_core"]
    return {"bandwidth_ms": by_bandwidth, "arithmetic_ms": by_arithmetic, "ms": max(by_bandwidth, by_arithmetic)}


class PyPbd:
    """PositionBasedDynamics (C++) on the tetrahedra of a cage: distance and volume constraints, two threads."""

    def __init__(self, vertices, tetrahedra, iterations, threads=2):
        os.environ["OMP_NUM_THREADS"] = str(threads)
        import pypbd  # None of our packages needs it; the caller does without where it is not installed.

        pairs = ([0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3])
        edges = np.unique(np.sort(np.concatenate([tetrahedra[:, pair] for pair in pairs]), axis=1), axis=0)
        self.stretch, self.volume, self.iterations = len(edges), len(tetrahedra), iterations
        scaled = (vertices - vertices.mean(0)) * (2.0 / np.ptp(vertices, axis=0).max())
        simulation = pypbd.Simulation.getCurrent()
        simulation.initDefault()
        self._model, self._step = simulation.getModel(), simulation.getTimeStep()
        self._step.setValueUInt(pypbd.TimeStepController.NUM_SUB_STEPS, 1)
        self._step.setValueUInt(pypbd.TimeStepController.MAX_ITERATIONS, iterations)
        self._model.addTetModel(
            list(scaled.astype(np.float32)), tetrahedra.astype(np.uint32).ravel().tolist(), testMesh=False
        )
        for i, j in edges.tolist():
            self._model.addDistanceConstraint(i, j, 1.0)
        for corners in tetrahedra.tolist():
            self._model.addVolumeConstraint(*corners, 1.0)
        self._model.initConstraintGroups()
        random = np.random.default_rng(0)
        particles = self._model.getParticles()
        for i, position in enumerate(scaled):
            particles.setPosition(i, (position + 0.002 * random.standard_normal(3)).astype(np.float32))
        pypbd.TimeManager.getCurrent().setTimeStepSize(0.005)

    def milliseconds(self):
        """Of one step."""
        began = time.perf_counter()
        self._step.step(self._model)
        return 1e3 * (time.perf_counter() - began)
