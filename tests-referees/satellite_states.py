"""Satellite positions and clocks of Kurs against those of RTKLIB (`pip install pyrtklib`).

    cargo run --release -p kurs-formats --example satellite_states -- FILE > states.csv
    python3 tests-referees/satellite_states.py FILE states.csv

Every broadcast record is evaluated at several ages by both programs. RTKLIB's `eph2pos` gives the
position at the time of transmission and the clock with relativity and without group delay, as Kurs
does; its velocities are differences over 1 ms and are not compared.
"""

import collections
import csv
import gzip
import math
import sys
import tempfile

from lacking import lacking

try:
    import pyrtklib as rtk
except ImportError:
    lacking("no pyrtklib")
    sys.exit(0)

POSITION_LIMIT_M = 0.01
# GLONASS within half an hour, the age up to which Kurs uses a record. RTKLIB's gravitational
# constant (3.9860044e14) accounts for some millimetres.
GLONASS_MAX_AGE_S = 1800.0
CLOCK_LIMIT_S = 0.1e-9


def navigation(path):
    """Everything RTKLIB reads in the file; it does not unpack gzip itself."""
    nav = rtk.nav_t()
    if path.endswith(".gz"):
        with tempfile.NamedTemporaryFile(suffix=".rnx") as plain:
            plain.write(gzip.open(path).read())
            plain.flush()
            rtk.readrnx(plain.name, 1, "", rtk.obs_t(), nav, rtk.sta_t())
    else:
        rtk.readrnx(path, 1, "", rtk.obs_t(), nav, rtk.sta_t())
    return nav


def gps_time(week, tow_s):
    return rtk.gpst2time(int(week), float(tow_s))


def key(satellite, is_fnav, time, issue):
    return satellite, is_fnav, time.time, round(time.sec, 6), issue


def kepler_records(nav):
    records = collections.defaultdict(list)
    for i in range(nav.n):
        eph = nav.eph[i]
        is_fnav = rtk.satsys(eph.sat, rtk.Arr1Dint(1)) == rtk.SYS_GAL and eph.code & 0x100 != 0
        records[key(eph.sat, is_fnav, eph.toe, eph.iode)].append(eph)
    return records


def glonass_records(nav):
    """The issue is not compared: Kurs has none, a reference time is unique."""
    records = collections.defaultdict(list)
    for i in range(nav.ng):
        geph = nav.geph[i]
        records[key(geph.sat, False, geph.toe, 0)].append(geph)
    return records


def main(path, states):
    nav = navigation(path)
    kepler, glonass = kepler_records(nav), glonass_records(nav)
    worst = collections.defaultdict(lambda: [0, 0.0, 0.0, 0])
    for row in csv.DictReader(open(states)):
        satellite = rtk.satid2no(row["satellite"])
        toe = gps_time(row["toe_week"], row["toe_s"])
        time = rtk.timeadd(toe, float(row["age_s"]))
        is_glonass = row["message"] == "GlonassFdma"
        if is_glonass and abs(float(row["age_s"])) > GLONASS_MAX_AGE_S:
            continue
        evaluate = rtk.geph2pos if is_glonass else rtk.eph2pos
        records = glonass if is_glonass else kepler
        found = records[key(satellite, row["message"] == "GalileoFnav", toe, int(row["issue"]))]
        entry = worst[row["satellite"][0], row["message"]]
        if not found:
            entry[3] += 1
            continue
        best = None
        for eph in found:  # several stations may have sent in the same record
            position, clock, variance = rtk.Arr1Ddouble(3), rtk.Arr1Ddouble(1), rtk.Arr1Ddouble(1)
            evaluate(time, eph, position, clock, variance)
            apart_m = math.dist([position[k] for k in range(3)], [float(row[k]) for k in "xyz"])
            apart_s = abs(clock[0] - float(row["clock"]))
            if best is None or (apart_m, apart_s) < best:
                best = apart_m, apart_s
        entry[0] += 1
        entry[1] = max(entry[1], best[0])
        entry[2] = max(entry[2], best[1])
    failed = not worst
    for (system, message), (count, apart_m, apart_s, missing) in sorted(worst.items()):
        good = count > 0 and apart_m <= POSITION_LIMIT_M and apart_s <= CLOCK_LIMIT_S
        failed |= not good
        print(f"{system} {message}: {count} states, worst {apart_m * 1e3:.4f} mm, "
              f"{apart_s * 1e9:.6f} ns, not in RTKLIB {missing} {'' if good else 'FAILED'}")
    sys.exit(failed)


if __name__ == "__main__":
    main(*sys.argv[1:])
