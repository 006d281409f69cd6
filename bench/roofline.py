"""What this machine could do at best, and what another position-based solver does on the same constraints."""

import os
import threading
import time

import numpy as np

# Bytes of three arrays, far beyond any cache.
BEYOND_CACHE = 384 << 20
# What a constraint is: indices of its particles, and an edge's rest length; a particle: position, inverse mass.
EDGE_BYTES, TETRAHEDRON_BYTES, PARTICLE_BYTES = 2 * 4 + 4, 4 * 4, 16
# Multiplications and additions of a projection, with its root or division as one.
EDGE_FLOPS, TETRAHEDRON_FLOPS = 30, 110


def fma_gflops(size=1024, repeats=6):
    """Peak of one core's multiply-adds in f32, as a matrix product reaches it (one BLAS thread)."""
    a, b = np.ones((2, size, size), np.float32)
    out = np.empty_like(a)
    best = np.inf
    for _ in range(repeats):
        began = time.thread_time()
        np.matmul(a, b, out=out)
        best = min(best, time.thread_time() - began)
    return 2 * size**3 / best / 1e9


def stream_gb_s(threads, repeats=6):
    """Gigabytes a second of a = b + c in f32 beyond all caches, on so many threads, each with its own arrays.

    By the threads' processor time, which other work on the machine does not stretch as it does the wall time.
    """
    count = BEYOND_CACHE // 12 // threads
    times = [[] for _ in range(threads)]

    def work(own):
        a, b, c = np.ones((3, count), np.float32)
        for _ in range(repeats):
            began = time.thread_time()
            np.add(b, c, out=a)
            own.append(time.thread_time() - began)

    workers = [threading.Thread(target=work, args=(own,)) for own in times]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return 12 * count * threads / max(min(own) for own in times) / 1e9


def roofline():
    """Both peaks of one core, and the bandwidth of two threads."""
    return {
        "fma_gflops_one_core": round(fma_gflops(), 1),
        "stream_gb_s_one_thread": round(stream_gb_s(1), 2),
        "stream_gb_s_two_threads": round(stream_gb_s(2), 2),
    }


def least_milliseconds(peaks, particles, stretch, volume, iterations):
    """Least time of so many iterations on one core, and what bounds it.

    Either the arithmetic at the peak, or the traffic at the bandwidth of memory if no cache kept anything from
    one sweep to the next: every constraint read once, every particle read and written once by each sweep.
    """
    moved = stretch * EDGE_BYTES + volume * TETRAHEDRON_BYTES + 2 * 2 * PARTICLE_BYTES * particles
    flops = stretch * EDGE_FLOPS + volume * TETRAHEDRON_FLOPS
    by_bandwidth = 1e-6 * iterations * moved / peaks["stream_gb_s_one_thread"]
    by_arithmetic = 1e-6 * iterations * flops / peaks["fma_gflops_one_core"]
    return {
        "bandwidth_ms": round(by_bandwidth, 3),
        "arithmetic_ms": round(by_arithmetic, 3),
        "ms": round(max(by_bandwidth, by_arithmetic), 3),
    }


class PyPbd:
    """PositionBasedDynamics (C++) on the tetrahedra of a cage: distance and volume constraints."""

    def __init__(self, vertices, tetrahedra, iterations, threads):
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

    def step(self):
        """One step."""
        self._step.step(self._model)
