#!/usr/bin/env python3
"""What Kurs claims of its integers against what is true, on recordings and in simulated skies; RTKLIB beside it.

    bench/reliability.py [--kurs PROGRAM] [--data FOLDER] [--only WORD,...] [--sessions N] [--jobs N] [--write FILE]

A row is fixed at `max_wrong_fix_rate` = r if all other integers together have a probability of at most r times that of
the best. So a row that is fixed at one rate and not at the next smaller one claims a probability of being wrong
between the two. The same observations are solved at each of RATES; of the rows between two rates the share that is wrong is laid beside the
claim, by the strength of the model (the predicted success rate of the integers). Where the claims are honest the share
lies between the two rates. Below the smallest rate the claim is only bounded from above.

Wrong, on recordings and simulated alike: a component is off by more than max(5 cm, 5 standard deviations), 6 cm under the
canopy, or by more than 15 cm. RTKLIB (rnx2rtkp, Debian's package rtklib): moving base, ratio 3, 15 degrees, each
epoch alone, no length, on the same files. With --write the tables take the place of those between the marks in FILE.
"""

import argparse
import gzip
import math
import os
import re
import shutil
import statistics
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor

import real_skies

RATES = [0.5, 0.1, 0.01, 1e-3, 1e-4, 1e-5]
DEFAULT_RATE = 1e-3
STRENGTHS = [("below 0.9", 0.0), ("0.9 to 0.999", 0.9), ("above 0.999", 0.999)]
SCENARIOS = ["edge", "canopy", "street", "few-satellites"]
MODES = ["instantaneous", "continuous"]
# recording, configuration of rnx2rtkp, in words
RTKLIB = [("canopy", "mb_instantaneous_L1_G", "G, L1"), ("canopy", "mb_instantaneous_L1L2_GEC", "G E C, two bands"),
          ("shadow", "mb_instantaneous_L1L2_GEC", "C, two bands"),
          ("upc2011", "mb_instantaneous_L1_G", "G, L1"), ("upc2011", "mb_instantaneous_L1L2_G", "G, two bands"),
          ("matrtklib", "mb_instantaneous_L1_G", "G, L1"), ("matrtklib", "mb_instantaneous_L1L2_GEC", "G E C, two bands"),
          ("geonet2005", "mb_instantaneous_L1_G", "G, L1"), ("geonet2005", "mb_instantaneous_L1L2_G", "G, two bands")]
MARKS = ("<!-- made by bench/reliability.py -->", "<!-- end of what bench/reliability.py made -->")


class Session:
    """Observations with a truth: a recording in one set of bands, or a simulated session."""

    def __init__(self, group, name, text, truth, floor):
        self.group, self.name, self.text, self.truth, self.floor = group, name, text, truth, floor

    def at_rate(self, kurs, mode, rate, folder):
        """Time of every fixed row: its success rate, whether it is wrong, errors over standard deviations."""
        text = re.sub(r"ambiguity = .*\n", "", self.text) + f'ambiguity = "{mode}"\nmax_wrong_fix_rate = {rate}\n'
        rows, baselines = real_skies.run(kurs, text, folder)
        strength = {time(r): float(r["success_rate"] or 0) for r in rows}
        fixed = {}
        for r in baselines:
            if r["status"] == "fixed":
                off, sd = real_skies.error(r, self.truth(time(r)))
                wrong = real_skies.is_wrong(off, sd, self.floor)
                fixed[time(r)] = (strength[time(r)], wrong, [o / s for o, s in zip(off, sd)])
        return len(rows), fixed


def time(row):
    return int(row["gps_week"]), round(float(row["tow_s"]), 2)


def wanted(name, only):
    return any(word in name for word in only.split(","))


def recorded(data, only):
    for row in real_skies.RECORDINGS:
        if wanted(row[0], only):
            text, truth = real_skies.configuration(row, data)
            yield Session("recordings", row[0], text, lambda _, t=truth: t, real_skies.floor_m(row[1]))


def simulated(kurs, only, sessions, work):
    for name in (name for name in SCENARIOS if wanted(name, only)):
        scenario = open(f"scenarios/{name}.toml").read()
        for k in range(sessions):
            folder = f"{work}/{name}-{k}"
            os.mkdir(folder)
            text = re.sub(r"^seed = (\d+)", lambda m: f"seed = {int(m[1]) + 1000 * k}", scenario, count=1, flags=re.M)
            text = re.sub(r'^start = .*', f'start = "2024-03-10T{(12 + 5 * k) % 24:02}:00:00"', text, flags=re.M)
            open(f"{folder}/scenario.toml", "w").write(text)
            subprocess.run([kurs, "simulate", f"{folder}/scenario.toml", "--quiet", "--out", folder], check=True)
            truth = {time(row): [float(row[f"A1_{c}_m"]) for c in ("east", "north", "up")]
                     for row in real_skies.table(f"{folder}/truth.csv")}
            text = open(f"{folder}/kurs.toml").read()
            text = re.sub(r'"([^"]*\.(rnx|crx|ubx|sbf|rtcm3)[^"]*)"', lambda m: f'"{folder}/{m[1]}"', text)
            if "[solve]" not in text:
                text += "\n[solve]\n"
            yield Session("scenarios", name, text, truth.__getitem__, 0.05)


def interval(count, of):
    """Share in per cent with the interval of 95 % (Wilson)."""
    p, z = count / of, 1.96
    middle, half = p + z * z / (2 * of), z * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    low, high = ((middle + sign * half) / (1 + z * z / of) for sign in (-1, 1))
    low = low if count else 0.0
    return f"{100 * p:.2g} % ({100 * low:.2g} to {100 * high:.2g})"


def diagram(group, runs):
    """Rows of the reliability diagram: claims against shares, by strength."""
    counts = {}
    for at_rate in runs:
        for k, rate in enumerate(RATES):
            surer = at_rate[RATES[k + 1]][1] if k + 1 < len(RATES) else {}
            for instant, (strength, wrong, _) in at_rate[rate][1].items():
                if instant not in surer:
                    word = max((s for s in STRENGTHS if strength >= s[1]), key=lambda s: s[1])[0]
                    cell = counts.setdefault((word, k), [0, 0])
                    cell[0] += 1
                    cell[1] += wrong
    for word, _ in STRENGTHS:
        for k, rate in enumerate(RATES):
            of, wrong = counts.get((word, k), (0, 0))
            if of:
                claim = f"{RATES[k + 1]:g} to {rate:g}" if k + 1 < len(RATES) else f"below {rate:g}"
                yield f"| {group} | {word} | {claim} | {of} | {wrong} | {interval(wrong, of)} |"


def rtklib(recording, conf, data, work):
    """Epochs, fixed and wrong ones of rnx2rtkp; None where a tool is missing."""
    bases, rovers, navigation, truth = real_skies.files(recording, os.path.abspath(data))
    plain = lambda path: path if not path.endswith(".gz") else unpacked(path, work)
    if recording == "shadow":
        bases, rovers, navigation = converted(bases[0], rovers[0], work)
    epochs = fixed = wrong = 0
    for base, rover in zip(bases, rovers):
        out = f"{work}/out.pos"
        subprocess.run(["rnx2rtkp", "-k", f"{data}/rtklib_conf/{conf}.conf", "-o", out, plain(rover), plain(base)]
                       + [plain(path) for path in navigation], capture_output=True)
        for line in open(out):
            field = line.split()
            if line.startswith("%") or len(field) < 10:
                continue
            epochs += 1
            if field[5] == "1":
                off = [float(v) - t for v, t in zip(field[2:5], truth)]
                fixed += 1
                wrong += real_skies.is_wrong(off, [float(v) for v in field[7:10]], real_skies.floor_m(recording))
    return epochs, fixed, wrong


def unpacked(path, work):
    target = f"{work}/{os.path.basename(path)[:-3]}"
    if not os.path.exists(target):
        with gzip.open(path) as packed, open(target, "wb") as file:
            shutil.copyfileobj(packed, file)
    return target


def converted(base, rover, work):
    """The logs of the valley as RINEX, by RTKLIB's convbin."""
    made = []
    for who, path in (("base", base), ("rover", rover)):
        observations, navigation = f"{work}/{who}.obs", f"{work}/{who}.nav"
        if not os.path.exists(observations):
            subprocess.run(["convbin", "-r", "rtcm3", "-v", "3.04", "-o", observations, "-n", navigation,
                            "-tr", *real_skies.SHADOW_TIME, unpacked(path, work)], capture_output=True)
        made.append((observations, navigation))
    return [made[0][0]], [made[1][0]], [made[0][1]]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kurs", default="target/release/kurs")
    parser.add_argument("--data", default=os.environ.get("KURS_DATA", "../shared/data"))
    parser.add_argument("--only", default="", help="recordings and scenarios whose name contains one of these words, with commas")
    parser.add_argument("--sessions", type=int, default=8, help="simulated sessions of each scenario")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--write", metavar="FILE", help="docs/experiments/real-skies.md")
    arguments = parser.parse_args()
    if not os.path.isdir(arguments.data):
        print(f"skipped: no recordings in {arguments.data}")
        return
    with tempfile.TemporaryDirectory() as work:
        text = "\n".join(tables(arguments, work))
    print(text)
    if arguments.write:
        page = open(arguments.write).read()
        before, rest = page.split(MARKS[0])
        after = rest.split(MARKS[1])[1]
        open(arguments.write, "w").write(f"{before}{MARKS[0]}\n\n{text}\n\n{MARKS[1]}{after}")


def tables(arguments, work):
    sessions = list(recorded(arguments.data, arguments.only))
    sessions += simulated(arguments.kurs, arguments.only, arguments.sessions, work)
    jobs = [(k, mode, rate) for k in range(len(sessions)) for mode in MODES for rate in RATES]

    def one(job):
        k, mode, rate = job
        folder = tempfile.mkdtemp(dir=work)
        result = sessions[k].at_rate(arguments.kurs, mode, rate, folder)
        shutil.rmtree(folder)
        return result

    with ThreadPoolExecutor(arguments.jobs) as pool:
        results = dict(zip(jobs, pool.map(one, jobs)))
    yield "| skies | predicted success | claimed share wrong | fixed rows | wrong | share wrong (95 %) |"
    yield "|---|---|---|---|---|---|"
    for mode in MODES:
        for group in ("recordings", "scenarios"):
            chosen = [k for k, session in enumerate(sessions) if session.group == group]
            runs = [{rate: results[k, mode, rate] for rate in RATES} for k in chosen]
            yield from diagram(f"{group}, {mode}", runs)
    yield "\nAt the default rate:\n"
    yield "| sky | mode | rows | fixed | wrong | beyond 3 sd | mean (error / sd)² |"
    yield "|---|---|---|---|---|---|---|"
    for name in dict.fromkeys(session.name for session in sessions):
        for mode in MODES:
            of_name = [results[k, mode, DEFAULT_RATE] for k, s in enumerate(sessions) if s.name == name]
            rows, fixed = sum(n for n, _ in of_name), [row for _, found in of_name for row in found.values()]
            units = [unit for _, wrong, unit in fixed if not wrong]
            beyond = sum(any(abs(u) > 3 for u in unit) for _, _, unit in fixed)
            squares = [u * u for unit in units for u in unit]
            z2 = f"{statistics.mean(squares):.2f}" if squares else "–"
            yield (f"| {name} | {mode} | {rows} | {100 * len(fixed) / max(rows, 1):.1f} % | {sum(f[1] for f in fixed)} "
                   f"| {100 * beyond / max(len(fixed), 1):.1f} % | {z2} |")
    if not shutil.which("rnx2rtkp") or not shutil.which("convbin"):
        yield "\nRTKLIB: skipped, no rnx2rtkp (Debian's package rtklib)"
        return
    yield "\nRTKLIB on the same files, each epoch alone, no length:\n"
    yield "| recording | signals | epochs with a solution | fixed | wrong | wrong of fixed |"
    yield "|---|---|---|---|---|---|"
    for recording, conf, words in (row for row in RTKLIB if wanted(row[0], arguments.only)):
        epochs, fixed, wrong = rtklib(recording, conf, arguments.data, work)
        yield (f"| {recording} | {words} | {epochs} | {100 * fixed / max(epochs, 1):.1f} % | {wrong} "
               f"| {100 * wrong / max(fixed, 1):.2f} % |")


if __name__ == "__main__":
    main()
