"""An array on paper: how accurate a square of one metre is, and which baselines to process.

The same in Rust: `cargo run --release -p kurs-py --example twins plan_an_array`.
"""

import kurs
import numpy as np

places = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
pairs, value, bound = kurs.selection.select(places, graph="tree", criterion="trace_of_covariance")
print(f"baselines {pairs}, criterion {value:.3f}")

antennas = [{"name": f"A{number}", "position_m": place} for number, place in enumerate(places)]
plan = kurs.plan({"antenna": antennas}, at="2024-06-24T00:00:00", duration="6h")
headings = [epoch["heading_sd_deg"] for epoch in plan["epochs"] if epoch["heading_sd_deg"] is not None]
print(f"heading to {max(headings):.3f} degrees or better in {len(headings)} epochs")

#> baselines [(0, 2), (0, 3), (1, 3)], criterion 1.033
#> heading to 0.138 degrees or better in 73 epochs
