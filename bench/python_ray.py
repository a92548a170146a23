"""Sessions of a manifest on Ray: the same rows as with threads in Rust (`pip install ray`; bench/python_ray.py).

Without a cluster Ray asks its own processes for a token: RAY_AUTH_MODE=disabled for a run on one machine.
"""

import os
import tempfile
import time
from pathlib import Path

import kurs
from kurs import batch

os.environ.setdefault("RAY_AUTH_MODE", "disabled")
import ray

SESSIONS = 6

with tempfile.TemporaryDirectory() as folder:
    work = Path(folder)
    for day in range(2):
        kurs.simulate("roof-static", work / f"day{day}", seed=day + 1, duration_s=20)
    rows = [f"s{k},day{k % 2}/kurs.toml,elevation_mask_deg={10 + k}" for k in range(SESSIONS)]
    (work / "m.csv").write_text("\n".join(["label,config,set", *rows]) + "\n")

    start = time.perf_counter()
    ray.init(num_cpus=2, object_store_memory=80_000_000, include_dashboard=False, log_to_driver=False)
    print(f"Ray started in {time.perf_counter() - start:.1f} s")
    start = time.perf_counter()
    table = batch.run(work / "m.csv", out=work / "ray", executor=batch.RayExecutor(num_cpus=1))
    print(f"{(table['status'] == 'done').sum()} of {SESSIONS} sessions done in {time.perf_counter() - start:.1f} s")
    ray.shutdown()

    batch.run(work / "m.csv", out=work / "threads")
    files = [f"session=s{k}/attitude.csv" for k in range(SESSIONS)]
    print("same rows:", all((work / "ray" / f).read_bytes() == (work / "threads" / f).read_bytes() for f in files))
