"""What the Python module costs and saves: bench/python.py (in an environment with kurs, georinex, scipy).

Prints a line for each figure; with names of functions below, only those.
KURS_DATA: folder of the recordings (default ../shared/data).
"""

import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import kurs
import numpy as np

DATA = Path(os.environ.get("KURS_DATA", Path(__file__).parents[1] / "../shared/data"))


def spent_s(call, repeat=5):
    """Processor time of a call, s: the least of some."""
    spent = []
    for _ in range(repeat):
        start = time.process_time()
        call()
        spent.append(time.process_time() - start)
    return min(spent)


def overhead():
    """A call less what it costs in Rust, which is the share of one problem in a call of many on one thread."""
    random = np.random.default_rng(1)
    body = random.normal(size=(3, 3))
    local = body @ np.linalg.qr(random.normal(size=(3, 3)))[0].T
    root = random.normal(size=(6, 6))
    a, Q = random.normal(scale=3, size=6), 0.02 * root @ root.T + 0.01 * np.eye(6)
    for name, function, arguments in (
        ("wahba", kurs.attitude.wahba, (body, local)),
        ("lambda_", kurs.ambiguity.lambda_, (a, Q)),
    ):
        many = [np.broadcast_to(array, (100_000, *array.shape)).copy() for array in arguments]
        inside = 1e4 * spent_s(lambda: function(*many))
        whole = 1e4 * spent_s(lambda: [function(*arguments) for _ in range(100_000)][:0])
        print(f"{name}: {whole:.0f} ns a call, {inside:.0f} ns of it in Rust, overhead {whole - inside:.0f} ns")
    print(f"a call without arrays: {1e4 * spent_s(lambda: [kurs._version() for _ in range(100_000)]):.0f} ns")


def many_attitudes():
    random = np.random.default_rng(1)
    body = np.array([[0.766, 0, -0.03], [0.019, -0.491, -0.001], [-0.02, 0.488, 0.007]])
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    local = body @ turn.T + random.normal(scale=0.003, size=(1_000_000, 3, 3))
    start = time.perf_counter()
    spent = spent_s(lambda: kurs.attitude.weighted(body, local, np.diag([4e-6, 4e-6, 16e-6])), repeat=1)
    print(f"1e6 weighted attitudes in one call: {time.perf_counter() - start:.2f} s, {spent:.2f} s of processors")


def reading():
    file = DATA / "matrtklib_static/rover.obs"
    if not file.exists():
        print(f"skipped: no {file}")
        return
    ours = spent_s(lambda: kurs.read_obs(file))
    grid = spent_s(lambda: kurs.read_obs(file).to_xarray(), repeat=3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import georinex

        found = []
        theirs = spent_s(lambda: found.append(georinex.load(file)), repeat=1)
    compare_whole(kurs.read_obs(file).to_xarray(), found[0])
    size = file.stat().st_size / 1e6
    print(f"read_obs of {size:.1f} MB: {ours:.3f} s, as xarray {grid:.3f} s, georinex {theirs:.1f} s ({theirs / ours:.0f} times)")


def compare_whole(ours, theirs):
    """Every satellite, epoch and signal of either: counts of values that both have and are equal, differ, or one alone has."""
    names = [name for name in theirs.data_vars if len(name) == 3 and name[0] in "CLDS"]
    print(f"epochs {ours.sizes['time']} and {theirs.sizes['time']}, satellites {ours.sizes['sv']} and {theirs.sizes['sv']} (kurs and georinex)")
    alike, different, only = 0, 0, {"kurs": 0, "georinex": 0}
    times, satellites = np.union1d(ours.time, theirs.time), np.union1d(ours.sv, theirs.sv)
    for name in sorted({*names, *(n for n in ours.data_vars if len(n) == 3 and n[0] in "CLDS")}):
        grids = [
            (table[name] if name in table else table[names[0]] * np.nan).reindex(time=times, sv=satellites).values
            for table in (ours, theirs)
        ]
        has = [~np.isnan(grid) for grid in grids]
        alike += np.count_nonzero(grids[0] == grids[1])
        different += np.count_nonzero(has[0] & has[1] & (grids[0] != grids[1]))
        only["kurs"] += np.count_nonzero(has[0] & ~has[1])
        only["georinex"] += np.count_nonzero(has[1] & ~has[0])
    print(f"{alike} values alike, {different} different, {only['kurs']} only by kurs, {only['georinex']} only by georinex")


def memory_of_a_large_file():
    """Peak of a process that reads 100 MB, beside the size of its table."""
    source = DATA / "matrtklib_static/rover.obs"
    if not source.exists():
        return
    with tempfile.TemporaryDirectory() as folder:
        large = Path(folder) / "large.obs"
        head, _, body = source.read_text().partition("END OF HEADER")
        first_line, _, epochs = body.partition("\n")
        with large.open("w") as file:
            file.write(head + "END OF HEADER" + first_line + "\n")
            # The same epochs at later hours of the day.
            for shift in range(int(100e6 / len(epochs)) + 1):
                file.write(shifted(epochs, shift))
        code = (
            "import kurs, re, time; start = time.perf_counter(); "
            "kb = lambda key: int(re.search(key + r':\\s+(\\d+)', open('/proc/self/status').read())[1]); "
            "open('/proc/self/clear_refs', 'w').write('5'); base = kb('VmRSS'); "
            f"table = kurs.read_obs({str(large)!r}); "
            "peak = kb('VmHWM') - base; "
            "size = sum(c[0].nbytes if isinstance(c, tuple) else c.nbytes for c in table._columns.values()) / 1e6; "
            "print(f'{table.rows} rows, {time.perf_counter() - start:.2f} s, peak {peak / 1024:.0f} MB, table {size:.0f} MB')"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        print(f"read_obs of {large.stat().st_size / 1e6:.0f} MB: {done.stdout.strip()}")


def shifted(epochs, days):
    """Epoch lines on a later day of the month."""
    lines = []
    for line in epochs.splitlines(keepends=True):
        if line.startswith(">"):
            year, month, day, rest = line[2:6], line[7:9], int(line[10:12]), line[12:]
            later = np.datetime64(f"{year}-{month}-{day:02}") + days
            year, month, day = str(later).split("-")
            line = f"> {year} {month} {day}{rest}"
        lines.append(line)
    return "".join(lines)


def batch():
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        rows = ["label,config,set"]
        for day in range(4):
            kurs.simulate("roof-static", folder / f"day{day}", seed=day + 1)
        rows += [f"s{k},day{k % 4}/kurs.toml,elevation_mask_deg={10 + k // 4}" for k in range(16)]
        (folder / "m.csv").write_text("\n".join(rows) + "\n")
        spent = {}
        for jobs in (1, 2):
            start = time.perf_counter()
            kurs.batch.run(folder / "m.csv", out=folder / f"out{jobs}", jobs=jobs)
            spent[jobs] = time.perf_counter() - start
        print(f"batch of 16 sessions: {spent[1]:.1f} s by one, {spent[2]:.1f} s by two ({spent[1] / spent[2]:.2f} times)")


if __name__ == "__main__":
    for figure in (overhead, many_attitudes, reading, memory_of_a_large_file, batch):
        if len(sys.argv) > 1 and figure.__name__ not in sys.argv[1:]:
            continue
        if figure is overhead and os.environ.get("RAYON_NUM_THREADS") != "1":
            subprocess.run([sys.executable, __file__, "overhead"], env={**os.environ, "RAYON_NUM_THREADS": "1"}, check=True)
        else:
            figure()
