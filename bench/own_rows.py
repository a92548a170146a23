#!/usr/bin/env python3
"""How well the covariances of a body's own rows fit their errors, by seeds: bench/own_rows.py [--seeds 20]

Two bodies at rest under one sky, three antennas each, those of the test `two_bodies_see_each_other_as_they_are`, solved by
`kurs solve` on one band and on two. Needs `cargo build --release` (or KURS=path of the program) and numpy.
"""

import argparse
import csv
import os
import pathlib
import statistics
import subprocess
import tempfile

from relative_rows import ANGLES, Score

ROOT = pathlib.Path(__file__).resolve().parent.parent
KURS = os.environ.get("KURS", str(ROOT / "target/release/kurs"))
BANDS = {"G1C, E1C": ["G1C", "E1C"], "G1C, G2L, E1C, E5Q": ["G1C", "G2L", "E1C", "E5Q"]}
#: Heading, pitch, roll, degrees.
BODIES = {"tractor": [350.0, 2.0, -1.0], "implement": [20.0, -3.0, 4.0]}
CONFIGURATIONS = dict(zip(BODIES, ("kurs.toml", "kurs-implement.toml")))
PLACES_M = [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [0.0, 1.0, 0.0]]


def scenario(seed, signals):
    text = f'seed = {seed}\nstart = "2024-03-10T12:00:00"\nduration_s = 24.0\ninterval_s = 0.2\nsignals = {signals}\n'
    text += '[sky]\nsystems = ["G", "E"]\n'
    for number, (body, angles_deg) in enumerate(BODIES.items()):
        heading, pitch, roll = angles_deg
        place = f"{{ latitude_deg = {51.6 + 5e-5 * number}, longitude_deg = 46.0, height_m = 60.0 }}"
        text += f'[[body]]\nname = "{body}"\n'
        text += f'motion = {{ kind = "static", place = {place}, heading_deg = {heading}, pitch_deg = {pitch}, roll_deg = {roll} }}\n'
        for antenna, position_m in enumerate(PLACES_M):
            text += f'[[body.antenna]]\nname = "{body}{antenna}"\nposition_m = {position_m}\n'
    return text


def nees(folder, body):
    """Mean normalised square of heading, pitch and roll together of the fixed rows: 3 is right."""
    out = folder / f"solved-{body}"
    subprocess.run([KURS, "solve", folder / CONFIGURATIONS[body], "--quiet", "--out", out], check=True)
    score = Score()
    with open(out / "attitude.csv") as lines:
        for row in csv.DictReader(lines):
            if row["status"] == "fixed":
                score.add(row, BODIES[body])
    return len(ANGLES) * score.nees


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    seeds = range(1, parser.parse_args().seeds + 1)
    print("| bands | body | NEES of 3, standard error |\n|---|---|---|")
    for bands, signals in BANDS.items():
        found = {body: [] for body in BODIES}
        for seed in seeds:
            with tempfile.TemporaryDirectory() as name:
                folder = pathlib.Path(name)
                (folder / "scenario.toml").write_text(scenario(seed, signals))
                subprocess.run([KURS, "simulate", folder / "scenario.toml", "--out", folder, "--quiet"], check=True)
                for body in BODIES:
                    found[body].append(nees(folder, body))
        for body, values in found.items():
            error = statistics.stdev(values) / len(values) ** 0.5
            print(f"| {bands} | {body} | {statistics.mean(values):.2f} ± {error:.2f} |")


if __name__ == "__main__":
    main()
