# SPDX-License-Identifier: GPL-3.0-or-later
"""Refitted weights against scipy's non-negative least squares and a search over all subsets."""

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import nnls

from addon.core.refit import TINY, errors, fit_weights


def problems(count: int, bones: int, seed: int, poses: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Directions (n,P·3,C) from wanted places to where each bone takes the vertex, and their Gram matrices."""
    random = np.random.default_rng(seed)
    places = random.normal(size=(count, poses * 3, bones))
    true = random.dirichlet(np.full(bones, 0.4), size=count)
    wanted = np.einsum("npc,nc->np", places, true) + 0.05 * random.normal(size=(count, poses * 3))
    directions = places - wanted[:, :, None]
    return directions, np.einsum("npc,npd->ncd", directions, directions)


def even(count: int, bones: int) -> np.ndarray:
    return np.full((count, bones), 1.0 / bones)


def by_nnls(directions: np.ndarray, total: float = 1.0) -> np.ndarray:
    """The same minimum with the total as a heavy row."""
    heavy = 1e5
    matrix = np.vstack([directions, np.full(directions.shape[1], heavy)])
    return nnls(matrix, np.append(np.zeros(len(directions)), heavy * total))[0]


@pytest.mark.parametrize("seed", range(3))
def test_without_a_limit_it_is_the_least_squares_solution(seed: int) -> None:
    directions, gram = problems(40, 6, seed)
    everything = np.ones((40, 6), bool)
    fitted = fit_weights(gram, even(40, 6), everything, ~everything, 6)
    for one, wanted in zip(fitted, (by_nnls(d) for d in directions), strict=True):
        np.testing.assert_allclose(one, wanted, atol=3e-3)
    np.testing.assert_allclose(fitted.sum(axis=1), 1.0, atol=1e-12)
    assert (fitted >= 0).all()


@pytest.mark.parametrize("limit", [1, 2, 4])
def test_limit(limit: int) -> None:
    directions, gram = problems(30, 6, 7)
    everything = np.ones((30, 6), bool)
    fitted = fit_weights(gram, even(30, 6), everything, ~everything, limit)
    assert ((fitted > 0).sum(axis=1) <= limit).all()
    np.testing.assert_allclose(fitted.sum(axis=1), 1.0, atol=1e-12)
    best = np.full(30, np.inf)
    for subset in combinations(range(6), limit):
        for number in range(30):
            weights = np.zeros(6)
            weights[list(subset)] = by_nnls(directions[number][:, subset])
            best[number] = min(best[number], errors(gram[number : number + 1], weights[None])[0])
    # Taking one after the other away is not the best of all subsets, but near.
    assert np.sqrt(errors(gram, fitted)).sum() <= 1.1 * np.sqrt(best).sum()


def test_fixed_weights_stay_and_unusable_ones_get_nothing() -> None:
    _, gram = problems(50, 6, 3)
    start = np.random.default_rng(0).dirichlet(np.ones(6), size=50)
    fixed = np.zeros((50, 6), bool)
    fixed[:, 1] = True
    usable = np.ones((50, 6), bool)
    usable[:, 4] = False
    start[:, 0] += start[:, 4]
    start[:, 4] = 0.0
    fitted = fit_weights(gram, start, usable, fixed, 3)
    np.testing.assert_array_equal(fitted[:, 1], start[:, 1])
    assert not fitted[:, 4].any()
    np.testing.assert_allclose(fitted.sum(axis=1), 1.0, atol=1e-12)
    assert ((fitted > 0).sum(axis=1) <= 3).all()


def test_no_weight_is_worse_than_at_the_start() -> None:
    _, gram = problems(200, 8, 11)
    start = np.random.default_rng(1).dirichlet(np.full(8, 0.3), size=200)
    everything = np.ones((200, 8), bool)
    fitted = fit_weights(gram, start, everything, ~everything, 8)
    assert (errors(gram, fitted) <= errors(gram, start) * (1 + 1e-3)).all()
    assert (fitted[(fitted > 0)] > TINY / 2).all()


def test_poses_that_do_not_tell_bones_apart_keep_the_weights() -> None:
    start = np.array([[0.7, 0.3, 0.0]])
    everything = np.ones((1, 3), bool)
    np.testing.assert_allclose(fit_weights(np.zeros((1, 3, 3)), start, everything, ~everything, 4), start, atol=1e-9)
