#!/bin/sh
# Which changes of the engine its tests notice (cargo install cargo-mutants).
#
#   bench/mutants.sh all            every mutant of acceptance, velocity and the matcher
#   bench/mutants.sh sample [K/N]   every N-th one, from the K-th on, of the engine, the differences and the float solution (0/9)
#   bench/mutants.sh solvers [K/N]  the same of the integer searches and the attitude (0/36)
#
# Survivors stand in target/mutants.out/missed.txt.
set -eu
cd "$(dirname "$0")/.."
src=crates/kurs/src

# Unoptimised but for what it depends on, so that a mutant is built in some seconds; without the tests that take minutes so.
opt=0
programs="-C=--lib -C=--test=engine"
tests="difference:: engine:: float_solution frozen:: left_out:: matcher:: recorded:: rows:: velocity"
case "${1:-all}" in
all)
    set -- --file "$src/engine/acceptance.rs" --file "$src/point/velocity.rs" --file "$src/observation/matcher.rs"
    ;;
sample)
    set -- --file "$src/engine/*.rs" --file "$src/difference/*.rs" --file "$src/float_solution.rs" --file "$src/float_solution/*.rs" \
        --exclude "$src/engine/acceptance.rs" --shard "${2:-0/9}" --sharding round-robin
    ;;
solvers)
    set -- --file "$src/ambiguity/*.rs" --file "$src/attitude/*.rs" --exclude "$src/ambiguity/problems.rs" \
        --shard "${2:-0/36}" --sharding round-robin
    opt=1 # unoptimised these tests take three minutes, so five seconds
    programs="$programs -C=--test=methods -C=--test=vectors"
    tests="ambiguity:: attitude frozen:: every_case"
    export KURS_VECTORS="${KURS_VECTORS:-$PWD/../shared/vectors}" # mutants live in a copy elsewhere
    ;;
*)
    echo "usage: $0 all | sample [K/N] | solvers [K/N]" >&2
    exit 2
    ;;
esac

# A mutant that asks for memory without end ends alone, kB.
ulimit -v 12000000
CARGO_PROFILE_TEST_OPT_LEVEL=$opt CARGO_PROFILE_TEST_DEBUG=0 \
    cargo mutants -p kurs --jobs 1 --timeout 60 --output target '-C=--config=profile.test.package."*".opt-level=2' \
    $programs "$@" -- -- $tests
