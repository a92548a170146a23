"""A first heading: a roof with four antennas, simulated and solved.

`ned_from_body`: heading clockwise from north, pitch nose up.
The same in Rust: `cargo run --release -p kurs-py --example twins first_heading`.
"""

import tempfile

import kurs
import numpy as np

with tempfile.TemporaryDirectory() as folder:
    config = kurs.simulate("roof-static", folder, duration_s=30)
    solution = kurs.solve(config)

rows = solution.attitude
fixed = rows["status"] == "fixed"
print(f"{fixed.sum()} of {rows.rows} epochs fixed")
print(f"heading {np.mean(rows['heading_deg'][fixed]):.1f}, pitch {np.mean(rows['pitch_deg'][fixed]):.1f} degrees")

#> 61 of 61 epochs fixed
#> heading 35.0, pitch 2.0 degrees
