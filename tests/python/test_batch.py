"""Many sessions: killed and gone on, divided, and on any executor, the data set is the same."""

import csv
import json
import signal
import subprocess
import sys
import time
import tomllib
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import kurs
import numpy as np
import pytest
from conftest import KURS, command
from kurs import batch

SESSIONS = 24


@pytest.fixture(scope="module")
def manifest(tmp_path_factory):
    """Sessions of four recordings, each with its own keys; one has no fix, one no file."""
    folder = tmp_path_factory.mktemp("archive")
    for seed in range(4):
        kurs.simulate("roof-static", folder / f"day{seed}", seed=seed + 1, duration_s=20)
    made = sorted(path.name for path in (folder / "day0").iterdir())
    assert "kurs.toml" in made
    with (folder / "manifest.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["label", "config", "set"])
        for number in range(SESSIONS):
            keys = f"elevation_mask_deg={10 + number // 4}"
            if number == 5:
                keys += ";elevation_mask_deg=85"
            config = f"day{number % 4}/kurs.toml" if number != 9 else "day9/kurs.toml"
            writer.writerow([f"day {number}", config, keys])
    return folder / "manifest.csv"


@pytest.fixture(scope="module")
def whole(manifest, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    command("batch", manifest, "--out", out, status=3)
    return tree(out)


def tree(out):
    """Every file of a data set but for the times that it took."""
    files = {}
    for path in sorted(out.rglob("*")):
        if path.is_dir():
            continue
        content = path.read_bytes()
        if path.name == "summary.json":
            content = json.loads(content)
            del content["wall_s"], content["epochs_per_s"]
        elif path.name == "manifest-status.csv":
            content = [line.rsplit(",", 1)[0] for line in content.decode().splitlines()]
        files[str(path.relative_to(out))] = content
    return files


def test_every_session_has_its_status(whole):
    rows = list(csv.DictReader(line + "," for line in whole["manifest-status.csv"]))
    assert [row["label"] for row in rows] == [f"day {number}" for number in range(SESSIONS)]
    assert rows[9]["status"] == "failed" and "day9/kurs.toml: cannot be read" in rows[9]["reason"]
    assert rows[5]["status"] != "done"
    others = [row for number, row in enumerate(rows) if number not in (5, 9)]
    assert {row["status"] for row in others} == {"done"} and all(int(row["fixed"]) > 0 for row in others)
    assert len({row["configuration_hash"] for row in others}) == len(others)
    assert "session=day%2010/attitude.csv" in whole and "session=day%209/failure.json" in whole


def test_killed_twice_and_gone_on(manifest, whole, tmp_path):
    for share in (0.25, 0.6):
        run = subprocess.Popen([KURS, "batch", manifest, "--out", tmp_path, "--jobs", "2", "--quiet"])
        while len(list(tmp_path.glob("session=*/summary.json"))) < share * SESSIONS:
            assert run.poll() is None, "killed before the end"
            time.sleep(0.002)
        run.send_signal(signal.SIGKILL)
        run.wait()
    done = {path: path.stat().st_mtime_ns for path in tmp_path.glob("session=*/summary.json")}
    assert 0.6 * SESSIONS <= len(done) < SESSIONS
    command("batch", manifest, "--out", tmp_path, status=3)
    assert tree(tmp_path) == whole
    assert all(path.stat().st_mtime_ns == at for path, at in done.items()), "what is done is not solved again"


def test_interrupted_and_gone_on(manifest, whole, tmp_path):
    run = subprocess.Popen([KURS, "batch", manifest, "--out", tmp_path, "--jobs", "2", "--quiet"])
    while len(list(tmp_path.glob("session=*/summary.json"))) < 5:
        time.sleep(0.002)
    run.send_signal(signal.SIGINT)
    assert run.wait() in (130, -signal.SIGINT)
    command("batch", manifest, "--out", tmp_path, status=3)
    assert tree(tmp_path) == whole


def test_shards_merged(manifest, whole, tmp_path):
    for shard in range(4):
        command("batch", manifest, "--out", tmp_path, "--shard", f"{shard}/4", status=3 if shard == 1 else 0)
        assert not (tmp_path / "manifest-status.csv").exists()
    for _ in range(2):
        command("batch", manifest, "--out", tmp_path, "--merge", status=3)
        assert tree(tmp_path) == whole
    command("batch", manifest, "--out", tmp_path, "--shard", "4/4", status=2)


def test_a_changed_input_is_solved_anew(manifest, tmp_path):
    folder = tmp_path / "archive"
    folder.mkdir()
    for source in (manifest.parent / "day0").iterdir():
        (folder / source.name).write_bytes(source.read_bytes())
    (folder / "manifest.csv").write_text("label,config\none,kurs.toml\n")
    out = tmp_path / "out"
    summary = out / "session=one/summary.json"
    command("batch", folder / "manifest.csv", "--out", out)
    first = json.loads(summary.read_text())
    observations = next(path for path in sorted(folder.glob("*.rnx")) if "OBSERVATION DATA" in path.read_text()[:100])
    text = observations.read_text()
    observations.write_text(text.replace("END OF HEADER", "END OF HEADER", 1) + "")
    command("batch", folder / "manifest.csv", "--out", out)
    assert json.loads(summary.read_text())["wall_s"] == first["wall_s"], "same content"
    observations.write_text(text[: text.rindex("\n>") + 1])
    command("batch", folder / "manifest.csv", "--out", out)
    second = json.loads(summary.read_text())
    assert second["configuration_hash"] != first["configuration_hash"]
    # Without its files nothing of an older result stays.
    observations.unlink()
    command("batch", folder / "manifest.csv", "--out", out, status=1)
    assert [path.name for path in (out / "session=one").iterdir()] == ["failure.json"]


@pytest.mark.parametrize("kind", ["none", "threads", "processes", "dask"])
def test_any_executor(manifest, whole, tmp_path, kind):
    if kind == "none":
        table = batch.run(manifest, out=tmp_path, jobs=2)
    elif kind == "dask":
        from distributed import Client, LocalCluster

        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
            table = batch.run(manifest, out=tmp_path, executor=client.get_executor())
    else:
        pool = ThreadPoolExecutor if kind == "threads" else ProcessPoolExecutor
        with pool(2) as executor:
            table = batch.run(manifest, out=tmp_path, executor=executor)
    assert tree(tmp_path) == whole
    assert table["status"].tolist().count("done") == SESSIONS - 2


def test_parquet_is_one_data_set(manifest, tmp_path):
    import pyarrow.dataset as ds

    with ThreadPoolExecutor(2) as executor:
        batch.run(manifest, out=tmp_path, executor=executor, format="parquet")
    files = sorted(str(path) for path in tmp_path.glob("session=*/attitude.parquet"))
    data = ds.dataset(files, partitioning=ds.partitioning(flavor="hive"), partition_base_dir=str(tmp_path))
    rows = data.to_table(columns=["session", "status", "heading_deg"])
    assert len(set(rows["session"].to_pylist())) == SESSIONS - 1 and rows.num_rows > 400
    # The program in the wheel does not write it itself, and says what would.
    done = subprocess.run([KURS, "batch", manifest, "--out", tmp_path / "rust", "--format", "parquet"], capture_output=True, text=True)
    assert done.returncode == 2 and "feature `parquet`" in done.stderr and not (tmp_path / "rust").exists()


def test_files_of_other_file_systems(manifest, tmp_path):
    fsspec = pytest.importorskip("fsspec")
    memory = fsspec.filesystem("memory")
    folder = manifest.parent / "day0"
    observations = sorted(folder.glob("*.rnx"))
    for path in observations:
        memory.pipe_file(f"/archive/{path.name}", path.read_bytes())
    (tmp_path / "manifest.csv").write_text(
        "label,files\none,{}\n".format("; ".join(f"memory://archive/{path.name}" for path in observations))
    )
    table = batch.run(tmp_path / "manifest.csv", out=tmp_path / "out")
    assert table["status"].tolist() == ["done"]


@pytest.mark.parametrize("has_executor", [False, True])
def test_manifests_that_spreadsheets_write(manifest, tmp_path, has_executor):
    path = tmp_path / "manifest.csv"
    config = manifest.parent / "day0/kurs.toml"

    def run(content, encoding="utf-8"):
        path.write_text(content, encoding=encoding)
        if has_executor:
            with ThreadPoolExecutor(1) as executor:
                return batch.run(path, out=tmp_path / "out", executor=executor)
        return batch.run(path, out=tmp_path / "out")

    assert run(f"label,config\none,{config}\n", "utf-8-sig")["status"].tolist() == ["done"]
    assert run(f'# days\nlabel,config\n"two\n#lines",{config}\n\n')["label"].tolist() == ["two\n#lines"]
    with pytest.raises(kurs.UsageError, match="manifest.csv: session 2 has 3 fields, expected 2 as in the header"):
        run(f"label,config\none,{config}\ntwo,{config},\n")
    with pytest.raises(kurs.UsageError, match="manifest.csv: not UTF-8: "):
        run(f"label,config\nMünchen,{config}\n", "latin-1")
    for content in ("", "config\na.toml\n", "label,config\n"):
        with pytest.raises(kurs.UsageError, match="manifest.csv: no sessions with a `label`"):
            run(content)


def test_monte_carlo_of_two_configurations_are_two_results(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    short, long = (batch.monte_carlo("roof-static", 1, duration_s=duration_s) for duration_s in (3, 5))
    assert short.summary(0)["epochs"] < long.summary(0)["epochs"]
    assert short.attitude(0).rows < long.attitude(0).rows
    made = (short.folder / "run=000000/run.json").stat().st_mtime_ns
    again = batch.monte_carlo("roof-static", 1, duration_s=3)
    assert again.folder == short.folder and (again.folder / "run=000000/run.json").stat().st_mtime_ns == made


RECORDED = """
seed = 5
start = "2024-03-09T12:00:00"
duration_s = 5.0
interval_s = 1.0
signals = ["G1C", "E1C"]
[sky]
navigation = "nav.rnx"
[[body]]
name = "car"
motion = { kind = "recorded", file = "motion.csv" }
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "A1"
position_m = [1.2, 0.0, 0.0]
"""


def test_paths_of_scenarios_start_where_they_are_written(tmp_path, monkeypatch):
    folder = tmp_path / "scenario"
    made = kurs.simulate("roof-static", tmp_path / "sky", start="2024-03-09T12:00:00", duration_s=5).parent
    folder.mkdir()
    (nav,) = (made / name for name in tomllib.loads((made / "kurs.toml").read_text())["nav"]["files"])
    (folder / "nav.rnx").write_bytes(nav.read_bytes())
    head = "time_s,latitude_deg,longitude_deg,height_m,heading_deg,pitch_deg,roll_deg"
    rows = [f"{second},55.75,37.62,200,{second},0,0" for second in range(-2, 9)]
    (folder / "motion.csv").write_text("\n".join([head, *rows, ""]))
    (folder / "scenario.toml").write_text(RECORDED)
    monkeypatch.chdir(tmp_path)
    kurs.simulate("scenario/scenario.toml", "of_file")
    runs = batch.monte_carlo("scenario/scenario.toml", 1)
    assert runs.attitude(0).rows > 0
    assert batch.monte_carlo("scenario/scenario.toml", 1, sky__navigation="nav.rnx").attitude(0).rows > 0
    monkeypatch.chdir(folder)
    tables = tomllib.loads(RECORDED)
    found = kurs.simulate(tables, tmp_path / "of_tables")
    observations = sorted(path.name for path in found.parent.glob("*.rnx"))
    assert observations
    for name in observations:
        assert (found.parent / name).read_bytes() == (tmp_path / "of_file" / name).read_bytes()
    # An override of a dictionary is where its paths are.
    del tables["sky"]["navigation"]
    kurs.simulate(tables, tmp_path / "of_override", sky__navigation="nav.rnx")
    assert batch.monte_carlo(tables, 1, out=tmp_path / "mc", sky__navigation="nav.rnx").attitude(0).rows > 0


def test_monte_carlo(tmp_path):
    tables = []
    for place, executor in (("a", None), ("b", ProcessPoolExecutor(2))):
        runs = batch.monte_carlo("roof-static", 3, out=tmp_path / place, executor=executor, duration_s=10)
        tables.append([runs.attitude(k)["heading_deg"] for k in range(len(runs))])
        assert len({runs.summary(k)["seed"] for k in range(3)}) == 3
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(*tables, strict=True))
    assert not np.array_equal(tables[0][0], tables[0][1], equal_nan=True)
    assert batch.seed_of("x", 1) == batch.seed_of("x", 1) != batch.seed_of("x", 2)
    with pytest.raises(ValueError, match="runs is -1, expected 0 or more"):
        batch.monte_carlo("roof-static", -1, out=tmp_path)


def test_ctrl_c_in_python_ends_a_run(manifest, tmp_path):
    """KeyboardInterrupt in the caller, and the module works on afterwards."""
    code = f"""
import os, signal, threading, kurs
# Shells start what runs behind them with the signal ignored, and Python keeps it so.
signal.signal(signal.SIGINT, signal.default_int_handler)
ended = threading.Event()
def press():
    # Python itself forgets an interrupt that comes in a finalizer: whoever sees no end presses again.
    while not ended.wait(0.3):
        os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=press, daemon=True).start()
try:
    kurs.solve({str(manifest.parent / 'day0/kurs.toml')!r}) and [kurs.solve({str(manifest.parent / 'day0/kurs.toml')!r}) for _ in range(1000)]
except KeyboardInterrupt:
    ended.set()
    print("ended", kurs.solve({str(manifest.parent / 'day0/kurs.toml')!r}).summary["interrupted"])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "ended False\n", done.stderr


def test_ctrl_c_leaves_no_short_solution_in_another_thread(manifest):
    code = f"""
import os, signal, sys, threading, kurs
# A Ctrl-C that meets Python as it removes a folder is lost there; the next one is heard.
sys.unraisablehook = lambda lost: lost.exc_type is KeyboardInterrupt or sys.__unraisablehook__(lost)
signal.signal(signal.SIGINT, signal.default_int_handler)
config = {str(manifest.parent / 'day0/kurs.toml')!r}
epochs = [kurs.solve(config).summary["epochs"]]
ended = threading.Event()
def press():
    while not ended.wait(0.3):
        os.kill(os.getpid(), signal.SIGINT)
def other():
    try:
        while not ended.is_set():
            epochs.append(kurs.solve(config).summary["epochs"])
    except KeyboardInterrupt as error:
        assert "in the main thread" in str(error)
thread = threading.Thread(target=other)
thread.start()
threading.Thread(target=press, daemon=True).start()
try:
    while True:
        kurs.solve(config)
except KeyboardInterrupt:
    ended.set()
thread.join()
print(len(set(epochs)))
"""
    for _ in range(3):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert done.stdout == "1\n" and not done.stderr, done.stderr
