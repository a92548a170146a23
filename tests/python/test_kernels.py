"""Selection, trajectory and calibration against the vectors and numpy."""

import kurs
import numpy as np
import pytest
from kurs import calibration, selection, trajectory

GRAPHS = {"tree": "tree", "general": "general"}
CRITERIA = {
    "kappa": "baseline_condition",
    "kappa_att": "information_condition",
    "lmin_att": "smallest_information",
    "trace_cov_att": "trace_of_covariance",
}


def test_selection_of_the_vectors(vectors):
    for case in vectors["baseline"]:
        for graph in GRAPHS:
            for short, criterion in CRITERIA.items():
                expected = case["expected"][f"{graph}_{short}"]
                if expected is None or expected["value"] is None:
                    with pytest.raises(kurs.NoSolution):
                        selection.select(case["input"]["positions"], graph=graph, criterion=criterion)
                    continue
                pairs, value, bound = selection.select(case["input"]["positions"], graph=graph, criterion=criterion)
                assert value == pytest.approx(expected["value"], rel=1e-10), case
                if expected["ties_within_1e9"] == 1:
                    assert [list(pair) for pair in pairs] == expected["edges"]


SETS = {
    "A4": [(0, "azimuth", None), (0, "elevation", None), (1, "azimuth", None), (1, "elevation", None)],
    "A3a": [(0, "azimuth", None), (0, "elevation", None), (1, "azimuth", None)],
    "A3g": [(0, "azimuth", None), (0, "elevation", None), (1, "elevation", None)],
    "DC4": [(0, "cosine_north", None), (0, "cosine_east", None), (1, "cosine_north", None), (1, "cosine_east", None)],
    "RAE": [(0, "range", None), (0, "azimuth", None), (0, "elevation", None)],
    "R3": [(2, "range", None), (3, "range", None), (4, "range", None)],
    "RD3": [(station, "range_difference", 2) for station in (3, 4, 5)],
}


def test_trajectories_of_the_vectors(vectors):
    checked = 0
    for case in vectors["trajectory"]:
        if not case["lsq"].get("converged"):
            continue
        # Columns of Phi are north, up, east.
        axes = [np.column_stack([p[:, 0], p[:, 2], -p[:, 1]]) for p in (np.array(s["Phi"]) for s in case["stations"])]
        places = [s["b"] for s in case["stations"]] + case["beacons"]
        axes += [np.eye(3)] * len(case["beacons"])
        sigma = np.broadcast_to(case["sigma"], len(case["y"]))
        position, cov, _ = trajectory.locate(
            places, SETS[case["set"]], case["y"], sigma, prior_m=tuple(case["prior_r"]), axes=axes
        )
        wanted, K = np.array(case["lsq"]["r"]), np.array(case["lsq"]["K"])
        assert np.linalg.norm(position - wanted) < 1e-9 * np.linalg.norm(wanted) + 1e-6 * np.sqrt(np.trace(K)), case["id"]
        assert np.abs(cov - K).max() < 1e-7 * np.abs(K).max(), case["id"]
        checked += 1
    assert checked >= 15


def test_many_positions_at_once():
    stations = np.array([[6.4e6, 0, 0], [6.4e6, 1e4, 0], [6.4e6, 0, 1e4], [6.39e6, 5e3, 5e3]])
    places = np.array([6.45e6, 3e3, 2e3]) + np.random.default_rng(1).normal(scale=1e3, size=(100, 3))
    ranges = np.linalg.norm(places[:, None] - stations, axis=2)
    kinds = [(station, "range", None) for station in range(4)]
    position, cov, cost = trajectory.locate(stations, kinds, ranges, np.ones(4))
    assert np.abs(position - places).max() < 1e-5 and cov.shape == (100, 3, 3) and cost.max() < 1e-6
    with pytest.raises(ValueError, match="expected 4 numbers, one for each"):
        trajectory.locate(stations, kinds, ranges[:, :3], np.ones(4))


def test_axes_of_stations_are_rotations_for_each():
    stations = np.array([[6.4e6, 0, 0], [6.4e6, 1e4, 0], [6.4e6, 0, 1e4]])
    kinds = [(station, "range", None) for station in range(3)]
    place = np.array([6.45e6, 3e3, 2e3])
    ranges = np.linalg.norm(place - stations, axis=1)

    def located(axes, **others):
        return trajectory.locate(stations, kinds, ranges, np.ones(3), prior_m=tuple(place), axes=axes, **others)

    assert np.allclose(located([np.eye(3)] * 3)[0], place, atol=1e-3)
    for count in (0, 1, 2, 5):
        with pytest.raises(ValueError, match=rf"axes has the shape \[{count}, 3, 3\], expected \(3, 3, 3\)"):
            located(np.zeros((count, 3, 3)) + np.eye(3))
    with pytest.raises(ValueError, match=r"axes has the shape \[3, 3\], expected \(3, 3, 3\)"):
        located(np.eye(3))
    for wrong in (2 * np.eye(3), np.diag([1.0, 1, -1]), np.zeros((3, 3)), np.full((3, 3), np.nan)):
        with pytest.raises(ValueError, match="axes 1 is no rotation"):
            located([np.eye(3), wrong, np.eye(3)])


def test_measurements_that_cannot_be_are_refused():
    stations = np.array([[6.4e6, 0, 0], [6.4e6, 1e4, 0], [6.4e6, 0, 1e4]])
    kinds = [(station, "range", None) for station in range(3)]
    for values in (np.full(3, 1e5), np.full((2, 3), 1e5)):
        with pytest.raises(ValueError, match="kinds has station 7, expected below 3"):
            trajectory.locate(stations, [*kinds[:2], (7, "range", None)], values, np.ones(3))
        for sigma in (0, -1, np.nan):
            with pytest.raises(ValueError, match=r"sigmas\[1\] is .*, expected a number above zero"):
                trajectory.locate(stations, kinds, values, [1, sigma, 1])
        with pytest.raises(ValueError, match="prior_m is .*, expected finite numbers"):
            trajectory.locate(stations, kinds, values, np.ones(3), prior_m=(np.nan, 0, 0))


def test_calibration_finds_what_was_put_in():
    random = np.random.default_rng(5)
    model = np.array([[1.01, 0.002, -0.001], [0, 0.98, 0.003], [0, 0, 1.005]])
    bias = np.array([0.1, -0.2, 0.05])
    directions = random.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    poses = 9.81 * directions @ model.T + bias
    found = calibration.multi_pose(poses, 9.81)
    assert np.allclose(found["matrix"], model, atol=1e-6) and np.allclose(found["bias_mps2"], bias, atol=1e-6)
    six = 9.81 * np.vstack([np.eye(3), -np.eye(3)]) @ model.T + bias
    assert np.allclose(calibration.six_position(six, 9.81)["matrix"], model, atol=1e-9)
    rates = random.normal(0.01, 0.001, size=(10_000, 3))
    mean, sd = calibration.gyro_bias(rates)
    assert np.allclose(mean, rates.mean(axis=0)) and np.allclose(sd, rates.std(axis=0, ddof=1) / 100)
    tau, deviation, _ = calibration.allan_deviation(rates[:, 0], 0.01)
    assert tau[0] == 0.01 and deviation[0] == pytest.approx(np.sqrt(np.mean(np.diff(rates[:, 0]) ** 2) / 2), rel=1e-9)


def test_calibration_of_nothing_is_refused():
    six = 9.81 * np.vstack([np.eye(3), -np.eye(3)])
    for wrong in ({"samples": 0}, {"sample_sd_mps2": -1}, {"sample_sd_mps2": np.nan}):
        for calibrate in (calibration.six_position, calibration.multi_pose):
            with pytest.raises(kurs.NoSolution, match="pose 1 has .*at least one sample and a noise of 0 or more"):
                calibrate(six, 9.81, **wrong)
    with pytest.raises(kurs.NoSolution, match="levelled to 400°, 0 to 28 expected"):
        calibration.six_position(six, 9.81, levelling_deg=400)
    rest = np.full((1000, 3), 9.81)
    for step_s in (0, -1, np.nan):
        with pytest.raises(ValueError, match="step_s is .*, expected a number above zero"):
            calibration.rests(rest, step_s)
        with pytest.raises(ValueError, match="step_s is .*, expected a number above zero"):
            calibration.allan_deviation(rest[:, 0], step_s)
    with pytest.raises(ValueError, match=r"samples has the shape \[1000, 3\], expected 1 dimensions"):
        calibration.allan_deviation(rest, 0.01)
    with pytest.raises(ValueError, match=r"samples_radps has the shape \[1, 1000, 3\], expected 2 dimensions"):
        calibration.gyro_bias(rest[None])
