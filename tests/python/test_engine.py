"""Rows as they come: those of `kurs live` and `kurs solve`."""

import csv
import tomllib
from pathlib import Path

import kurs
import numpy as np
import pytest
from conftest import SCENARIO, command


def configuration(simulated, ending, more=""):
    antennas = "".join(
        f'[[antenna]]\nname = "A{i}"\nobs = ["{simulated}/A{i}.{ending}"]\n'
        f'stream = "file://{simulated}/A{i}.{ending}?speed=0"\nposition_m = [{1.2 * i}, 0.0, 0.0]\n'
        for i in (0, 1)
    )
    return antennas + "[nav]\nas_received = true\napproximate_time = 2024-03-10\n" + more


def assert_rows(rows, file):
    with file.open(newline="") as text:
        wanted = list(csv.DictReader(text))
    assert len(rows) == len(wanted)
    for row, other in zip(rows, wanted, strict=True):
        for name, field in other.items():
            found = row[name]
            if found is None:
                assert field == ""
            elif isinstance(found, float):
                assert found == float(field), name
            else:
                assert found == field, name


def live(config, out, tables=("attitude", "baselines")):
    command("live", config, "--once", "--out", out)
    merged = {}
    for name in tables:
        days = sorted(out.glob(f"*/{name}.csv"))
        lines = [line for day in days for line in day.read_text().splitlines()[1:]]
        merged[name] = out / f"{name}.csv"
        merged[name].write_text("\n".join([days[0].read_text().splitlines()[0], *lines]) + "\n")
    return merged


def test_names_may_hold_any_character(simulated):
    names = ["A\u2028B", 'C", \x85']
    engine = kurs.Engine({"antenna": [{"name": name, "position_m": [1.2 * i, 0, 0]} for i, name in enumerate(names)]})
    rows = []
    for i, name in enumerate(names):
        rows += engine.push_bytes(name, (simulated / f"A{i}.ubx").read_bytes())
    rows += engine.flush()
    assert len(rows) == 101
    pairs = {(row["base"], row["rover"]) for of in rows for row in of["baselines"]}
    assert pairs == {tuple(names)}


@pytest.mark.parametrize("ending", ["ubx", "sbf"])
def test_bytes_give_the_rows_of_live(simulated, tmp_path, ending):
    config = tmp_path / "live.toml"
    config.write_text(configuration(simulated, ending))
    wanted = live(config, tmp_path / "live")
    engine = kurs.Engine(config)
    data = [(simulated / f"A{i}.{ending}").read_bytes() for i in (0, 1)]
    rows = []
    # Pieces of any size, one antenna ahead of the other.
    random = np.random.default_rng(1)
    at = [0, 0]
    while any(at[i] < len(data[i]) for i in (0, 1)):
        for i in (0, 1):
            end = at[i] + int(random.integers(1, 3000))
            rows += engine.push_bytes(f"A{i}", data[i][at[i] : end])
            at[i] = end
    assert len(rows) > 90, "rows come before the end"
    rows += engine.flush()
    assert_rows(rows, wanted["attitude"])
    assert_rows([baseline for row in rows for baseline in row["baselines"]], wanted["baselines"])


def test_epochs_give_the_rows_of_solve(simulated):
    solved = kurs.solve(simulated / "kurs.toml")
    engine = kurs.Engine(simulated / "kurs.toml")
    tables = [kurs.read_obs(simulated / f"A{i}.rnx") for i in (0, 1)]
    names = ("satellite", "signal", "pseudorange_m", "phase_cycles", "doppler_hz", "cn0_dbhz", "lock")
    columns = [{name: table[name].tolist() for name in names} for table in tables]
    times = [table["time_gpst"] for table in tables]
    rows = []
    for time in np.unique(times[0]):
        since = (time - np.datetime64("1980-01-06", "ns")) / np.timedelta64(1, "ns")
        week, rest = divmod(int(since), 604_800_000_000_000)
        for i in (0, 1):
            at = np.flatnonzero(times[i] == time)
            epoch = [tuple(columns[i][name][k] for name in names) for k in at]
            rows += engine.push(i, (week, rest / 1e9), epoch)
    rows += engine.flush()
    assert_rows(rows, solved.folder / "attitude.csv")


STATION = """
[station]
name = "quay"
place = { latitude_deg = 52.001, longitude_deg = 13.0, height_m = 95.0 }
"""


def test_rows_wait_for_the_station(tmp_path):
    """Bytes of a station, in pieces of any size and behind the antennas: the rows of `kurs live`, coordinates relative to it."""
    (tmp_path / "scenario.toml").write_text(SCENARIO.replace("duration_s = 20.0", "duration_s = 5.0") + STATION)
    command("simulate", tmp_path / "scenario.toml", "--out", tmp_path / "made")
    config = tomllib.loads((tmp_path / "made/kurs.toml").read_text())
    x_m, y_m, z_m = config["station"]["position_ecef_m"]
    name = Path(config["station"]["obs"][0]).stem
    more = f"""
[station]
stream = "file://{tmp_path}/made/{name}.ubx?speed=0"
position_ecef_m = [{x_m}, {y_m}, {z_m}]
"""
    (tmp_path / "live.toml").write_text(configuration(tmp_path / "made", "ubx", more))
    wanted = live(tmp_path / "live.toml", tmp_path / "live", ("attitude", "baselines", "antennas"))

    engine = kurs.Engine(tmp_path / "live.toml")
    assert engine.antennas == ["A0", "A1", "station"]
    files = {"A0": "A0", "A1": "A1", "station": name}
    for antenna in ("A0", "A1"):
        assert engine.push_bytes(antenna, (tmp_path / f"made/{antenna}.ubx").read_bytes()) == []
    data = (tmp_path / f"made/{name}.ubx").read_bytes()
    rows = [row for at in range(0, len(data), 1000) for row in engine.push_bytes("station", data[at : at + 1000])]
    assert 20 < len(rows) <= 26, "an epoch leaves when the station has it"
    rows += engine.flush()
    assert_rows(rows, wanted["attitude"])
    assert_rows([place for row in rows for place in row["by_code"]], wanted["antennas"])
    assert sum(row["sd_north_m"] < 0.05 for row in rows if row["sd_north_m"]) > 10, "by phase"

    # With a deadline nobody waits for it: its newest epoch serves.
    engine = kurs.Engine(tmp_path / "live.toml", deadline_s=1e-6)
    for antenna, file in reversed(files.items()):
        rows = engine.push_bytes(antenna, (tmp_path / f"made/{file}.ubx").read_bytes())
    assert any(row["by_code"] for row in rows)


def test_an_epoch_leaves_by_its_deadline(simulated):
    engine = kurs.Engine(simulated / "kurs.toml", deadline_s=0.05)
    table = kurs.read_obs(simulated / "A0.rnx")
    first = table["time_gpst"] == table["time_gpst"][0]
    observations = [("G05", "G1C", 2.2e7, 1.1e8, 0.0, 45.0, 0)] * int(first.sum() > 0)
    assert engine.push("A0", (2305, 0.0), observations) == []
    rows = []
    for _ in range(200):
        rows += engine.poll()
        if rows:
            break
        import time

        time.sleep(0.005)
    assert [row["status"] for row in rows] == ["lost"]
    with pytest.raises(ValueError, match="antenna 'B'"):
        engine.push_bytes("B", b"")
    with pytest.raises(ValueError, match="G01 has E1C, expected a signal of its system, G"):
        engine.push("A0", (2305, 1.0), [("G01", "E1C", 2.2e7, 1.1e8, 0.0, 45.0, 0)])
    with pytest.raises(kurs.UsageError, match="deadline_s is -1"):
        kurs.Engine(simulated / "kurs.toml", deadline_s=-1)
