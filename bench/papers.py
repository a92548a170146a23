"""Figures for the pages on the papers that need the Python module: bench/papers.py [baselines] [three_points].

baselines: attitude on simulated observations from the baselines that a criterion selects, against all antennas (paper 002).
three_points: noise of the three-point formulas against Wahba's problem, by triangle (paper 004).
"""

import sys
import tempfile
from pathlib import Path

import kurs
import numpy as np
from scipy.spatial.transform import Rotation

CRITERIA = ("baseline_condition", "information_condition", "smallest_information", "trace_of_covariance")


def baselines(arrays=20, epochs=120):
    """Five antennas at random in a cube of a metre: total RMS of the rotation from selected trees, relative to all antennas.

    What is selected is processed as the paper does, baseline by baseline with the weight of its own; `solve` has the full covariance.
    """
    random = np.random.default_rng(2)
    squares = {name: [] for name in ("all antennas", "star of the first antenna", *CRITERIA)}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(arrays):
            body = random.uniform(-0.5, 0.5, (5, 3))
            made = kurs.simulate(scenario(body, number, epochs), Path(folder) / f"{number}")
            solution = kurs.solve(made, out=Path(folder) / f"{number}/solved")
            truth = kurs._table.Table.read_csv(Path(folder) / f"{number}/truth.csv")
            turn = Rotation.from_euler("ZYX", np.column_stack([truth[f"{a}_deg"] for a in ("heading", "pitch", "roll")]), degrees=True)
            fixed = solution.attitude["status"] == "fixed"
            found = np.column_stack([solution.attitude[name] for name in ("qx", "qy", "qz", "qw")])[fixed]
            squares["all antennas"].append(square(Rotation.from_quat(found), turn[fixed]))
            places = antennas(solution.baselines, solution.attitude["time_gpst"][fixed])
            trees = {"star of the first antenna": [(0, k) for k in range(1, 5)]}
            for criterion in CRITERIA:
                trees[criterion] = kurs.selection.select(body, criterion=criterion)[0]
            for name, pairs in trees.items():
                local = np.stack([places[:, b] - places[:, a] for a, b in pairs], axis=1)
                known = np.array([body[b] - body[a] for a, b in pairs])
                weighted = kurs.attitude.weighted(known, local, VARIANCE, shared_antenna=False)
                squares[name].append(square(Rotation.from_matrix(weighted.matrix), turn[fixed]))
    whole = np.sqrt(squares["all antennas"])
    print(f"{arrays} arrays of five antennas, {epochs} epochs each; all antennas: {np.degrees(np.sqrt(np.mean(whole**2))):.3f}° in total\n")
    print("| baselines | error relative to all antennas, mean over the arrays |\n|---|---|")
    for name, found in squares.items():
        ratio = np.sqrt(found) / whole
        print(f"| {name} | {ratio.mean():.3f} ± {1.96 * ratio.std(ddof=1) / np.sqrt(arrays):.3f} |")


#: Baselines north, east, down: heights are twice as uncertain.
VARIANCE = np.diag([1.0, 1.0, 4.0]) * 4e-6


def scenario(body, seed, epochs):
    return {
        "seed": seed + 1,
        "start": "2024-03-10T12:00:00",
        "duration_s": float(epochs - 1) * 30,
        "interval_s": 30.0,
        "signals": ["G1C", "E1C", "G2W", "E5Q"],
        "sky": {"systems": ["G", "E"]},
        "noise": {"law": "mixed", "cn0_zenith_dbhz": 60.0},
        "body": [{
            "name": "cube",
            "motion": {
                "kind": "static",
                "place": {"latitude_deg": 55.75, "longitude_deg": 37.62, "height_m": 200.0},
                "heading_deg": 35.0, "pitch_deg": 2.0, "roll_deg": -3.0,
            },
            "antenna": [{"name": f"A{k}", "position_m": place.tolist()} for k, place in enumerate(body - body[0])],
        }],
    }


def antennas(table, times):
    """Places of all antennas at these times from the first one, north, east, down, (n, 5, 3)."""
    places = np.zeros((len(times), 5, 3))
    for k in range(1, 5):
        of = (table["base"] == "A0") & (table["rover"] == f"A{k}") & np.isin(table["time_gpst"], times)
        places[:, k] = np.column_stack([table["north_m"][of], table["east_m"][of], -table["up_m"][of]])
    return places


def square(found, truth):
    """Mean square of the rotation vector between them, rad²."""
    return float(np.mean(np.sum((found * truth.inv()).as_rotvec() ** 2, axis=1)))


def three_points(draws=20_000):
    """Triangles with a longest side of a metre, 5 mm of noise on every coordinate: total RMS, degrees."""
    random = np.random.default_rng(4)
    print("| angles | three-point formulas | Wahba's problem | without a solution |\n|---|---|---|---|")
    for angles in ((60, 60, 60), (80, 50, 50), (85, 50, 45), (89, 46, 45), (90, 45, 45), (120, 30, 30)):
        a, b, c = np.sin(np.radians(angles)) / np.sin(np.radians(max(angles)))
        x = (b**2 + c**2 - a**2) / (2 * c)
        body = np.array([[0, 0, 0], [c, 0, 0], [x, np.sqrt(b**2 - x**2), 0]])
        turn = Rotation.random(draws, random)
        local = np.einsum("nij,kj->nki", turn.as_matrix(), body) + random.normal(scale=0.005, size=(draws, 3, 3))
        published = kurs.attitude.three_point(body, local)
        center = body.mean(axis=0)
        wahba = kurs.attitude.wahba(body - center, local - local.mean(axis=1, keepdims=True))
        best = np.degrees(np.sqrt(square(Rotation.from_matrix(wahba.matrix), turn)))
        solved = ~np.isnan(published.matrix).any(axis=(1, 2))
        total = "–"
        if solved.any():
            total = f"{np.degrees(np.sqrt(square(Rotation.from_matrix(published.matrix[solved]), turn[solved]))):.2f}°"
        print(f"| {angles} | {total} | {best:.3f}° | {100 * (1 - solved.mean()):.1f} % |")


if __name__ == "__main__":
    for figure in (baselines, three_points):
        if len(sys.argv) < 2 or figure.__name__ in sys.argv[1:]:
            figure()
