#!/usr/bin/env python3
"""Figure 4 of paper 003: standard deviations of x by least squares and by closed forms; draws docs/experiments/trajectory-figure4.svg.

    bench/figure4.py [DRAWS]        (default 10000; KURS: program, default target/release/kurs)
"""

import csv
import math
import os
import subprocess
import sys
import tempfile

FIGURE = "docs/experiments/trajectory-figure4.svg"
WIDTH, HEIGHT, LEFT, BOTTOM, MARGIN = 800, 420, 60, 50, 20
#: Heights on the horizontal axis, km, falling as the object does; metres on the vertical one.
HEIGHTS_KM, METRES = (50, 40, 30, 20, 10, 2), (3, 10, 30, 100, 300, 1000)
SETS = (("A4", "#1f5fa8", "azimuths and elevations"), ("DC4", "#b5432a", "direction cosines"))
CURVES = (("lsq_sd_x_m", "", "least squares"), ("model_sd_x_m", "6 4", "closed form"))


def main(draws="10000"):
    with tempfile.TemporaryDirectory() as folder:
        command = [os.environ.get("KURS", "target/release/kurs"), "track", "examples/track/figure4.toml", "--simulate"]
        subprocess.run([*command, "--monte-carlo", draws, "--out", folder, "--quiet"], check=True, stdout=subprocess.DEVNULL)
        with open(f"{folder}/monte_carlo.csv") as file:
            rows = list(csv.DictReader(file))
    print("| height, km | measured | least squares, m | closed form, m | draws that are not real |\n|---|---|---|---|---|")
    for name, _, words in SETS:
        for row in (row for row in rows if row["set"] == name and float(row["height_m"]) in (50e3, 26e3, 10e3, 4e3, 2e3)):
            refused = 100 * int(row["refused"]) / (int(row["draws"]) + int(row["refused"]))
            sds = " | ".join(f"{float(row[column]):.1f}" for column, _, _ in CURVES)
            print(f"| {float(row['height_m']) / 1e3:.0f} | {words} | {sds} | {refused:.1f} % |")
    with open(FIGURE, "w") as file:
        file.write(drawn(rows))


def across(height_km):
    return LEFT + (HEIGHTS_KM[0] - height_km) / (HEIGHTS_KM[0] - HEIGHTS_KM[-1]) * (WIDTH - LEFT - MARGIN)


def up(metres):
    low, high = math.log(METRES[0]), math.log(METRES[-1])
    return HEIGHT - BOTTOM - (math.log(metres) - low) / (high - low) * (HEIGHT - BOTTOM - MARGIN)


def drawn(rows):
    lines = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="13">']
    lines.append(f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>')
    for metres in METRES:
        y = up(metres)
        lines.append(f'<line x1="{LEFT}" x2="{WIDTH - MARGIN}" y1="{y:.1f}" y2="{y:.1f}" stroke="#dddddd"/>')
        lines.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{metres}</text>')
    for height_km in HEIGHTS_KM:
        lines.append(f'<text x="{across(height_km):.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{height_km}</text>')
    lines.append(f'<text x="{(WIDTH + LEFT) / 2}" y="{HEIGHT - 10}" text-anchor="middle">height, km</text>')
    lines.append(f'<text x="14" y="{HEIGHT / 2}" text-anchor="middle" transform="rotate(-90 14 {HEIGHT / 2})">standard deviation of x, m</text>')
    y = MARGIN
    for name, colour, measured in SETS:
        of_set = [row for row in rows if row["set"] == name]
        for column, dashes, method in CURVES:
            style = f'fill="none" stroke="{colour}" stroke-width="2" stroke-dasharray="{dashes}"'
            points = " ".join(f"{across(float(row['height_m']) / 1e3):.1f},{up(float(row[column])):.1f}" for row in of_set)
            lines.append(f'<polyline points="{points}" {style}/>')
            y += 18
            lines.append(f'<line x1="{LEFT + 20}" x2="{LEFT + 60}" y1="{y - 4}" y2="{y - 4}" {style}/>')
            lines.append(f'<text x="{LEFT + 68}" y="{y}">{measured}, {method}</text>')
    return "\n".join([*lines, "</svg>"]) + "\n"


if __name__ == "__main__":
    main(*sys.argv[1:])
