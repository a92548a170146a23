# `just` shows the recipes; .ci/run calls the same commands.

default:
    @just --list

# everything that must hold before a change lands
check: fmt-check lint docs test

fmt-check:
    cargo fmt --all -- --check

lint:
    cargo clippy --workspace --all-targets -- -D warnings

docs:
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps

test:
    cargo test --workspace

# the Python module: wheel, fresh environment, tests
python:
    tests/python/run

# Kurs beside what others use for the same work (bench/versus/install gets the others)
compare *options:
    bench/versus/run {{options}}

bench:
    cargo bench --workspace

# instructions of two small sessions, beside their record
instructions:
    cargo build --release
    bench/instructions.sh

# cost against size, and the whole program: docs/experiments/speed.md
speed:
    cargo build --release
    bench/speed.py

# the figures of the documentation about attitude and baselines
figures:
    bench/attitude.sh > docs/experiments/attitude_methods.md
    cargo run --release -p kurs --example selection_experiments > docs/experiments/selection.md

# the book: contents, links, every command of it
book:
    cargo build --release
    tests/book/run

deny:
    cargo deny check licenses bans sources

# everything that is handed out, made and checked (docs/release.md)
release-check *options:
    release/check {{options}}
