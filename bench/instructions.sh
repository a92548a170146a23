#!/usr/bin/env bash
# Instructions that two small simulated sessions take, beside those recorded in instructions.txt: unlike times they do not
# depend on what else the machine does.
#
#   bench/instructions.sh [--record]        (needs valgrind, from Debian's package of that name)
#
# Fails if a session takes more than 5 % over its record. --record writes new records, as is due after a change of the
# compiler, of the simulation or of what the engine does. Programs are counted as the machine runs them: one without
# AVX2 and FMA takes more, and is skipped. Records are of the release profile as Cargo.toml has it: without its link-time
# optimisation programs take a quarter more. KURS: program (default release build). Without valgrind the check is
# skipped, with KURS_REQUIRE_TOOLS=1 it fails.
set -euo pipefail
cd "$(dirname "$0")/.."
source tests/lacking.sh
kurs=${KURS:-target/release/kurs}
records=bench/instructions.txt
if ! command -v valgrind >/dev/null; then
    lacking "no valgrind (apt-get install valgrind)"
    exit
fi
if ! grep -qw avx2 /proc/cpuinfo || ! grep -qw fma /proc/cpuinfo; then
    echo "skipped: the records are of processors with AVX2 and FMA"
    exit
fi
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT

# Name, scenario, seconds of it, arguments of `kurs solve`.
count() {
    local name=$1 scenario=$2 seconds=$3; shift 3
    "$kurs" simulate --quiet "$scenario" --set "duration_s=$seconds" --out "$work/$name"
    valgrind --tool=callgrind --callgrind-out-file=/dev/null "$kurs" solve --quiet --require-fix 0 "$@" \
        --set ambiguity=instantaneous --out "$work/$name/out" "$work/$name/kurs.toml" 2>"$work/log"
    echo "$name $(sed -n 's/^.*Collected : *//p' "$work/log")"
}

{
    count two-antennas street 60 --set "constraint=length"
    count four-antennas car 5 --set "constraint=none"
} >"$work/counts"

if [ "${1:-}" = --record ]; then
    cp "$work/counts" "$records"
    cat "$records"
    exit
fi
awk '
    NR == FNR { record[$1] = $2; next }
    !($1 in record) { print $1 ": nothing is recorded"; bad = 1; next }
    {
        more = 100 * ($2 / record[$1] - 1)
        printf "%-14s %12d instructions, recorded %12d: %+.1f %%\n", $1, $2, record[$1], more
        if (more > 5) { print "  more than 5 % over the record"; bad = 1 }
        if (more < -5) print "  far below the record: bench/instructions.sh --record"
    }
    END { exit bad }
' "$records" "$work/counts"
