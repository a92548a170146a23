"""Rows as they come: those of `kurs live` and `kurs solve`."""

import csv

import kurs
import numpy as np
import pytest
from conftest import command


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


def live(config, out):
    command("live", config, "--once", "--out", out)
    merged = {}
    for name in ("attitude", "baselines"):
        days = sorted(out.glob(f"*/{name}.csv"))
        lines = [line for day in days for line in day.read_text().splitlines()[1:]]
        merged[name] = out / f"{name}.csv"
        merged[name].write_text("\n".join([days[0].read_text().splitlines()[0], *lines]) + "\n")
    return merged


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
    with pytest.raises(kurs.UsageError, match="deadline_s is -1"):
        kurs.Engine(simulated / "kurs.toml", deadline_s=-1)
