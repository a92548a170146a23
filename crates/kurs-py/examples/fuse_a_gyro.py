"""A car that has no satellites for ten seconds: attitudes of its antennas, and the same carried on by a gyro.

The same in Rust: `cargo run --release -p kurs-py --example twins fuse_a_gyro`.
"""

import tempfile
from pathlib import Path

import kurs
import numpy as np

scenario = Path(__file__).parents[3] / "examples/fuse" / "car-with-gyro.toml"
with tempfile.TemporaryDirectory() as folder:
    config = kurs.simulate(scenario, folder, duration_s=75, interval_s=0.2)
    solved = kurs.solve(config, out=Path(folder) / "solved").attitude
    fused = kurs.fusion.fuse(Path(folder) / "fuse.toml").table("attitude")

for name, table in (("antennas", solved), ("with gyro", fused)):
    print(f"{name}: {np.count_nonzero(~np.isnan(table['heading_deg']))} headings")

#> antennas: 326 headings
#> with gyro: 376 headings
