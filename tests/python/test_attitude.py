"""Attitudes against 50-digit vectors, scipy, and themselves one by one."""

import pickle

import kurs
import numpy as np
import pytest
from kurs import attitude
from scipy.spatial.transform import Rotation

#: Fair for doubles against 50 digits.
TOLERANCE = 1e-10


def kind(vectors, key, word):
    return [case for case in vectors[key] if case.get("kind", key) == word]


def test_phases_of_the_vectors(vectors):
    for case in kind(vectors, "attitude", "phase"):
        given, expected = case["input"], case["expected"]
        body = np.transpose(given["body"])
        phases = np.transpose(given["phi_sd_m"])
        for name, shared in [("diag", False), ("full", True)]:
            found = attitude.from_phases(body, given["los"], given["sigma_sd_m"], phases, shared_antenna=shared)
            wanted = [np.array(expected[f"{name}_Q"])]
            gap = expected.get(f"{name}_next_local_min_cost_gap")
            if gap is not None and gap < 1e-12 * abs(expected[f"{name}_cost_reduced"]):
                wanted.append(np.array(expected[f"{name}_second_Q"]))
            assert min(np.linalg.norm(found.matrix - w) for w in wanted) < TOLERANCE, case["name"]
            assert found.cost == pytest.approx(expected[f"{name}_cost_reduced"], rel=TOLERANCE)
            if name == "full" and len(wanted) == 1:
                cov = np.array(expected["full_cov_gn_body"])
                assert np.linalg.norm(found.cov - cov) < 1e-9 * np.linalg.norm(cov), case["name"]


def test_stacked_baselines_of_the_vectors(vectors):
    for case in kind(vectors, "attitude", "omega"):
        given, expected = case["input"], case["expected"]
        body = np.transpose(given["body"])
        local = np.reshape(given["z"], (-1, 3))
        found = attitude.general(body, local, np.linalg.inv(given["omega"]))
        assert np.linalg.norm(found.matrix - expected["Q"]) < TOLERANCE, case["name"]


def test_lines_of_the_vectors_leave_the_attitude_open(vectors):
    for case in kind(vectors, "attitude", "phase_collinear"):
        given = case["input"]
        with pytest.raises(kurs.NoSolution):
            attitude.from_phases(
                np.transpose(given["body"]), given["los"], given["sigma_sd_m"], np.transpose(given["phi_sd_m"])
            )


def test_three_points_of_the_vectors(vectors):
    for case in vectors["three_point"]:
        given, expected = case["input"], case["expected"]
        body, measured = np.array(given["body"]), np.array(given["measured"])
        tolerance = 1e-8 if np.abs(measured).max() > 1e5 else TOLERANCE
        if expected.get("Q_from_M") is None:
            with pytest.raises(kurs.NoSolution):
                attitude.three_point(body, measured)
        else:
            found = attitude.three_point(body, measured)
            assert np.linalg.norm(found.matrix - expected["Q_from_M"]) < tolerance, case["name"]
        weights = np.array(given["weights"])
        centre = [np.average(points, axis=0, weights=weights) for points in (body, measured)]
        found = attitude.wahba(body - centre[0], measured - centre[1], weights)
        assert np.linalg.norm(found.matrix - expected["Q_wahba"]) < tolerance, case["name"]
        wanted = np.array(expected["quat_wxyz"])
        assert min(np.linalg.norm(found.quat_wxyz - s * wanted) for s in (1, -1)) < tolerance


def scenes(count, seed=1, vectors=5):
    random = np.random.default_rng(seed)
    body = random.normal(size=(count, vectors, 3))
    truth = Rotation.random(count, random_state=seed).as_matrix()
    local = np.einsum("nij,nmj->nmi", truth, body) + 0.01 * random.normal(size=body.shape)
    return body, local, truth, random.uniform(0.5, 2, size=(count, vectors))


def test_wahba_beside_scipy():
    body, local, _, weights = scenes(200)
    found = attitude.wahba(body, local, weights)
    assert len(found) == 200 and found.errors == {}
    for i in range(200):
        # scipy rotates its second argument into the first.
        wanted, _ = Rotation.align_vectors(local[i], body[i], weights[i])
        assert np.allclose(found.matrix[i], wanted.as_matrix(), atol=1e-12)
        one = attitude.wahba(body[i], local[i], weights[i])
        assert np.array_equal(one.matrix, found.matrix[i])
        assert one.heading_deg == found.heading_deg[i]
    wanted = found.to_scipy().as_quat(scalar_first=True, canonical=True)
    assert np.allclose(found.quat_wxyz, wanted, atol=1e-14)


def test_heading_pitch_and_roll_are_those_of_the_conventions():
    heading, pitch, roll = 250.0, 12.0, -30.0
    matrix = Rotation.from_euler("ZYX", [heading, pitch, roll], degrees=True).as_matrix()
    found = attitude.angles(matrix, np.diag([1e-4, 4e-4, 9e-4]))
    assert [found.heading_deg, found.pitch_deg, found.roll_deg] == pytest.approx([heading, pitch, roll])
    level = attitude.angles(np.eye(3), np.diag([1e-4, 4e-4, 9e-4]))
    sds = [level.roll_sd_deg, level.pitch_sd_deg, level.heading_sd_deg]
    assert sds == pytest.approx(np.degrees([0.01, 0.02, 0.03]))
    upright = attitude.angles(Rotation.from_euler("ZYX", [0, 90, 0], degrees=True).as_matrix(), 1e-4 * np.eye(3))
    assert np.isnan([upright.heading_sd_deg, upright.roll_sd_deg]).all()
    assert upright.pitch_sd_deg == pytest.approx(np.degrees(0.01))


def test_weighted_is_the_least_squares_of_numpy():
    """The gradient of the cost that numpy computes is zero at the minimum, and the scatter is the covariance."""
    body, local, truth, _ = scenes(400, seed=3, vectors=3)
    cov = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 2.0], [0.5, 2.0, 25.0]]) * 1e-6
    random = np.random.default_rng(4)
    # Baselines from one antenna share its noise: covariance of all is (I + 11ᵀ) / 2 ⊗ cov.
    shared = np.kron((np.eye(3) + 1) / 2, cov)
    noise = random.multivariate_normal(np.zeros(9), shared, size=400).reshape(400, 3, 3)
    local = np.einsum("nij,nmj->nmi", truth, body) + noise
    found = attitude.weighted(body, local, cov)
    full = attitude.general(body, local, np.broadcast_to(shared, (400, 9, 9)))
    assert np.allclose(found.matrix, full.matrix, atol=1e-10)
    assert np.allclose(found.cov, full.cov, rtol=1e-8)
    errors = Rotation.from_matrix(np.einsum("nji,njk->nik", truth, found.matrix)).as_rotvec()
    squares = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(found.cov), errors)
    # The mean of chi² with three degrees over 400: 3 ± 4.4 · √(6/400) at 99.999 %.
    assert abs(squares.mean() - 3) < 0.54


def test_relative_of_two_bodies():
    body, local, _, _ = scenes(20, vectors=3)
    cov = 1e-6 * np.eye(3)
    first = attitude.weighted(body[:10], local[:10], cov)
    second = attitude.weighted(body[10:], local[10:], cov)
    found = attitude.relative(first, second)
    assert np.allclose(found.matrix, np.einsum("nji,njk->nik", first.matrix, second.matrix), atol=1e-14)
    one = attitude.weighted(body[0], local[0], cov)
    assert len(attitude.relative(one, second)) == 10
    with pytest.raises(ValueError, match="first is 10 attitudes, second is 20"):
        attitude.relative(first, attitude.angles(np.broadcast_to(np.eye(3), (20, 3, 3))))


def test_what_has_no_solution_is_an_exception_alone_and_nan_among_many():
    line = np.array([[1.0, 0, 0], [2.0, 0, 0]])
    with pytest.raises(kurs.NoSolution):
        attitude.wahba(line, line)
    plane = np.eye(3)[:2]
    found = attitude.wahba(np.stack([plane, line]), np.stack([plane, line]))
    assert np.isnan(found.matrix[1]).all() and not np.isnan(found.matrix[0]).any()
    assert list(found.errors) == [1]


def test_a_failed_problem_of_many_has_no_angle():
    plane = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    east = np.array([[0, 1.0, 0], [-1.0, 0, 0]])
    found = attitude.wahba(plane, np.stack([east, east * np.nan, east]))
    assert list(found.errors) == [1]
    for name in ("heading_deg", "pitch_deg", "roll_deg", "heading_sd_deg", "cost"):
        assert np.isnan(getattr(found, name)[1]), name
    assert found.heading_deg[[0, 2]].tolist() == pytest.approx([90, 90])
    assert np.isnan(found.quat_wxyz[1]).all()
    scipy = found.to_scipy()
    assert len(scipy) == 3 and np.isnan(scipy.as_matrix()[1]).all()
    assert np.allclose(scipy.as_matrix()[[0, 2]], found.matrix[[0, 2]], atol=1e-15)
    for pair, side in (((found, found), "first"), ((attitude.wahba(plane, east), found), "second")):
        relative = attitude.relative(*pair)
        assert list(relative.errors) == [1] and relative.errors[1] == f"{side}: {found.errors[1]}"
        assert np.isnan(relative.heading_deg).tolist() == [False, True, False]


def test_shapes_are_told():
    with pytest.raises(ValueError, match=r"body has the shape \[2, 4\], expected three columns"):
        attitude.wahba(np.zeros((2, 4)), np.zeros((2, 3)))
    with pytest.raises(ValueError, match="local is of 3 problems, body of 2"):
        attitude.wahba(np.zeros((2, 4, 3)), np.zeros((3, 4, 3)))
    with pytest.raises(ValueError, match="no rotation"):
        attitude.angles(2 * np.eye(3))


def test_counts_that_do_not_belong_together_are_told():
    plane, cube = np.eye(3)[:2], np.eye(3)
    rows = r"local has the shape \[3, 3\], expected 2 rows, one for each row of body"
    # Of many problems, too, where it is the same for all.
    for body in (plane, np.stack([plane, plane])):
        with pytest.raises(ValueError, match=rows):
            attitude.wahba(body, cube)
        with pytest.raises(ValueError, match=rows):
            attitude.weighted(body, cube, cube)
        with pytest.raises(ValueError, match=rows):
            attitude.general(body, cube, np.eye(6))
        for weights in ([1.0], [1.0, 2, 3]):
            with pytest.raises(ValueError, match="weights has the shape .*, expected 2 numbers"):
                attitude.wahba(body, plane, weights)
        with pytest.raises(ValueError, match=r"weights\[1\] is -1, expected 0 or more"):
            attitude.wahba(body, plane, [1, -1])
        with pytest.raises(ValueError, match=r"sigma_m has the shape \[2\], expected 3 numbers for each band"):
            attitude.from_phases(body, cube, [1, 1], np.zeros((2, 2)))
        with pytest.raises(ValueError, match=r"phases_m has the shape \[3, 3\], expected 2 rows .* and 3 columns"):
            attitude.from_phases(body, cube, [1, 1, 1], np.zeros((3, 3)))
        with pytest.raises(ValueError, match=r"sigma_m\[2\] is 0, expected a number above zero"):
            attitude.from_phases(body, cube, [1, 1, 0], np.zeros((2, 3)))
    many = np.stack([plane, plane])
    for function, size in ((attitude.weighted, 3), (attitude.general, 6)):
        with pytest.raises(ValueError, match="cov_m2 is not positive definite, and the same for all problems"):
            function(many, many, -np.eye(size))
        with pytest.raises(ValueError, match="^cov_m2 is not symmetric: "):
            function(plane, plane, np.eye(size) + np.eye(size, k=1))
        # Symmetric for single precision.
        function(plane, plane, np.eye(size) + 1e-8 * np.eye(size, k=1))


def test_what_is_no_number_is_refused_by_name():
    body = np.eye(3)
    masked = np.ma.masked_equal(np.array([[1.0, 0, 0], [0, 1, 0], [-9, -9, -9]]), -9)
    for local in (masked, masked.astype(int), [body[0], body[1], masked[2]]):
        with pytest.raises(ValueError, match="^local has masked values, expected real numbers, NaN for a missing one"):
            attitude.wahba(body, local)
    found = attitude.wahba(body, np.ma.masked_equal(body, -9))
    assert np.array_equal(found.matrix, body)
    with pytest.raises(ValueError, match="^body has complex numbers, expected real numbers"):
        attitude.wahba(body + 1j, body)
    for times in (np.zeros((3, 3), "datetime64[s]"), np.zeros((3, 3), "timedelta64[s]")):
        with pytest.raises(ValueError, match="^body has instants or times, expected real numbers"):
            attitude.wahba(times, body)
    for same in (body.astype("f4"), body.astype(int), body.astype(bool), body.astype(object), body.astype(">f8"), body.tolist()):
        assert np.array_equal(attitude.wahba(same, body).matrix, body)


def test_truth_of_attitudes():
    assert attitude.angles(np.eye(3)) and attitude.angles(np.eye(3)[None])
    assert not attitude.angles(np.zeros((0, 3, 3)))


def test_any_layout_and_lists():
    body, local, _, _ = scenes(1)
    wanted = attitude.wahba(body[0], local[0]).matrix
    assert np.array_equal(attitude.wahba(body[0].tolist(), np.asfortranarray(local[0])).matrix, wanted)
    wide = np.zeros((5, 6))
    wide[:, ::2] = body[0]
    assert np.array_equal(attitude.wahba(wide[:, ::2], local[0]).matrix, wanted)


def test_attitudes_in_a_pickle_are_the_same():
    body, local, _, _ = scenes(2, vectors=3)
    cov = 1e-6 * np.eye(3)
    for found in (
        attitude.weighted(body[0], local[0], cov),
        attitude.weighted(body, local, np.stack([cov, -cov])),
    ):
        again = pickle.loads(pickle.dumps(found))
        for name in ("matrix", "cov", "heading_deg", "roll_sd_deg", "cost", "cost_gap"):
            assert np.array_equal(getattr(again, name), getattr(found, name), equal_nan=True), name
        assert again.errors == found.errors
