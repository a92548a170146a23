#!/usr/bin/env python3
"""Right and wrong fixes under obstructed skies, on the shared recordings, as one table.

    bench/real_skies.py [--kurs PROGRAM] [--data FOLDER] [--only WORD] [--modes MODE,...] [--reasons] [--json]

A fix is wrong if a component is off by more than max(5 cm, 5 standard deviations), 6 cm under the canopy
(whose points are known to 1 cm), or by more than 15 cm whatever its standard deviation. `z2` is the mean
normalised square of a component, `>3 sd` the share of the fixes with a component beyond three of its
standard deviations, `sd east` the median standard deviation of the east component of the fixes.
"""

import argparse
import csv
import glob
import json
import os
import statistics
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

CANOPY = (-51.195, -35.935, -35.036)
SHADOW = (72.4228, -204.3063, -4.9550)
UPC = (-27.4088, -26.2188, -0.0403)
MATRTKLIB = (-0.2235, -0.9645, 0.009)
GEONET = (953.6729, -3196.1390, 4.6514)
ALL_BEIDOU = "C1,C2,C5,C6,C7"
# Approximate time of the logs of the valley, which have no date.
SHADOW_TIME = ("2026/06/26", "16:00:00")
LENGTHS = {CANOPY: 71.69, SHADOW: 216.82, UPC: 37.93, MATRTKLIB: 0.99, GEONET: 3335.39}

# Modes: a word for the name of the row, keys of [solve].
MODES = {
    "instantaneous": ("", {}),
    "continuous": (", continuous", {"ambiguity": "continuous"}),
    "both": (", continuous, both directions", {"ambiguity": "continuous", "direction": "both"}),
}
# name, recording, bands ("" for all), constraint, keys of [solve]
RECORDINGS = [
    ("canopy all bands, length", "canopy", "", "length", {}),
    ("canopy all bands, none", "canopy", "", "none", {}),
    ("canopy L1, length, 15 deg", "canopy", "G1", "length", {"elevation_mask_deg": 15}),
    ("shadow five bands, none, 15 deg", "shadow", ALL_BEIDOU, "none", {"elevation_mask_deg": 15}),
    ("shadow C2+C6, none, 15 deg", "shadow", "C2,C6", "none", {"elevation_mask_deg": 15}),
    ("shadow C2, length, 15 deg", "shadow", "C2", "length", {"elevation_mask_deg": 15}),
    ("upc2011 G1, length", "upc2011", "G1", "length", {}),
    ("upc2011 G1, none", "upc2011", "G1", "none", {}),
    ("upc2011 G1+G2, none, 15 deg", "upc2011", "G1,G2", "none", {"elevation_mask_deg": 15}),
    ("matrtklib G1, length, 15 deg", "matrtklib", "G1", "length", {"elevation_mask_deg": 15}),
    ("matrtklib G1, none, 15 deg", "matrtklib", "G1", "none", {"elevation_mask_deg": 15}),
    ("matrtklib six bands, none, 15 deg", "matrtklib", "G1,G2,E1,E5,C2,C7", "none",
     {"elevation_mask_deg": 15}),
    ("geonet2005 G1, none, 15 deg", "geonet2005", "G1", "none", {"elevation_mask_deg": 15}),
    ("geonet2005 G1+G2, none, 15 deg", "geonet2005", "G1,G2", "none", {"elevation_mask_deg": 15}),
]
# A length told wrong by so many metres: no row may be fixed wrongly.
WRONG_LENGTHS = []
for name, recording, bands in [("upc2011 G1", "upc2011", "G1"), ("upc2011 G1+G2", "upc2011", "G1,G2"),
                               ("matrtklib G1", "matrtklib", "G1"),
                               ("matrtklib G1+E1+C2", "matrtklib", "G1,E1,C2"),
                               ("canopy all bands", "canopy", ""), ("canopy L1", "canopy", "G1")]:
    for off_m in (-0.19, -0.05, 0.05, 0.19):
        WRONG_LENGTHS.append((f"{name}, length {off_m:+.2f} m", recording, bands, "length", {"off_m": off_m}))


def rows(modes):
    """Every recording in each mode."""
    for name, recording, bands, constraint, keys in RECORDINGS + WRONG_LENGTHS:
        for word, keys_of_mode in (MODES[mode] for mode in modes):
            yield name + word, recording, bands, constraint, keys | keys_of_mode


def files(recording, data):
    """Base files, rover files, navigation files, vector from base to rover (east, north, up, m)."""
    if recording == "canopy":
        folder = f"{data}/canopy2025"
        hours = lambda who: sorted(glob.glob(f"{folder}/{who}_*.obs.gz"))
        return hours("MOZR"), hours("MOZA"), glob.glob(f"{folder}/brdc*"), CANOPY
    if recording == "shadow":
        folder = f"{data}/shadow2026"
        return [f"{folder}/base_all.rtcm3.gz"], [f"{folder}/rover_all.rtcm3.gz"], [], SHADOW
    if recording == "upc2011":
        folder = f"{data}/upc2011"
        return [f"{folder}/UPC10770.11o"], [f"{folder}/UPC20770.11o"], [f"{folder}/brdc0770.11n"], UPC
    if recording == "geonet2005":
        folder = f"{data}/geonet2005"
        return [f"{folder}/07590920.05o"], [f"{folder}/30400920.05o"], [f"{folder}/30400920.05n"], GEONET
    folder = f"{data}/matrtklib_static"
    return [f"{folder}/base.obs"], [f"{folder}/rover.obs"], [f"{folder}/base.nav"], MATRTKLIB


def configuration(row, data):
    """The configuration of a row as TOML, and the true vector."""
    _, recording, bands, constraint, keys = row
    keys = dict(keys)
    bases, rovers, navigation, truth = files(recording, os.path.abspath(data))
    told_wrong = "off_m" in keys
    length_m = LENGTHS[truth] + keys.pop("off_m", 0.0)
    text = ""
    for antenna, observations, x in (("base", bases, 0.0), ("rover", rovers, length_m)):
        text += f'[[antenna]]\nname = "{antenna}"\nobs = {json.dumps(observations)}\n'
        if constraint != "none":
            text += f"position_m = [{x}, 0.0, 0.0]\n"
    if navigation:
        text += f"[nav]\nfiles = {json.dumps(navigation)}\n"
    keys = {"ambiguity": "instantaneous", "constraint": constraint, "max_tilt_deg": 180} | keys
    if constraint != "none" and not told_wrong:
        keys["array_sd_m"] = 0.01
    if bands:
        keys["bands"] = bands.split(",")
    return text + "[solve]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in keys.items()), truth


def run(kurs, text, folder):
    """Rows of attitude.csv and baselines.csv that `kurs solve` makes of a configuration."""
    path = f"{folder}/kurs.toml"
    with open(path, "w") as file:
        file.write(text)
    done = subprocess.run([kurs, "solve", "--quiet", path, "--out", f"{folder}/out"], capture_output=True, text=True)
    if not os.path.exists(f"{folder}/out/attitude.csv"):
        raise RuntimeError(done.stderr.strip()[:200])
    return table(f"{folder}/out/attitude.csv"), table(f"{folder}/out/baselines.csv")


def table(path):
    with open(path) as file:
        return list(csv.DictReader(file))


def floor_m(recording):
    """Errors below are no mistakes: the places are known no better."""
    return 0.06 if recording == "canopy" else 0.05


def error(fix, truth):
    """Errors of a baseline's components and their standard deviations, m."""
    off = [float(fix[f"{c}_m"]) - t for c, t in zip(("east", "north", "up"), truth)]
    return off, [float(fix[f"sd_{c}_m"]) for c in ("east", "north", "up")]


def is_wrong(off, sd, floor):
    return max(map(abs, off)) > 0.15 or any(abs(o) > max(floor, 5 * s) for o, s in zip(off, sd))


def solve(row, arguments, folder):
    name, recording = row[:2]
    text, truth = configuration(row, arguments.data)
    try:
        rows, baselines = run(arguments.kurs, text, folder)
    except RuntimeError as problem:
        return {"name": name, "error": str(problem)}
    fixed = [r for r in baselines if r["status"] == "fixed"]
    wrong = beyond = 0
    squares, errors = [], []
    for r in fixed:
        off, sd = error(r, truth)
        if is_wrong(off, sd, floor_m(recording)):
            wrong += 1
            errors.append((r["time_gpst"], max(map(abs, off))))
        else:
            squares += [(o / s) ** 2 for o, s in zip(off, sd)]
        beyond += any(abs(o) > 3 * s for o, s in zip(off, sd))
    reasons = {}
    for r in rows:
        key = r["status"] + ("," + r["reason"] if r["reason"] else "")
        reasons[key] = reasons.get(key, 0) + 1
    return {"name": name, "rows": len(rows), "fixed": len(fixed), "wrong": wrong, "beyond": beyond,
            "z2": statistics.mean(squares) if squares else float("nan"),
            "sd_east_mm": 1e3 * statistics.median(float(r["sd_east_m"]) for r in fixed) if fixed else float("nan"),
            "reasons": dict(sorted(reasons.items(), key=lambda kv: -kv[1])), "errors": errors}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kurs", default="target/release/kurs")
    parser.add_argument("--data", default=os.environ.get("KURS_DATA", "../shared/data"))
    parser.add_argument("--only", default="", help="rows whose name contains this")
    parser.add_argument("--modes", default="instantaneous,continuous", help=f"of {', '.join(MODES)}")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--reasons", action="store_true")
    arguments = parser.parse_args()
    chosen = [row for row in rows(arguments.modes.split(",")) if arguments.only in row[0]]
    if not os.path.isdir(arguments.data):
        print(f"skipped: no recordings in {arguments.data}")
        return
    with tempfile.TemporaryDirectory() as work:
        def one(i):
            folder = f"{work}/{i}"
            os.mkdir(folder)
            return solve(chosen[i], arguments, folder)
        with ThreadPoolExecutor(arguments.jobs) as pool:
            results = pool.map(one, range(len(chosen)))
            print("| recording | rows | fixed | wrong | wrong of fixed | >3 sd | z2 | sd east, mm |")
            print("|---|---|---|---|---|---|---|---|")
            for r in results:
                if arguments.json:
                    print(json.dumps(r), file=sys.stderr)
                if "error" in r:
                    print(f"| {r['name']} | {r['error']} |")
                    continue
                fixed = max(r["fixed"], 1)
                print(f"| {r['name']} | {r['rows']} | {100 * r['fixed'] / r['rows']:.1f} % | {r['wrong']} "
                      f"| {100 * r['wrong'] / fixed:.2f} % | {100 * r['beyond'] / fixed:.1f} % "
                      f"| {r['z2']:.2f} | {r['sd_east_mm']:.1f} |", flush=True)
                if arguments.reasons:
                    print("   ", r["reasons"], r["errors"][:5], flush=True)


if __name__ == "__main__":
    main()
