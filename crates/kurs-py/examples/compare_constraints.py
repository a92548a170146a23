"""What the known array is worth: single epochs of one frequency between houses, with and without it in the integer search.

The same in Rust: `cargo run --release -p kurs-py --example twins compare_constraints`.
"""

import tempfile

import kurs

with tempfile.TemporaryDirectory() as folder:
    config = kurs.simulate("roof-static", folder, duration_s=30)
    for constraint in ("none", "length", "array"):
        solution = kurs.solve(config, constraint=constraint, bands=["G1", "E1"], elevation_mask_deg=25)
        counts = solution.summary
        print(f"{constraint}: {counts['fixed']} of {counts['epochs']} epochs fixed")

#> none: 47 of 61 epochs fixed
#> length: 56 of 61 epochs fixed
#> array: 59 of 61 epochs fixed
