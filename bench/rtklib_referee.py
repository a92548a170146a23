"""Lays the baselines of rnx2rtkp against truth.csv: every epoch fixed, none off by more than noise."""

import csv
import sys

LIMIT_M = 0.05  # a wrong integer moves a baseline by more, noise never

scenario, folder = sys.argv[1:]
with open(f"{folder}/truth.csv", newline="") as file:
    truth = {round(float(row["tow_s"]), 2): row for row in csv.DictReader(file)}

epochs = fixed = wrong = 0
squares = [0.0, 0.0, 0.0]
with open(f"{folder}/rtklib.pos") as file:
    for line in file:
        if line.startswith("%") or not line.strip():
            continue
        fields = line.split()
        tow_s, enu_m, quality = float(fields[1]), [float(x) for x in fields[2:5]], int(fields[5])
        row = truth.get(round(tow_s, 2))
        if row is None:
            continue
        epochs += 1
        if quality != 1:
            continue
        fixed += 1
        errors = [found - float(row[f"A1_{axis}_m"]) for found, axis in zip(enu_m, ("east", "north", "up"))]
        wrong += max(abs(error) for error in errors) > LIMIT_M
        squares = [s + e * e for s, e in zip(squares, errors)]

rms = [f"{1e3 * (s / max(fixed, 1)) ** 0.5:.1f}" for s in squares]
print(f"{scenario}: {epochs} of {len(truth)} epochs, {fixed} fixed, {wrong} wrong, RMS east north up {' '.join(rms)} mm")
sys.exit(0 if epochs and fixed == epochs and wrong == 0 else 1)
