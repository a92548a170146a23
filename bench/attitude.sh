#!/usr/bin/env bash
# Prints docs/experiments/attitude_methods.md: every figure that the attitude methods, kurs orient and the
# choice of baselines are asked for, next to what this machine measures.
#
#     bench/attitude.sh > docs/experiments/attitude_methods.md
#
# Ten minutes on an idle machine. Costs are medians of one run; compare them with each other.
set -euo pipefail
cd "$(dirname "$0")/.."

quietly() { "$@" 2>/dev/null; }

cat <<'END'
# Attitude: figures

Printed by `bench/attitude.sh`; seeds are in the sources.

## Does Newton's method reach the global minimum?

Asked: 99.9 % of 10 000 problems at each noise level, all with the search; 4.5 steps in the mean. The first column
of shares starts at Wahba's solution and nowhere else; the second one, `AttitudeProblem::minimum`, goes on from the
mirror image where the certificate does not prove the first minimum; its misses are listed by number. 5 to 14
satellites, single differences of 0.02 to 0.07 cycles times the noise factor; the referee starts from 60 random
attitudes. `cargo run --release -p kurs --example attitude_study -- minima`

END
quietly cargo run --release -q -p kurs --example attitude_study -- minima

cat <<'END'

## The published continuation against Newton's method

200 skies, roof array, error to the exact minimum. `cargo run --release -p kurs --example attitude_study -- continuation`

END
quietly cargo run --release -q -p kurs --example attitude_study -- continuation

cat <<'END'

## Cost

Three baselines, twelve satellites on two bands; median of one run of `cargo bench -p kurs --bench attitude`.

| step | asked, µs | measured, µs |
|---|---|---|
END
quietly cargo bench -p kurs --bench attitude | awk '
    # divan: name, fastest, slowest, median, …; every line is a hundred calls
    /─ / {
        sub(/^.*─ /, ""); name = $1; split($0, field, "│"); split(field[3], median, " ")
        unit = median[2] == "ns" ? 1e-3 : median[2] == "µs" ? 1 : median[2] == "ms" ? 1e3 : 1e6
        us[name] = median[1] * unit / 100
    }
    function row(what, asked, name) { printf "| %s | %s | %.2f |\n", what, asked, us[name] }
    END {
        row("reduction", "≤ 1", "reduction")
        row("Newton from a known start", "≤ 2", "newton_from_wahba")
        row("Wahba's start, Newton", "≤ 4", "wahba_and_newton")
        row("the same with the wanted margin proven", "", "with_certificate")
        row("search all around", "", "search_for_a_second_minimum")
        row("baselines with their full covariance (9×9)", "", "joint_form")
        row("least squares and SVD", "", "least_squares_and_svd")
        ratio = us["published_two_steps"] / us["least_squares_and_svd"]
        printf "| published method, two steps | ≤ 1.5 × least squares and SVD | %.2f (× %.2f) |\n", \
            us["published_two_steps"], ratio
    }'

cat <<'END'

## Against scipy

Asked: 100 times faster than `Rotation.align_vectors` called once per epoch, the same answer. `bench/versus/run --parts wahba`

END
bench/versus/run --parts wahba | grep '^|'

cat <<'END'

## `kurs orient`

100 000 epochs, antennas on the corners of a square of 0.8 m, 1 cm level and 2 cm vertical, one epoch in fifty with an
antenna displaced by 0.3 m, the fourth antenna missing a third of the time; file to files through the program.
`cargo test --release -p kurs-cli --test commands orient -- --ignored --nocapture`

END
quietly cargo test --release -q -p kurs-cli --test commands orient -- --ignored --nocapture | grep '^|'
