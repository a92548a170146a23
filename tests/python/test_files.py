"""Files against georinex."""

import datetime
import pickle
import sys
import warnings

import kurs
import numpy as np
import pytest

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


def test_time_with_open_ends_and_without_sense(simulated):
    file = simulated / "A0.rnx"
    whole = kurs.read_obs(file)
    times = np.unique(whole["time_gpst"])
    for time in ((None, None), (None, times[-1]), (times[0], None), ["2024-03-09", None], times[[0, -1]]):
        assert kurs.read_obs(file, time=time).rows == whole.rows
    late = kurs.read_obs(file, time=("2024-03-10", None))
    assert late.rows == (whole["time_gpst"] >= np.datetime64("2024-03-10")).sum() > 0
    assert kurs.read_obs(file, time=(int(times[50].astype(np.int64)), None))["time_gpst"].min() == times[50]
    zone = datetime.timezone(datetime.timedelta(hours=3))
    for wrong, words in (
        (("2024-03-10", "9999-12-31"), "'9999-12-31', expected an instant from 1678 to 2261"),
        (("2024-03-10", "NaT"), "'NaT', expected an instant, or None"),
        ((np.datetime64("NaT"), None), "expected an instant, or None"),
        (("2024-03-10T00:00:00Z", None), "expected an instant without a zone"),
        (("2024-03-10 00:00+03:00", None), "expected an instant without a zone"),
        ((datetime.datetime(2024, 3, 10, tzinfo=zone), None), "expected an instant without a zone"),
    ):
        with pytest.raises(ValueError, match=f"time has .*{words}"):
            kurs.read_obs(file, time=wrong)
    for wrong in ((), ("2024-03-10",), ("2024-03-10", None, None), "2024-03-10"):
        with pytest.raises(ValueError, match="time is .*, expected two instants"):
            kurs.read_obs(file, time=wrong)


def test_what_is_no_path_is_refused(simulated):
    for call in (kurs.read_obs, kurs.read_nav):
        for wrong in (b"A0.rnx", [b"A0.rnx"], [simulated / "A0.rnx", 3]):
            with pytest.raises(TypeError, match="the path is .*, expected a text or an object of a path"):
                call(wrong)
    with pytest.raises(TypeError, match="nav is 'nav.rnx', expected what read_nav gives"):
        kurs.point.solve(simulated / "A0.rnx", "nav.rnx")


def test_observations_go_through_nanoarrow_where_there_is_no_pyarrow(simulated, monkeypatch):
    na = pytest.importorskip("nanoarrow")
    table = kurs.read_obs(simulated / "A0.rnx")
    # Values of which a wrong width would show.
    table._columns["lock"] = (np.arange(table.rows) % 7).astype(np.uint8)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    rows = na.Array(na.c_array_stream(table)).to_pylist()
    assert [row["lock"] for row in rows] == table["lock"].tolist()
    assert [row["signal"] for row in rows] == table["signal"].tolist()


def test_one_signal_needs_no_list_and_unknown_ones_are_refused(simulated):
    file = simulated / "A0.rnx"
    whole = kurs.read_obs(file)
    assert whole.damage == []
    wanted = np.char.startswith(whole["signal"], "G1")
    for signals in ("G1", ["G1"], "G1C"):
        assert kurs.read_obs(file, signals=signals).rows == wanted.sum() > 0
    for word in ("foo", "G", "G1CC"):
        with pytest.raises(ValueError, match=f'signals has "{word}", expected a signal such as "G1C" or a band'):
            kurs.read_obs(file, signals=[word])
    with pytest.raises(ValueError, match="systems has 'X', expected letters of \"GECRJIS\""):
        kurs.read_obs(file, systems="GX")


def test_epochs_of_two_antennas_are_no_session(simulated):
    files = [simulated / "A0.rnx", simulated / "A1.rnx"]
    found = kurs.read_obs(files)
    assert found.rows == kurs.read_obs(files[0]).rows
    (skipped,) = found.damage
    assert skipped["file"] == str(files[1])
    assert "101 epochs are not later than the end of the file before, skipped" in skipped["what"]


def test_states_of_broadcast_beside_precise_orbits(recordings):
    broadcast = kurs.read_nav(recordings / "orbits/MOJN00DNK_R_20201770000_01D_MN.rnx.gz")
    precise = kurs.read_nav(recordings / "orbits/GRG0MGXFIN_20201770000_01D_15M_ORB.SP3.gz")
    times = np.datetime64("2020-06-25T06:00") + np.arange(0, 43200, 450) * np.timedelta64(1, "s")
    errors = []
    for satellite in (name for name in precise.satellites if name[0] == "G"):
        position, velocity, clock = broadcast.state(satellite, times)
        wanted, rate, _ = precise.state(satellite, times)
        errors.append(np.linalg.norm(position - wanted, axis=1))
        assert np.nanmax(np.abs(velocity - rate), initial=0) < 0.01
        assert np.nanmax(np.abs(clock), initial=0) < 1e-3
        # The velocity is the rate of the position.
        later = broadcast.state(satellite, times + np.timedelta64(1, "s"))[0]
        assert np.nanmax(np.abs(later - position - (velocity + 0)), initial=0) < 1.0
    # Broadcast orbits are good to two metres, and are those of the antenna, not of the centre of mass.
    assert np.count_nonzero(~np.isnan(errors)) > 300 and np.nanmedian(errors) < 3
    again = pickle.loads(pickle.dumps(precise))
    assert np.array_equal(again.state(satellite, times)[0], precise.state(satellite, times)[0], equal_nan=True)
    far = precise.state("G01", np.datetime64("1990-01-01"))
    assert np.isnan(far[0]).all() and np.isnan(far[2]).all()


def test_places_of_one_antenna(recordings):
    folder = recordings / "matrtklib_static"
    found = kurs.point.solve(folder / "base.obs", kurs.read_nav(folder / "base.nav"))
    places = np.column_stack([found[name] for name in ("x_m", "y_m", "z_m")])
    spread = np.nanstd(places, axis=0)
    assert found.rows > 100 and (spread < 3).all() and found.damage == []
    both = kurs.point.solve([folder / "base.obs", folder / "rover.obs"], kurs.read_nav(folder / "base.nav"))
    assert both.rows == found.rows and "skipped" in both.damage[0]["what"], both.damage
    for mask in (np.nan, -1e9, 90):
        with pytest.raises(ValueError, match="elevation_mask_deg is .*, expected -5 to 89"):
            kurs.point.solve(folder / "base.obs", kurs.read_nav(folder / "base.nav"), elevation_mask_deg=mask)
