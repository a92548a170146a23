#!/usr/bin/env python3
"""What gpsdecode (Debian gpsd-clients) and pynmeagps (PyPI) read in the sentences of `kurs solve --format nmea`.

    python3 tests-referees/nmea.py KURS        the program, as target/release/kurs

A car is simulated and solved; height, time and heading as they read them have to be those of attitude.csv, and the
standard deviations of `nmea:survey` too. A reader that is not installed is said and skipped (`lacking.py`).
"""

import csv
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

from lacking import lacking

ROOT = pathlib.Path(__file__).resolve().parent.parent
SCENARIO = ROOT / "scenarios/car.toml"
HEIGHT_M = 0.0006
DEGREE = 1e-8
HEADING_DEG = 0.0006


def solved(kurs, folder, profile):
    """Rows of attitude.csv and the path of the sentences."""
    out = folder / profile.replace(":", "-")
    command = [kurs, "solve", folder / "kurs.toml", "--quiet", "--out", out, "--format", f"csv,{profile}"]
    subprocess.run(command, check=True)
    with open(out / "attitude.csv", newline="") as file:
        return list(csv.DictReader(file)), out / "attitude.nmea"


def clock(row):
    """Time of day in UTC of the time tag, hundredths of a second."""
    leap_seconds = 18
    return round((float(row["tow_s"]) - leap_seconds) * 100) % 8_640_000


def clock_of(text):
    """The same of `hh:mm:ss.ss`."""
    hour, minute, second = text.split(":")
    return round((int(hour) * 3600 + int(minute) * 60 + float(second)) * 100)


def differs(found, wanted, limit):
    return found in (None, "") or abs(float(found) - float(wanted)) > limit


def points_elsewhere(found, wanted, limit):
    """As `differs`, of angles: 0° and 359.9998° are 0.0002° apart."""
    return found in (None, "") or abs((float(found) - float(wanted) + 180) % 360 - 180) > limit


def read_by_pynmeagps(rows, path, is_survey):
    """Faults of what pynmeagps reads, epoch by epoch."""
    try:
        from pynmeagps import NMEAReader
    except ImportError:
        lacking("no pynmeagps")
        return []
    epochs = []
    with open(path, "rb") as file:
        for _, message in NMEAReader(file, quitonerror=2):
            if message.msgID == "GGA":
                epochs.append({})
            epochs[-1][message.identity] = message
    faults = []
    if len(epochs) != len(rows):
        faults.append(f"{len(epochs)} epochs, {len(rows)} rows")
    for row, epoch in zip(rows, epochs):
        gga = epoch["GNGGA"]
        wrong = [
            clock_of(gga.time.isoformat()) != clock(row),
            clock_of(epoch["GNZDA"].time.isoformat()) != clock(row),
            differs(gga.alt + gga.sep, row["height_m"], HEIGHT_M),
            differs(gga.lat, row["latitude_deg"], DEGREE),
            differs(gga.lon, row["longitude_deg"], DEGREE),
            not 0.3 < float(gga.HDOP) < 5,
            differs(epoch["GNGST"].stdAlt, row["sd_down_m"], 1e-4),
        ]
        if row["status"] == "fixed":
            wrong.append(points_elsewhere(epoch["GNHDT"].headingT, row["heading_deg"], HEADING_DEG))
            if row["heading_rate_degps"]:
                wrong.append(differs(epoch["GNROT"].rot, 60 * float(row["heading_rate_degps"]), 0.006))
            if is_survey:
                pashr = epoch["PASHR"]
                wrong.append(differs(pashr.hdgAcc, row["heading_sd_deg"], HEADING_DEG))
                wrong.append(differs(pashr.pitchAcc, row["pitch_sd_deg"], HEADING_DEG))
        else:
            wrong.append(epoch["GNHDT"].headingT != "")
        if any(wrong):
            faults.append(f"{row['time_gpst']}: checks {[k for k, is_wrong in enumerate(wrong) if is_wrong]}")
    print(f"pynmeagps: {len(epochs)} epochs of {path.parent.name}, {len(faults)} faults")
    return faults


def read_by_gpsdecode(rows, path):
    """Faults of what gpsd reads: one TPV for every position, one ATT for every attitude.

    The first epoch has no TPV: gpsd reports a position with the sentence that ends a cycle, which it learns from the first change
    of time. A second learning would lose another one, so nothing but the first epoch is let off.
    """
    if shutil.which("gpsdecode") is None:
        lacking("no gpsdecode")
        return []
    with open(path, "rb") as file:
        text = subprocess.run(["gpsdecode"], stdin=file, capture_output=True, text=True, check=True).stdout
    reports = [json.loads(line) for line in text.splitlines() if line.startswith("{")]
    places = {clock_of(r["time"][11:-1]): r for r in reports if r["class"] == "TPV" and "altHAE" in r}
    attitudes = [r for r in reports if r["class"] == "ATT"]
    faults = []
    for row in rows[1:]:
        place = places.get(clock(row))
        if place is None:
            faults.append(f"{row['time_gpst']}: no TPV")
        elif differs(place["altHAE"], row["height_m"], 0.0011) or differs(place["lat"], row["latitude_deg"], DEGREE * 10):
            faults.append(f"{row['time_gpst']}: place {place}")
    wanted = [row for row in rows if row["status"] == "fixed"]
    if len(attitudes) != len(wanted):
        faults.append(f"{len(attitudes)} attitudes of {len(wanted)}")
    for row, attitude in zip(wanted, attitudes):
        # gpsd writes tilts with two decimals.
        limits = {"heading": HEADING_DEG, "pitch": 0.0051 + HEADING_DEG, "roll": 0.0051 + HEADING_DEG}
        if any(points_elsewhere(attitude.get(name), row[name + "_deg"], limit) for name, limit in limits.items()):
            faults.append(f"{row['time_gpst']}: attitude {attitude}")
    print(f"gpsdecode: {len(places)} positions, {len(attitudes)} attitudes, {len(faults)} faults")
    return faults


def main(kurs):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        subprocess.run([kurs, "simulate", SCENARIO, "--out", folder, "--quiet"], check=True)
        rows, marine = solved(kurs, folder, "nmea")
        faults = read_by_pynmeagps(rows, marine, False)
        rows, gpsd = solved(kurs, folder, "nmea:gpsd")
        faults += read_by_gpsdecode(rows, gpsd)
        rows, survey = solved(kurs, folder, "nmea:survey")
        faults += read_by_pynmeagps(rows, survey, True)
    print("\n".join(faults[:20]))
    sys.exit(bool(faults))


if __name__ == "__main__":
    main(*sys.argv[1:]) if len(sys.argv) == 2 else sys.exit(__doc__)
