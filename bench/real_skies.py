#!/usr/bin/env python3
"""Right and wrong fixes under obstructed skies, on the shared recordings, as one table.

    bench/real_skies.py [--kurs PROGRAM] [--data FOLDER] [--only WORD] [--modes MODE,...] [--reasons] [--json]

What is wrong: judging.py. `z2` is the mean
normalised square of a component, `>3 sd` the share of the fixes with a component beyond three of its
standard deviations, `sd east` the median standard deviation of the east component of the fixes.
"""

import argparse
import json
import os
import statistics
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

import programs
import sessions
from judging import Score

ALL_BEIDOU = "C1,C2,C5,C6,C7"
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


def configuration(row, data):
    """The session of a row and its configuration as TOML."""
    _, recording, bands, constraint, keys = row
    keys = dict(keys)
    session = sessions.recording(recording, data)
    off_m = keys.pop("off_m", None)
    keys = {"ambiguity": "instantaneous", "constraint": constraint, "max_tilt_deg": 180} | keys
    if off_m:
        session.place_m = (session.place_m[0] + off_m, 0.0, 0.0)
    elif constraint != "none":
        keys["array_sd_m"] = 0.01
    if bands:
        keys["bands"] = bands.split(",")
    return session, session.configuration(keys, with_places=constraint != "none")


def solve(row, arguments, folder):
    session, text = configuration(row, arguments.data)
    try:
        rows, baselines, _ = programs.solve(arguments.kurs, text, folder)
    except RuntimeError as problem:
        return {"name": row[0], "error": str(problem)}
    score, errors = Score(), []
    fixed = [r for r in baselines if r["status"] == "fixed"]
    for r in fixed:
        off_m, sd_m = session.errors(r)
        if score.add(off_m, sd_m, session.floor_m):
            errors.append((r["time_gpst"], max(map(abs, off_m))))
    reasons = {}
    for r in rows:
        key = r["status"] + ("," + r["reason"] if r["reason"] else "")
        reasons[key] = reasons.get(key, 0) + 1
    return {"name": row[0], "rows": len(rows), "fixed": score.fixed, "wrong": score.wrong, "beyond": score.beyond,
            "z2": score.mean_square,
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
                fixed = r["fixed"]
                of_fixed = (f"{100 * r['wrong'] / fixed:.2f} % | {100 * r['beyond'] / fixed:.1f} % | {r['z2']:.2f} "
                            f"| {r['sd_east_mm']:.1f}" if fixed else "– | – | – | –")
                print(f"| {r['name']} | {r['rows']} | {100 * fixed / r['rows']:.1f} % | {r['wrong']} | {of_fixed} |", flush=True)
                if arguments.reasons:
                    print("   ", r["reasons"], r["errors"][:5], flush=True)


if __name__ == "__main__":
    main()
