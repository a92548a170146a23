#!/usr/bin/env python3
"""What a session costs against its size, and how fast the whole program is: docs/experiments/speed.md and speed.svg.

    bench/speed.py [PART …] [--kurs PROGRAM] [--runs N] [--instructions]

Parts are `sizes`, `program`, `rtklib` (bench/against_rtklib.sh) and `day`, 24 hours at 1 Hz of four antennas on two bands
(some gigabytes of files); the first three if none is named. Each writes its own place of the page.

Sessions are simulated (`kurs simulate`), one size is changed at a time, and each is solved `--runs` times (default 5) for
each of its two lengths: the least processor time counts, so that what else the machine does falls out. Cost of an epoch is
the difference of the two lengths over the difference of their epochs, in which start and navigation file fall out.
`--instructions` counts them (valgrind) instead of taking the time of `sizes`, once and over shorter sessions.
"""

import argparse
import math
import os
import re
import subprocess
import sys
import tempfile
import time

import pages

PAGE, PICTURE = "docs/experiments/speed.md", "docs/experiments/speed.svg"
COMMAND = "bench/speed.py"
# The other sizes where one is changed.
SATELLITES, ANTENNAS, BANDS = 20, 2, 2
LENGTHS, COUNTED_LENGTHS = (20, 120), (5, 15)
# A file of a hundred megabytes: a day.
INSPECTED_S = 86400
SIZES = {
    "epochs": [60, 120, 240, 480, 960],
    "satellites": [8, 12, 16, 20, 24, 28, 32, 36, 40],
    "antennas": [2, 3, 4, 6, 8, 10, 12],
    "bands": [1, 2, 3, 4, 5],
}
ASKED = {"epochs": 1.05, "satellites": 2.3, "antennas": 3.0}
# Bands of the scenario's systems, the first so many of each.
SIGNALS = {"G": ["G1C", "G2L", "G5Q"], "E": ["E1C", "E5Q", "E7Q", "E6C", "E8Q"], "C": ["C2I", "C7I", "C6I", "C5P", "C1P"]}


def scenario(seconds, satellites=SATELLITES, antennas=ANTENNAS, bands=BANDS):
    """A body at rest under an open sky, its antennas on a circle of a metre."""
    signals = [code for of_system in SIGNALS.values() for code in of_system[:bands]]
    text = f"""seed = 1
start = "2024-03-10T12:00:00"
duration_s = {seconds - 1}
interval_s = 1.0
signals = {signals}
[sky]
systems = ["G", "E", "C"]
max_satellites = {satellites}
[[body]]
name = "body"
[body.motion]
kind = "static"
place = {{ latitude_deg = 50.0, longitude_deg = 10.0, height_m = 200.0 }}
heading_deg = 35.0
pitch_deg = 2.0
roll_deg = -3.0
"""
    for antenna in range(antennas):
        angle = 2 * math.pi * antenna / antennas
        text += f'[[body.antenna]]\nname = "A{antenna}"\nposition_m = [{math.cos(angle):.4f}, {math.sin(angle):.4f}, 0.0]\n'
    return text.replace("'", '"')


def cpu_s(command, runs):
    """Least processor time of a command, and its peak memory, MB."""
    least, peak = math.inf, 0
    for _ in range(runs):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        errors = process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        if status:
            sys.exit(f"{' '.join(command)}: {errors.strip()}")
        least = min(least, usage.ru_utime + usage.ru_stime)
        peak = max(peak, usage.ru_maxrss / 1024)
    return least, peak


def instructions(command):
    """Instructions of a command, 10⁶."""
    counting = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", *command]
    counted = subprocess.run(counting, capture_output=True, text=True, check=True).stderr
    return int(re.search(r"Collected : (\d+)", counted)[1]) / 1e6


def session(arguments, folder, seconds, **size):
    """Simulates; the command that solves it."""
    path = f"{folder}/{seconds}"
    os.makedirs(path, exist_ok=True)
    with open(f"{path}/scenario.toml", "w") as file:
        file.write(scenario(seconds, **size))
    subprocess.run([arguments.kurs, "simulate", "--quiet", f"{path}/scenario.toml", "--out", path], check=True)
    return [arguments.kurs, "solve", "--quiet", "--require-fix", "0", f"{path}/kurs.toml", "--out", f"{path}/out",
            "--set", "constraint=none", "--set", "ambiguity=instantaneous", "--set", "elevation_mask_deg=0"]


def cost(arguments, name, size):
    """Milliseconds (10⁶ instructions) of an epoch; of the whole session where its length is what changes."""
    cost_of = lambda command: instructions(command) if arguments.instructions else 1e3 * cpu_s(command, arguments.runs)[0]
    lengths = COUNTED_LENGTHS if arguments.instructions else LENGTHS
    with tempfile.TemporaryDirectory() as folder:
        if name == "epochs":
            return cost_of(session(arguments, folder, size))
        costs = [cost_of(session(arguments, folder, length, **{name: size})) for length in lengths]
        return (costs[1] - costs[0]) / (lengths[1] - lengths[0])


def exponent(points):
    """Slope of the logarithms by least squares."""
    xs, ys = [math.log(x) for x, _ in points], [math.log(max(y, 1e-6)) for _, y in points]
    mean_x, mean_y = sum(xs) / len(xs), sum(ys) / len(ys)
    return sum((x - mean_x) * (y - mean_y) for x, y in zip(xs, ys)) / sum((x - mean_x) ** 2 for x in xs)


def plot(curves):
    """The curves on logarithmic axes, each over its least size, as SVG."""
    width, height, edge = 640, 420, 60
    colours = ["#1b6ca8", "#c0392b", "#218c53", "#8e44ad"]
    scaled = {name: [(x / points[0][0], max(y / points[0][1], 1e-3)) for x, y in points] for name, points in curves.items()}
    most_x = max(x for points in scaled.values() for x, _ in points)
    most_y = max(y for points in scaled.values() for _, y in points)
    at_x = lambda x: edge + (width - 2 * edge) * math.log(x) / math.log(most_x)
    at_y = lambda y: height - edge - (height - 2 * edge) * math.log(max(y, 1)) / math.log(max(most_y, 2))
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="13">',
             f'<rect width="{width}" height="{height}" fill="white"/>',
             f'<path d="M{edge} {edge}V{height - edge}H{width - edge}" fill="none" stroke="#555"/>',
             f'<text x="{width / 2}" y="{height - 15}" text-anchor="middle">size over the least one</text>',
             f'<text x="18" y="{height / 2}" text-anchor="middle" transform="rotate(-90 18 {height / 2})">cost over the least one</text>']
    for x in (power for power in (1, 2, 4, 8, 16, 32) if power <= most_x):
        parts.append(f'<text x="{at_x(x):.0f}" y="{height - edge + 18}" text-anchor="middle">{x}</text>')
    for y in (power for power in (1, 2, 5, 10, 20, 50, 100, 200, 500) if power <= most_y):
        parts.append(f'<text x="{edge - 8}" y="{at_y(y) + 4:.0f}" text-anchor="end">{y}</text>')
    for row, ((name, points), colour) in enumerate(zip(scaled.items(), colours)):
        line = " ".join(f"{at_x(x):.1f},{at_y(y):.1f}" for x, y in points)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts.append(f'<text x="{edge + 12}" y="{edge + 18 * row}" fill="{colour}">{name}: exponent {exponent(curves[name]):.2f}</text>')
    return "\n".join(parts + ["</svg>", ""])


def megabytes_per_s(arguments, command, path):
    """Speed of a command over a file; start-up is in it."""
    return os.path.getsize(path) / 1e6 / cpu_s(command, arguments.runs)[0]


def sizes(arguments, _):
    curves = {name: [(size, cost(arguments, name, size)) for size in of_name] for name, of_name in SIZES.items()}
    with open(PICTURE, "w", encoding="utf-8") as file:
        file.write(plot(curves))
    unit = "10⁶ instructions" if arguments.instructions else "ms"
    rows = ["| what grows | exponent asked | measured | cost, " + unit + " |", "|---|---|---|---|"]
    for name, points in curves.items():
        asked = f"{ASKED[name]:.2f}" if name in ASKED else "–"
        costs = ", ".join(f"{size}: {cost:.3g}" for size, cost in points)
        of_what = "of the session" if name == "epochs" else "of an epoch"
        rows.append(f"| {name} | {asked} | {exponent(points):.2f} | {of_what}, {costs} |")
    return "\n".join(rows)


def program(arguments, folder):
    start_s, _ = cpu_s([arguments.kurs, "--version"], arguments.runs)
    began = time.monotonic()
    demo_s, _ = cpu_s([arguments.kurs, "demo", "--out", f"{folder}/demo"], 1)
    demo = f"{time.monotonic() - began:.1f} s, processor {demo_s:.1f} s"
    session(arguments, f"{folder}/rates", INSPECTED_S, satellites=30)
    observations = f"{folder}/rates/{INSPECTED_S}/A0.rnx"
    size = os.path.getsize(observations) / 1e6
    rate = megabytes_per_s(arguments, [arguments.kurs, "inspect", observations], observations)
    return table([
        ("start-up (`kurs --version`)", "10 ms", f"{1e3 * start_s:.1f} ms"),
        ("demo", "3 s", demo),
        (f"`inspect` of {size:.0f} MB of RINEX 3", "400 MB/s", f"{rate:.0f} MB/s"),
    ])


def day(arguments, folder):
    command = session(arguments, f"{folder}/day", 86400, satellites=30, antennas=4)
    began = time.monotonic()
    processor_s, peak_mb = cpu_s(command, 1)
    measured = f"{time.monotonic() - began:.0f} s, processor {processor_s:.0f} s, {peak_mb:.0f} MB"
    return table([("24 h at 1 Hz, 4 antennas, 30 satellites, 2 bands", "60 s, 64 MB", measured)])


def rtklib(arguments, _):
    environment = os.environ | {"KURS": os.path.abspath(arguments.kurs)}
    command = ["bench/against_rtklib.sh", str(arguments.runs)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


def table(rows):
    return "\n".join(["| what | asked | measured |", "|---|---|---|"] + [f"| {' | '.join(row)} |" for row in rows])


PARTS = {"sizes": sizes, "program": program, "rtklib": rtklib, "day": day}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=["sizes", "program", "rtklib"])
    parser.add_argument("--kurs", default="target/release/kurs")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--instructions", action="store_true")
    arguments = parser.parse_args()
    if unknown := set(arguments.parts) - set(PARTS):
        parser.error(f"no such part: {', '.join(sorted(unknown))}")
    for part in arguments.parts:
        with tempfile.TemporaryDirectory() as folder:
            pages.write(PAGE, f"{COMMAND} {part}", PARTS[part](arguments, folder))


if __name__ == "__main__":
    main()
