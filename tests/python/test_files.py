"""Files against georinex."""

import warnings

import kurs
import numpy as np
import pytest
from conftest import ROOT

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import georinex


def assert_same(ours, theirs):
    """All values that georinex has, at their places."""
    compared = 0
    for name in theirs.data_vars:
        if name[0] not in "CLDS" or len(name) != 3:
            continue
        wanted = theirs[name]
        there = ~np.isnan(wanted.values)
        if not there.any():
            continue
        found = ours[name].sel(time=wanted.time, sv=wanted.sv).values
        assert np.array_equal(found[there], wanted.values[there]), name
        compared += there.sum()
    return compared


def test_observations_beside_georinex(recordings):
    file = recordings / "matrtklib_static/rover.obs"
    # Its reader takes a second for every ten epochs.
    span = ("2000-01-01", "2100-01-01")
    ours = kurs.read_obs(file, time=span)
    first = np.unique(ours["time_gpst"])[:8]
    theirs = georinex.load(file, tlim=(str(first[0]), str(first[-1])))
    assert assert_same(ours.to_xarray(), theirs) > 1000


def test_filters(recordings):
    file = recordings / "matrtklib_static/rover.obs"
    whole = kurs.read_obs(file)
    galileo = kurs.read_obs(file, systems="E", signals=["E1"])
    wanted = np.char.startswith(whole["signal"], "E1")
    assert galileo.rows == wanted.sum() > 0
    assert np.array_equal(galileo["phase_cycles"], whole["phase_cycles"][wanted], equal_nan=True)
    times = np.unique(whole["time_gpst"])
    some = kurs.read_obs(file, time=(times[10], times[19]))
    assert np.array_equal(np.unique(some["time_gpst"]), times[10:20])
    with pytest.raises(kurs.InputError, match="cannot|No such|not"):
        kurs.read_obs("/no/such/file")


def test_states_of_broadcast_beside_precise_orbits():
    nav = kurs.read_nav(ROOT / "testdata/navigation/precise.sp3")
    satellite = nav.satellites[0]
    lines = (ROOT / "testdata/navigation/precise.sp3").read_text().splitlines()
    epochs = [line for line in lines if line.startswith("*")]
    middle = epochs[len(epochs) // 2]
    year, month, day, hour, minute, second = middle[1:].split()
    time = np.datetime64(f"{year}-{int(month):02}-{int(day):02}T{int(hour):02}:{int(minute):02}:{int(float(second)):02}")
    row = next(l for l in lines[lines.index(middle) :] if l.startswith(f"P{satellite}"))
    position, velocity, clock = nav.state(satellite, [time, time + np.timedelta64(1, "s")])
    assert np.allclose(position[0], 1e3 * np.array([float(x) for x in row[4:46].split()]), atol=1e-3)
    assert np.allclose(position[1] - position[0], velocity.mean(axis=0), atol=0.01)
    far = nav.state(satellite, np.datetime64("1990-01-01"))
    assert np.isnan(far[0]).all() and np.isnan(far[2]).all()


def test_places_of_one_antenna(recordings):
    folder = recordings / "matrtklib_static"
    found = kurs.point.solve(folder / "base.obs", kurs.read_nav(folder / "base.nav"))
    places = np.column_stack([found[name] for name in ("x_m", "y_m", "z_m")])
    spread = np.nanstd(places, axis=0)
    assert found.rows > 100 and (spread < 3).all()
