# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain weights that come nearest to a skin: a convex quadratic program for each vertex.

With weights w that total 1, a vertex's error in pose p is |sum of w_b d_pb|, d_pb from the wanted place to where
bone b alone takes the vertex. Summed over poses that is w·G·w with G = sum of d_p d_pᵀ. The minimum over
w >= 0 with a fixed total is found by a primal active-set method, all vertices at a time; each step is
feasible and none is worse than the one before.
"""

from __future__ import annotations

import numpy as np

from .character import Flags, Floats

# Pull towards the weights that are there, against arbitrary ones where poses do not tell bones apart.
PULL = 1e-4
# Weights below this are none.
TINY = 1e-4
_TOLERANCE = 1e-10


def fit_weights(gram: Floats, start: Floats, usable: Flags, fixed: Flags, limit: int) -> Floats:
    """Weights (n,C) of n vertices over C candidate bones each.

    gram (n,C,C) is G; start (n,C) are feasible weights, which the result replaces with others of the same
    total. Only `usable` (n,C) candidates get weight, `fixed` ones keep theirs. At most `limit` weights of a
    vertex are above zero, the fixed ones included, as far as those leave room.
    """
    scale = np.maximum(np.trace(gram, axis1=1, axis2=2), 1e-30) / gram.shape[1]
    gram = gram / scale[:, None, None]
    usable = usable & ~fixed
    weights = _minimum(gram, start, start, usable)
    usable = usable & (weights > TINY)
    weights = _without(weights, usable, fixed)
    for _ in range(gram.shape[1]):
        count = ((weights > 0) & ~fixed).sum(axis=1)
        room = np.maximum(limit - (fixed & (weights > 0)).sum(axis=1), 1)
        over = np.flatnonzero(count > room)
        if not len(over):
            break
        # The smallest goes, and the others are fitted again.
        candidates = np.where(usable[over] & (weights[over] > 0), weights[over], np.inf)
        usable[over, np.argmin(candidates, axis=1)] = False
        begun = _without(weights[over], usable[over], fixed[over])
        fitted = _minimum(gram[over], begun, start[over], usable[over])
        weights[over] = _without(fitted, usable[over] & (fitted > TINY), fixed[over])
    return weights


def errors(gram: Floats, weights: Floats) -> Floats:
    """Sums of squared errors (n,) over the poses."""
    return np.asarray(np.maximum(np.einsum("nc,ncd,nd->n", weights, gram, weights), 0.0), np.float64)


def _without(weights: Floats, usable: Flags, fixed: Flags) -> Floats:
    """The weights with those that are neither usable nor fixed at zero; the usable ones take what these had.

    A row whose usable weights are all zero stays as it is.
    """
    own = np.where(usable, weights, 0.0)
    total = own.sum(axis=1, keepdims=True)
    wanted = np.where(fixed, 0.0, weights).sum(axis=1, keepdims=True)
    scaled = own * np.divide(wanted, total, out=np.zeros_like(total), where=total > 0)
    return np.where(fixed | (total <= 0), weights, scaled)


def _minimum(gram: Floats, begun: Floats, pulled_to: Floats, free: Flags) -> Floats:
    """Minimum over the `free` weights (n,C) at zero or above, the others as they are, totals as in `begun`."""
    width = begun.shape[1]
    hessian = gram + PULL * np.eye(width)
    linear = -PULL * pulled_to
    weights = begun.copy()
    inside = free & (weights > 0)
    todo = np.flatnonzero(free.any(axis=1))
    for _ in range(6 * width):
        if not len(todo):
            break
        active, now = inside[todo], weights[todo]
        wanted, multiplier = _on_face(hessian[todo], linear[todo], now, active)
        step = wanted - now
        falling = active & (wanted < -_TOLERANCE)
        ratio = np.where(falling, now / np.maximum(now - wanted, 1e-300), np.inf)
        length = np.minimum(ratio.min(axis=1), 1.0)
        weights[todo] = np.where(active, np.maximum(now + length[:, None] * step, 0.0), now)
        blocked = length < 1.0
        rows = np.arange(len(todo))
        hit = np.argmin(ratio, axis=1)
        inside[todo[blocked], hit[blocked]] = False
        weights[todo[blocked], hit[blocked]] = 0.0
        # On the face's minimum: let in the weight at zero that would lower the error most.
        gradient = np.einsum("ncd,nd->nc", hessian[todo], weights[todo]) + linear[todo] - multiplier[:, None]
        gradient = np.where(free[todo] & ~active, gradient, np.inf)
        enter = np.argmin(gradient, axis=1)
        entering = ~blocked & (gradient[rows, enter] < -1e-9)
        inside[todo[entering], enter[entering]] = True
        todo = todo[blocked | entering]
    return weights


def _on_face(hessian: Floats, linear: Floats, now: Floats, active: Flags) -> tuple[Floats, Floats]:
    """Minimum with only the active weights changing and their total kept; and the total's multiplier (n,)."""
    count, width = now.shape
    system = np.zeros((count, width + 1, width + 1))
    system[:, :width, :width] = np.where(active[:, :, None], hessian, np.eye(width))
    system[:, :width, width] = -active.astype(np.float64)
    system[:, width, :width] = 1.0
    # Where nothing is active the total's row would be singular.
    empty = ~active.any(axis=1)
    system[empty, width, :width] = 0.0
    system[empty, width, width] = 1.0
    right = np.zeros((count, width + 1))
    right[:, :width] = np.where(active, -linear, now)
    right[:, width] = np.where(empty, 0.0, now.sum(axis=1))
    solution = np.linalg.solve(system, right[:, :, None])[:, :, 0]
    return solution[:, :width], solution[:, width]
