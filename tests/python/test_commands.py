"""The commands through Python: the same rows, the same words."""

import csv
import multiprocessing
import os
import pickle
import re
import subprocess
import sys
import tomllib
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import kurs
import numpy as np
import pytest
from conftest import KURS, ROOT, command


@pytest.fixture(scope="module")
def solved(simulated, tmp_path_factory):
    out = tmp_path_factory.mktemp("solved")
    command("solve", simulated / "kurs.toml", "--out", out)
    return out


@pytest.fixture(scope="module")
def solution(simulated):
    return kurs.solve(simulated / "kurs.toml")


def test_the_command_of_the_wheel():
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    assert command("--version").strip() == f"kurs {version}"
    assert kurs.__version__ == version
    assert command("solve", status=2) == ""
    done = subprocess.run([KURS, "solve", "/no/such.toml"], capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.startswith("error: /no/such.toml")
    piped = subprocess.run(f"{KURS} solve --help | head -1", shell=True, capture_output=True, text=True)
    assert piped.stdout and not piped.stderr


def test_solve_has_the_rows_of_the_command(solved, solution):
    for name in ("attitude", "baselines"):
        table = getattr(solution, name)
        with (solved / f"{name}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert list(table) == list(rows[0]) and table.rows == len(rows) > 0
        for column, values in table.items():
            texts = [row[column] for row in rows]
            if values.dtype.kind in "fi":
                wanted = np.array([float(text or "nan") for text in texts])
                assert np.array_equal(values, wanted, equal_nan=True), column
            elif values.dtype.kind == "M":
                assert np.array_equal(values, np.array([t.rstrip("Z") for t in texts], "datetime64[ns]"))
            else:
                assert values.tolist() == texts
        assert (solution.folder / f"{name}.csv").read_bytes() == (solved / f"{name}.csv").read_bytes()
    assert solution.status == 0 and solution.summary["fixed"] > 90
    assert abs(np.nanmean(solution.attitude["heading_deg"]) - 40) < 0.2


def test_overrides_and_dictionaries(simulated, solution):
    config = tomllib.loads((simulated / "kurs.toml").read_text())
    for i, antenna in enumerate(config["antenna"]):
        antenna["obs"] = [simulated / name for name in antenna["obs"]]
        antenna["position_m"] = np.array([1.2 * i, 0, 0])
    config["nav"]["files"] = [simulated / name for name in config["nav"]["files"]]
    config["solve"]["bands"] = None
    one_band = kurs.solve(config, bands=["G1"], solve__elevation_mask_deg=15)
    assert one_band.attitude["satellites"].max() < solution.attitude["satellites"].max()
    assert np.array_equal(kurs.solve(config).attitude["heading_deg"], solution.attitude["heading_deg"], equal_nan=True)


def test_errors_have_the_words_of_the_command_line(simulated, tmp_path):
    with pytest.raises(kurs.UsageError, match="array_sd_mm.*array_sd_m"):
        kurs.solve(simulated / "kurs.toml", array_sd_mm=0.01)
    with pytest.raises(kurs.UsageError, match="at least two are needed"):
        kurs.solve({"antenna": []})
    (tmp_path / "no.rnx").write_text("nothing\n")
    config = {"antenna": [{"name": n, "obs": [tmp_path / "no.rnx"]} for n in "AB"], "nav": {"files": [tmp_path / "no.rnx"]}}
    with pytest.raises(kurs.InputError, match="no.rnx"):
        kurs.solve(config)
    for wrong in (None, 3, ["a.toml"]):
        with pytest.raises(TypeError, match=r"the configuration is .*, expected the path of a file or a dictionary"):
            kurs.solve(wrong)
    config["solve"] = {"array_sd_m": np.float64("nan")}
    with pytest.raises(kurs.UsageError, match="array_sd_m is nan, expected a finite number"):
        kurs.solve(config)
    with pytest.raises(kurs.UsageError, match="elevation_mask_deg is NaN, expected -5 to 89"):
        kurs.solve(simulated / "kurs.toml", elevation_mask_deg=np.nan)
    assert kurs.solve(simulated / "kurs.toml", bands=None).summary["fixed"] > 90
    for wrong in (lambda: kurs.solve(simulated / "kurs.toml", bands=["G1", None]), lambda: kurs.solve({"solve": {"bands": [None]}})):
        with pytest.raises(kurs.UsageError, match="bands has None in a list, expected values"):
            wrong()


def test_paths_of_overrides_start_where_those_of_the_configuration_do(simulated, monkeypatch):
    config = tomllib.loads((simulated / "kurs.toml").read_text())
    (nav,) = config["nav"]["files"]
    wanted = kurs.solve(simulated / "kurs.toml", nav__files=[nav]).summary["fixed"]
    monkeypatch.chdir(simulated)
    for files in ([nav], np.array([nav]), (Path(nav),)):
        assert kurs.solve(config, nav__files=files).summary["fixed"] == wanted > 90


def test_texts_of_overrides_are_what_they_are(simulated):
    for name in ("😀 nav", 'a"b\\c\n', "\x7f", "\u2028"):
        with pytest.raises(kurs.InputError, match=f"{re.escape(name)}: No such file"):
            kurs.solve(simulated / "kurs.toml", nav__files=[name])


def test_files_that_cannot_be_inspected_are_an_exception(simulated, capfd):
    with pytest.raises(kurs.InputError, match="/no/such: .*\n/no/other: "):
        kurs.inspect("/no/such", simulated / "A0.rnx", "/no/other")
    assert capfd.readouterr().err == ""


def test_a_track_without_a_point_is_an_exception(tmp_path):
    (tmp_path / "m.csv").write_text("time_s,station,range_m\n0,S,1e5\n")
    station = {"name": "S", "latitude_deg": 60, "longitude_deg": 30, "height_m": 0, "range_sd_m": 5}
    with pytest.raises(kurs.InputError, match="every point is lost, the first one because: "):
        kurs.trajectory.track({"station": [station], "track": {"files": [tmp_path / "m.csv"]}})


def solved_elsewhere(config):
    return kurs.solve(config)


def test_solutions_go_from_process_to_process(simulated, solution):
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        found = executor.submit(solved_elsewhere, simulated / "kurs.toml").result()
    assert found.summary["fixed"] == solution.summary["fixed"]
    assert np.array_equal(found.attitude["heading_deg"], solution.attitude["heading_deg"], equal_nan=True)
    copied = pickle.loads(pickle.dumps(found))
    folder = found.folder
    del found
    assert not folder.exists() and copied.folder.exists() and copied.baselines.rows == solution.baselines.rows


def test_solutions_in_a_folder_stay_there(simulated, tmp_path):
    kept = pickle.loads(pickle.dumps(kurs.solve(simulated / "kurs.toml", out=tmp_path / "out")))
    assert kept.folder == tmp_path / "out" and kept.summary["fixed"] > 90


def test_tables_for_others(solution, tmp_path):
    import polars as pl
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = solution.attitude
    frame = table.to_pandas()
    assert frame["status"].dtype == "category" and len(frame) == table.rows
    assert frame["reason"].isna().sum() == (table["reason"] == "").sum()
    arrow = pa.table(table)
    assert arrow.num_rows == table.rows
    assert arrow["heading_deg"].null_count == np.isnan(table["heading_deg"]).sum()
    assert pa.types.is_dictionary(arrow["status"].type)
    polar = table.to_polars()
    assert polar["heading_deg"].null_count() == arrow["heading_deg"].null_count
    assert polar["status"].to_list() == table["status"].tolist()
    assert pl.DataFrame(table).height == table.rows
    table.to_parquet(tmp_path / "attitude.parquet")
    assert pq.read_table(tmp_path / "attitude.parquet")["qw"].to_pylist() == arrow["qw"].to_pylist()
    assert [path.name for path in tmp_path.iterdir()] == ["attitude.parquet"]


def test_tables_go_through_nanoarrow_too(solution, monkeypatch):
    import polars as pl

    class OnlyArrow:
        """Polars takes a mapping column by column."""

        __arrow_c_stream__ = solution.attitude.__arrow_c_stream__

    monkeypatch.setitem(sys.modules, "pyarrow", None)
    frame = pl.DataFrame(OnlyArrow())
    for name, column in solution.attitude.items():
        missing = np.isnan(column) if column.dtype.kind == "f" else column == "" if column.dtype.kind == "U" else np.zeros(len(column), bool)
        assert frame[name].is_null().to_list() == missing.tolist(), name
        assert (frame[name].to_numpy()[~missing] == column[~missing]).all(), name


def test_report_and_inspect_and_plan(solution, simulated, tmp_path):
    solution.report(tmp_path / "report.html")
    assert "<html" in (tmp_path / "report.html").read_text()[:400]
    seen = kurs.inspect(simulated / "A0.rnx")
    assert seen[0]["content"] == "observations"
    planned = kurs.plan({"antenna": [{"name": f"A{i}", "position_m": p} for i, p in enumerate(np.eye(3))]}, duration="2h")
    assert 0 < planned["epochs"][0]["heading_sd_deg"] < 5
    nav = simulated / tomllib.loads((simulated / "kurs.toml").read_text())["nav"]["files"][0]
    one, listed = (kurs.plan(simulated / "kurs.toml", nav=files, duration="1h") for files in (str(nav), [nav]))
    assert one == listed


def test_stubs_and_package_are_strictly_typed():
    for target in (["-p", "kurs"], [str(ROOT / "tests/python/typed.py")]):
        done = subprocess.run([sys.executable, "-m", "mypy", "--strict", *target], capture_output=True, text=True, cwd="/")
        assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("script", sorted((ROOT / "crates/kurs-py/examples").glob("*.py")), ids=lambda path: path.stem)
def test_examples_and_their_twins_in_rust(script, tmp_path):
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    expected = [line[3:] for line in script.read_text().splitlines() if line.startswith("#> ")]
    assert expected and done.stdout.splitlines() == expected
    twins = os.environ.get("KURS_TWINS")
    if twins is None:
        pytest.skip("no KURS_TWINS, the example of kurs-py that tests/python/run builds")
    twin = subprocess.run([twins, script.stem], capture_output=True, text=True, cwd=tmp_path)
    assert twin.returncode == 0 and twin.stdout.splitlines() == expected, twin.stderr
