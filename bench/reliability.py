#!/usr/bin/env python3
"""What Kurs claims of its integers against what is true, on recordings and in simulated skies.

    bench/reliability.py [--kurs PROGRAM] [--data FOLDER] [--only WORD,...] [--sessions N] [--jobs N] [--write FILE]

A row is fixed at `max_wrong_fix_rate` = r if all other integers together have a probability of at most r times that of
the best. So a row that is fixed at one rate and not at the next smaller one claims a probability of being wrong
between the two. The same observations are solved at each of RATES; of the rows between two rates the share that is wrong is laid beside the
claim, by the strength of the model (the predicted success rate of the integers). Where the claims are honest the share
lies between the two rates. Below the smallest rate the claim is only bounded from above.

Wrong, on recordings and simulated alike: judging.py. RTKLIB beside it: bench/versus/run. With --write the tables take the place of those between the marks in FILE.
"""

import argparse
import math
import os
import re
import shutil
import statistics
import tempfile
from concurrent.futures import ThreadPoolExecutor

import pages
import programs
import real_skies
import sessions
from judging import is_beyond, is_wrong

RATES = [0.5, 0.1, 0.01, 1e-3, 1e-4, 1e-5]
DEFAULT_RATE = 1e-3
STRENGTHS = [("below 0.9", 0.0), ("0.9 to 0.999", 0.9), ("above 0.999", 0.999)]
SCENARIOS = ["edge", "canopy", "street", "few-satellites"]
MODES = ["instantaneous", "continuous"]


class Claims:
    """A recording in one set of bands, or a simulated session, at several rates."""

    def __init__(self, group, name, text, session):
        self.group, self.name, self.text, self.session = group, name, text, session

    def at_rate(self, kurs, mode, rate, folder):
        """Time of every fixed row: its success rate, whether it is wrong, errors over standard deviations."""
        text = re.sub(r"ambiguity = .*\n", "", self.text) + f'ambiguity = "{mode}"\nmax_wrong_fix_rate = {rate}\n'
        rows, baselines, _ = programs.solve(kurs, text, folder)
        strength = {programs.time(r): float(r["success_rate"] or 0) for r in rows}
        fixed = {}
        for r in baselines:
            if r["status"] == "fixed":
                off_m, sd_m = self.session.errors(r)
                wrong, beyond = is_wrong(off_m, sd_m, self.session.floor_m), is_beyond(off_m, sd_m)
                units = [o / s for o, s in zip(off_m, sd_m)]
                fixed[programs.time(r)] = (strength[programs.time(r)], wrong, beyond, units)
        return len(rows), fixed


def wanted(name, only):
    return any(word in name for word in only.split(","))


def recorded(data, only):
    for row in real_skies.RECORDINGS:
        if wanted(row[0], only):
            session, text = real_skies.configuration(row, data)
            yield Claims("recordings", row[0], text, session)


def simulated(kurs, only, count, work):
    for name in (name for name in SCENARIOS if wanted(name, only)):
        for number in range(count):
            session, text = sessions.simulated(kurs, name, number, f"{work}/{name}-{number}")
            yield Claims("scenarios", name, text, session)


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
            for instant, (strength, wrong, *_) in at_rate[rate][1].items():
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
        pages.write(arguments.write, "bench/reliability.py", text)


def tables(arguments, work):
    claims = list(recorded(arguments.data, arguments.only))
    claims += simulated(arguments.kurs, arguments.only, arguments.sessions, work)
    jobs = [(k, mode, rate) for k in range(len(claims)) for mode in MODES for rate in RATES]

    def one(job):
        k, mode, rate = job
        folder = tempfile.mkdtemp(dir=work)
        result = claims[k].at_rate(arguments.kurs, mode, rate, folder)
        shutil.rmtree(folder)
        return result

    with ThreadPoolExecutor(arguments.jobs) as pool:
        results = dict(zip(jobs, pool.map(one, jobs)))
    yield "| skies | predicted success | claimed share wrong | fixed rows | wrong | share wrong (95 %) |"
    yield "|---|---|---|---|---|---|"
    for mode in MODES:
        for group in ("recordings", "scenarios"):
            chosen = [k for k, session in enumerate(claims) if session.group == group]
            runs = [{rate: results[k, mode, rate] for rate in RATES} for k in chosen]
            yield from diagram(f"{group}, {mode}", runs)
    yield "\nAt the default rate:\n"
    yield "| sky | mode | rows | fixed | wrong | beyond 3 sd | mean (error / sd)² |"
    yield "|---|---|---|---|---|---|---|"
    for name in dict.fromkeys(session.name for session in claims):
        for mode in MODES:
            of_name = [results[k, mode, DEFAULT_RATE] for k, s in enumerate(claims) if s.name == name]
            rows, fixed = sum(n for n, _ in of_name), [row for _, found in of_name for row in found.values()]
            beyond = sum(row[2] for row in fixed)
            squares = [u * u for _, wrong, _, units in fixed if not wrong for u in units]
            z2 = f"{statistics.mean(squares):.2f}" if squares else "–"
            yield (f"| {name} | {mode} | {rows} | {100 * len(fixed) / max(rows, 1):.1f} % | {sum(f[1] for f in fixed)} "
                   f"| {100 * beyond / max(len(fixed), 1):.1f} % | {z2} |")


if __name__ == "__main__":
    main()
