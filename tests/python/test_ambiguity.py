"""Integer least squares against exhaustive search and numpy."""

import itertools
import pickle

import kurs
import numpy as np
import pytest
from kurs import ambiguity


def problem(random, n=3):
    root = random.normal(size=(n, n))
    return random.normal(scale=5, size=n), 0.05 * root @ root.T + 0.01 * np.eye(n)


def exhaustive(a, Q, reach=6):
    inverse = np.linalg.inv(Q)
    centre = np.round(a)
    offsets = np.array(list(itertools.product(range(-reach, reach + 1), repeat=len(a))))
    vectors = centre + offsets
    costs = np.einsum("ki,ij,kj->k", a - vectors, inverse, a - vectors)
    order = np.argsort(costs)
    return vectors[order], costs[order]


def test_lambda_is_the_exhaustive_search():
    random = np.random.default_rng(1)
    problems = [problem(random) for _ in range(50)]
    found = ambiguity.lambda_(np.array([a for a, _ in problems]), np.array([Q for _, Q in problems]), count=3)
    assert found.integers.shape == (50, 3, 3) and found.errors == {}
    for i, (a, Q) in enumerate(problems):
        vectors, costs = exhaustive(a, Q)
        assert np.array_equal(found.integers[i], vectors[:3].astype(int))
        assert np.allclose(found.costs[i], costs[:3], rtol=1e-9)
        assert found.proven_to[i] <= costs[3] * (1 + 1e-12)
        one = ambiguity.lambda_(a, Q, count=3)
        assert np.array_equal(one.integers, found.integers[i])
        assert one.success_rate == found.success_rate[i] == ambiguity.success_rate(Q)


def joint(random, k=1, per=4):
    """A baseline of length 1 (or an array) seen by code and phase with few cycles of noise."""
    n, reals = per * k, 3 * k
    design = random.normal(size=(n, reals))
    root = random.normal(size=(n + reals, n + reals)) * 0.02
    Q = root @ root.T
    Q[n:, n:] += 0.3**2 * np.eye(reals)
    Q[:n, :n] += 0.05**2 * np.eye(n) + design @ Q[n:, n:] @ design.T
    Q[:n, n:] = design @ Q[n:, n:]
    Q[n:, :n] = Q[:n, n:].T
    return Q + 1e-4 * np.eye(n + reals)


def test_length_constrained_is_the_least_of_all_candidates():
    random = np.random.default_rng(2)
    for _ in range(3):
        Q = joint(random)
        n = 4
        truth = np.r_[random.integers(-20, 20, n), [0.6, -0.8, 0.0]]
        x = random.multivariate_normal(truth, Q)
        found = ambiguity.length_constrained(
            x[:n], Q[:n, :n], x[n:], Q[n:, n:], Q[:n, n:], length_m=1.0, length_sd_m=0.0, count=1
        )
        assert np.linalg.norm(found.baselines_m[0, 0]) == pytest.approx(1.0, abs=1e-9)
        # The cost of the candidate by numpy: both terms.
        gain = np.linalg.solve(Q[:n, :n], Q[:n, n:]).T
        conditional = Q[n:, n:] - gain @ Q[:n, n:]

        def cost(integers, baseline):
            off = x[:n] - integers
            rest = x[n:] - gain @ off - baseline
            return off @ np.linalg.solve(Q[:n, :n], off) + rest @ np.linalg.solve(conditional, rest)

        best = cost(found.integers[0], found.baselines_m[0, 0])
        assert found.costs[0] == pytest.approx(best, rel=1e-8)
        # No neighbour with any baseline of that length is better.
        directions = random.normal(size=(100, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        for offset in itertools.product([-1, 0, 1], repeat=n):
            rivals = [cost(found.integers[0] + offset, b) for b in directions]
            assert min(rivals) >= best - 1e-9


def test_array_constrained_keeps_the_array():
    random = np.random.default_rng(3)
    body = np.array([[1.0, 0, 0], [0, 0.8, 0]])
    Q = joint(random, k=2)
    n = 8
    truth = np.r_[random.integers(-20, 20, n), body.ravel()]
    x = random.multivariate_normal(truth, Q)
    found = ambiguity.array_constrained(x[:n], Q[:n, :n], x[n:], Q[n:, n:], Q[:n, n:], body, [4, 4], count=1)
    baselines = found.baselines_m[0]
    assert np.allclose(baselines @ baselines.T, body @ body.T, atol=1e-8)
    # A body for each problem.
    two = ambiguity.array_constrained(
        np.stack([x[:n]] * 2), Q[:n, :n], x[n:], Q[n:, n:], Q[:n, n:], np.stack([body, 1.1 * body]), [4, 4], count=1
    )
    larger = ambiguity.array_constrained(x[:n], Q[:n, :n], x[n:], Q[n:, n:], Q[:n, n:], 1.1 * body, [4, 4], count=1)
    assert two.costs[0] == found.costs and two.costs[1] == larger.costs


def test_errors():
    with pytest.raises(kurs.NoSolution, match="not positive definite"):
        ambiguity.lambda_([0.1, 0.2], -np.eye(2))
    for count in (10**12, 2**63):
        with pytest.raises(ValueError, match=rf"count is {count}, expected at most 89478485 for 1 problem"):
            ambiguity.lambda_([0.1, 0.2], np.eye(2), count=count)
    Q = np.eye(5)
    with pytest.raises(ValueError, match="count is 1000000000000, expected at most"):
        ambiguity.length_constrained([0.1, 0.2], Q[:2, :2], [1, 0, 0], Q[2:, 2:], Q[:2, 2:], 1.0, count=10**12)
    assert np.isfinite(ambiguity.lambda_([0.1, 0.2], np.eye(2), count=1000, horizon=5).costs).sum() < 100
    with pytest.raises(ValueError, match=r"Q has the shape \[3, 3\], expected 2 rows and columns"):
        ambiguity.lambda_([0.1, 0.2], np.eye(3))
    many = ambiguity.lambda_(np.zeros((2, 2)), np.stack([np.eye(2), -np.eye(2)]))
    assert list(many.errors) == [1] and np.isnan(many.costs[1]).all()


def test_numbers_that_cannot_be_are_refused():
    Q = np.eye(2)
    for horizon in (np.nan, -1):
        with pytest.raises(kurs.NoSolution, match="the horizon is out of range"):
            ambiguity.lambda_([0.1, 0.2], Q, horizon=horizon)
    for wrong in (np.full((2, 2), np.nan), -Q):
        with pytest.raises(kurs.NoSolution, match="not positive definite"):
            ambiguity.success_rate(wrong)
    assert np.isnan(ambiguity.success_rate(np.stack([Q, -Q]))).tolist() == [False, True]
    Q = joint(np.random.default_rng(4))
    for ambiguities_of in ([0, 0, 4], [0], [2**63, 2**63 + 4]):
        with pytest.raises(ValueError, match=r"ambiguities_of is .*, expected 1 numbers with the sum 4"):
            ambiguity.array_constrained(
                np.zeros(4), Q[:4, :4], [1, 0, 0], Q[4:, 4:], Q[:4, 4:], [[1, 0, 0]], ambiguities_of
            )


def test_covariances_are_symmetric():
    a, Q = problem(np.random.default_rng(7))
    with pytest.raises(ValueError, match=r"Q is not symmetric: \[1, 0\] is"):
        ambiguity.lambda_(a, np.triu(Q))
    assert np.array_equal(ambiguity.lambda_(a, Q.astype(np.float32)).integers, ambiguity.lambda_(a, Q).integers)


def test_candidates_in_a_pickle_are_the_same():
    many = ambiguity.lambda_([[0.1, 0.2], [5.3, 6.4]], np.stack([np.eye(2), -np.eye(2)]), count=3)
    Q = joint(np.random.default_rng(4))
    one = ambiguity.length_constrained(np.full(4, 0.2), Q[:4, :4], [1, 0, 0], Q[4:, 4:], Q[:4, 4:], 1.0)
    for found in (many, one):
        again = pickle.loads(pickle.dumps(found))
        for name in ("integers", "costs", "baselines_m", "proven_to", "success_rate"):
            assert np.array_equal(getattr(again, name), getattr(found, name), equal_nan=True), name
        assert again.errors == found.errors
