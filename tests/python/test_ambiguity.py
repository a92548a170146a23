"""Integer least squares against exhaustive search and numpy."""

import itertools
import pickle
import subprocess
import sys

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
        with pytest.raises(ValueError, match="horizon is .*, expected 0 or more"):
            ambiguity.lambda_([0.1, 0.2], Q, horizon=horizon)
    for wrong in (np.full((2, 2), np.nan), -Q):
        with pytest.raises(kurs.NoSolution, match="not positive definite"):
            ambiguity.success_rate(wrong)
    assert np.isnan(ambiguity.success_rate(np.stack([Q, -Q]))).tolist() == [False, True]
    Q = joint(np.random.default_rng(4))
    float_solution = np.zeros(4), Q[:4, :4], [1, 0, 0], Q[4:, 4:], Q[:4, 4:]
    body = [[1, 0, 0]]
    for ambiguities_of, words in (([0, 0, 4], "has 3 numbers, expected 1"), ([0], r"is \[0\], expected a sum of 4")):
        with pytest.raises(ValueError, match=f"ambiguities_of {words}"):
            ambiguity.array_constrained(*float_solution, body, ambiguities_of)
    with pytest.raises(ValueError, match="ambiguities_of is .*, expected a sum of 4"):
        two = np.zeros(4), Q[:4, :4], np.zeros(6), np.eye(6), np.zeros((4, 6))
        ambiguity.array_constrained(*two, np.eye(3)[:2], [2**63, 2**63 + 4])
    with pytest.raises(ValueError, match=r"b has the shape \[3\], expected 6 numbers"):
        ambiguity.array_constrained(*float_solution, np.eye(3)[:2], [2, 2])
    many = np.zeros((2, 4)), *float_solution[1:]
    for problems in (float_solution, many):
        for sd_m in (-1, np.nan, np.inf):
            with pytest.raises(ValueError, match="array_sd_m is .*, expected 0 or more"):
                ambiguity.array_constrained(*problems, body, [4], sd_m)
            with pytest.raises(ValueError, match="length_sd_m is .*, expected 0 or more"):
                ambiguity.length_constrained(*problems, 1.0, sd_m)
        for length_m in (0, -1, np.nan, np.inf):
            with pytest.raises(ValueError, match="length_m is .*, expected a number above zero"):
                ambiguity.length_constrained(*problems, length_m)
    with pytest.raises(ValueError, match="Q is not positive definite, and the same for all problems"):
        ambiguity.lambda_(np.zeros((2, 2)), -np.eye(2))
    with pytest.raises(ValueError, match="Q_a is not positive definite, and the same for all problems"):
        ambiguity.length_constrained(many[0], -Q[:4, :4], *many[2:], 1.0)


def test_each_problem_has_its_own_array():
    random = np.random.default_rng(3)
    body = np.array([[1.0, 0, 0], [0, 0.8, 0]])
    bodies = np.stack([body, 1.1 * body, body[:, [1, 0, 2]]])
    Q = joint(random, k=2)
    n = 8
    x = np.stack([random.multivariate_normal(np.r_[random.integers(-20, 20, n), b.ravel()], Q) for b in bodies])
    covariances = Q[:n, :n], Q[n:, n:], Q[:n, n:]

    def solve(x, body):
        Q_a, Q_b, Q_ab = covariances
        return ambiguity.array_constrained(x[..., :n], Q_a, x[..., n:], Q_b, Q_ab, body, [4, 4])

    found = solve(x, bodies)
    for i in range(3):
        one = solve(x[i], bodies[i])
        assert np.array_equal(found.integers[i], one.integers) and np.array_equal(found.costs[i], one.costs, equal_nan=True)
    # Of one float solution with three arrays there are three answers, too.
    assert solve(x[0], bodies).costs.shape == (3, 2)
    assert solve(x[:0], bodies[:0]).costs.shape == (0, 2)
    with pytest.raises(ValueError, match="body is of 3 problems, b of 2"):
        solve(x[:2], bodies)


def test_covariances_that_are_not_symmetric_are_refused():
    a, Q = np.array([5.45, 3.1, 2.97]), np.array([[6.29, 5.978, 0.544], [5.978, 6.292, 2.34], [0.544, 2.34, 6.288]])
    for wrong in (np.tril(Q), np.triu(Q)):
        for call in (lambda Q: ambiguity.lambda_(a, Q), ambiguity.success_rate):
            with pytest.raises(ValueError, match=r"^Q is not symmetric: "):
                call(wrong)
    with pytest.raises(ValueError, match=r"^Q of problem 1 is not symmetric: -99 in row 2, column 0, 0.544 in row 0, column 2"):
        wrong = Q.copy()
        wrong[2, 0] = -99
        ambiguity.lambda_(a, np.stack([Q, wrong]))
    # Rounding passes, and counts from either side.
    rounded = Q.copy()
    rounded[2, 0] = np.float32(0.544) + 1e-7
    assert np.array_equal(ambiguity.lambda_(a, rounded).costs, ambiguity.lambda_(a, rounded.T).costs)
    assert ambiguity.lambda_(a.astype("f4"), Q.astype("f4")).integers[0].tolist() == [5, 3, 4]


def test_many_problems_end_by_ctrl_c():
    code = """
import os, signal, threading, time, kurs, numpy as np
signal.signal(signal.SIGINT, signal.default_int_handler)
random = np.random.default_rng(1)
G = random.normal(size=(30, 3))
Q = 5 * G @ G.T + 0.05 * np.eye(30)
ended = threading.Event()
def press():
    while not ended.wait(0.5):
        os.kill(os.getpid(), signal.SIGINT)
began = time.monotonic()
threading.Thread(target=press, daemon=True).start()
try:
    # Twenty seconds on two processors.
    kurs.ambiguity.lambda_(random.uniform(-5, 5, (5000, 30)), (Q + Q.T) / 2, count=50)
except KeyboardInterrupt:
    ended.set()
    is_soon = time.monotonic() - began < 3
    print("ended", is_soon, kurs.ambiguity.lambda_(np.zeros((1000, 8)), np.eye(8)).costs.shape)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout == "ended True (1000, 2)\n", done.stderr


def test_candidates_in_a_pickle_are_the_same():
    many = ambiguity.lambda_([[0.1, 0.2], [5.3, 6.4]], np.stack([np.eye(2), -np.eye(2)]), count=3)
    Q = joint(np.random.default_rng(4))
    one = ambiguity.length_constrained(np.full(4, 0.2), Q[:4, :4], [1, 0, 0], Q[4:, 4:], Q[:4, 4:], 1.0)
    for found in (many, one):
        again = pickle.loads(pickle.dumps(found))
        for name in ("integers", "costs", "baselines_m", "proven_to", "success_rate"):
            assert np.array_equal(getattr(again, name), getattr(found, name), equal_nan=True), name
        assert again.errors == found.errors
