#!/usr/bin/env bash
# Whole-program comparison with RTKLIB's rnx2rtkp on the same files and bands, run in turn.
# Prints fix rates, mean baselines, and for each pair the ratio of processor times (user + system).
#
#   bench/against_rtklib.sh [RUNS]        (default 5; needs rnx2rtkp, from Debian's package rtklib)
#
# KURS_DATA: folder of the recordings (default ../shared/data). KURS: program (default release build).
set -euo pipefail
cd "$(dirname "$0")/.."
source tests/lacking.sh
runs=${1:-5}
data=${KURS_DATA:-../shared/data}
kurs=${KURS:-target/release/kurs}
command -v rnx2rtkp >/dev/null || { lacking "no rnx2rtkp (apt-get install rtklib)"; exit 0; }
[ -d "$data" ] || { echo "skipped: no recordings in $data"; exit 0; }
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT

# Processor seconds of one command, its output thrown away.
seconds() { { TIMEFORMAT='%3U %3S'; time "$@" >/dev/null 2>&1; } 2>&1 | tail -1 | awk '{print $1 + $2}'; }

row() { # name, base, rover, nav, bands, RTKLIB configuration
    local base=$data/$2 rover=$data/$3 nav=$data/$4 conf=$data/rtklib_conf/$6.conf
    local ours=("$kurs" solve --quiet --require-fix 0 --antenna "base=$base" --antenna "rover=$rover" --nav "$nav"
        --set elevation_mask_deg=15 --set "bands=[$5]" --out "$work/out")
    local theirs=(rnx2rtkp -k "$conf" -o "$work/out.pos" "$rover" "$base" "$nav")
    seconds "${ours[@]}" >/dev/null; seconds "${theirs[@]}" >/dev/null
    for _ in $(seq "$runs"); do
        echo "$(seconds "${ours[@]}") $(seconds "${theirs[@]}")"
    done | sort -g -k1 > "$work/times"
    local memory; memory=$(/usr/bin/time -f %M "${ours[@]}" 2>&1 >/dev/null | tail -1)
    python3 - "$1" "$5" "$work" "$memory" <<'PY'
import csv, statistics, sys
name, bands, work, memory = sys.argv[1:]
pairs = [tuple(map(float, line.split())) for line in open(f"{work}/times")]
rows = list(csv.DictReader(open(f"{work}/out/attitude.csv")))
baselines = [r for r in csv.DictReader(open(f"{work}/out/baselines.csv")) if r["status"] == "fixed"]
fixed = 100 * sum(r["status"] == "fixed" for r in rows) / len(rows)
theirs = [l.split() for l in open(f"{work}/out.pos") if not l.startswith("%")]
q1 = [l for l in theirs if l[5] == "1"]
def spread(values):
    return f"{statistics.mean(values):10.4f} ± {statistics.pstdev(values):6.4f}" if values else "-"
length = [float(r["length_m"]) for r in baselines]
other = [sum(float(c) ** 2 for c in l[2:5]) ** 0.5 for l in q1]
ours_s, theirs_s = (statistics.median(p[i] for p in pairs) for i in (0, 1))
ratio = statistics.median(t / max(o, 1e-3) for o, t in pairs)
print(f"{name:10} {bands:18} kurs {fixed:6.2f} % {spread(length)} m {ours_s:7.3f} s {int(memory)//1024:3} MB | "
      f"rtklib {100 * len(q1) / len(rows):6.2f} % {spread(other)} m {theirs_s:7.3f} s | {ratio:5.1f} times faster")
PY
}

m=matrtklib_static; u=upc2011; g=geonet2005
row matrtklib "$m/base.obs" "$m/rover.obs" "$m/base.nav" G1 mb_instantaneous_L1_G
row matrtklib "$m/base.obs" "$m/rover.obs" "$m/base.nav" G1,G2 mb_instantaneous_L1L2_G
row matrtklib "$m/base.obs" "$m/rover.obs" "$m/base.nav" G1,E1,C2 mb_instantaneous_L1_GEC
row matrtklib "$m/base.obs" "$m/rover.obs" "$m/base.nav" G1,G2,E1,E5,C2,C7 mb_instantaneous_L1L2_GEC
row upc2011 "$u/UPC10770.11o" "$u/UPC20770.11o" "$u/brdc0770.11n" G1,G2 mb_instantaneous_L1L2_G
row geonet2005 "$g/07590920.05o" "$g/30400920.05o" "$g/30400920.05n" G1,G2 mb_instantaneous_L1L2_G
# One band over kilometres: here RTKLIB fixes what Kurs is not sure of.
row geonet2005 "$g/07590920.05o" "$g/30400920.05o" "$g/30400920.05n" G1 mb_instantaneous_L1_G
