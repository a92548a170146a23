#!/usr/bin/env bash
# Whole-program comparison with RTKLIB's rnx2rtkp on the same files and bands, run in turn: a table in Markdown of the
# fixed epochs, the baseline's length, and the processor time (user + system) of all runs together.
#
#   bench/against_rtklib.sh [RUNS]        (default 20; needs rnx2rtkp and convbin, from Debian's package rtklib)
#
# KURS_DATA: folder of the recordings (default ../shared/data). KURS: program (default release build).
set -euo pipefail
cd "$(dirname "$0")/.."
source tests/lacking.sh
runs=${1:-20}
data=${KURS_DATA:-../shared/data}
kurs=${KURS:-target/release/kurs}
command -v rnx2rtkp >/dev/null || { lacking "no rnx2rtkp (apt-get install rtklib)"; exit 0; }
[ -d "$data" ] || { echo "skipped: no recordings in $data"; exit 0; }
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT

# Processor seconds of one command, its output thrown away.
seconds() { { TIMEFORMAT='%3U %3S'; time "$@" >/dev/null 2>&1; } 2>&1 | tail -1 | awk '{print $1 + $2}'; }

row() { # name, base, rover, navigation, bands, systems and bands in RTKLIB's words, ambiguity
    local name=$1 base=$2 rover=$3 nav=$4 bands=$5 conf=$work/rtklib.conf ambiguity=$7
    sed "s/^pos1-navsys.*/pos1-navsys=${8:-$(sed -n 's/^pos1-navsys *= *//p' "$data/rtklib_conf/mb_${ambiguity}_$6.conf")}/" \
        "$data/rtklib_conf/mb_${ambiguity}_$6.conf" >"$conf"
    local ours=("$kurs" solve --quiet --require-fix 0 --antenna "base=$base" --antenna "rover=$rover" --nav "$nav"
        --set elevation_mask_deg=15 --set "bands=[$bands]" --set "ambiguity=$ambiguity" --out "$work/out")
    local theirs=(rnx2rtkp -k "$conf" -o "$work/out.pos" "$rover" "$base" "$nav")
    seconds "${ours[@]}" >/dev/null; seconds "${theirs[@]}" >/dev/null
    for _ in $(seq "$runs"); do
        echo "$(seconds "${ours[@]}") $(seconds "${theirs[@]}")"
    done >"$work/times"
    python3 - "$name" "$bands" "$ambiguity" "$work" <<'PY'
import csv, statistics, sys
name, bands, ambiguity, work = sys.argv[1:]
pairs = [tuple(map(float, line.split())) for line in open(f"{work}/times")]
epochs = list(csv.DictReader(open(f"{work}/out/attitude.csv")))
baselines = [r for r in csv.DictReader(open(f"{work}/out/baselines.csv")) if r["status"] == "fixed"]
theirs = [l.split() for l in open(f"{work}/out.pos") if not l.startswith("%")]
def spread(lengths):
    return f"{statistics.mean(lengths):.4f} ± {statistics.pstdev(lengths):.4f}" if lengths else "–"
def share(count):
    return f"{100 * count / len(epochs):.1f} %"
ours_m = [float(r["length_m"]) for r in baselines]
theirs_m = [sum(float(c) ** 2 for c in l[2:5]) ** 0.5 for l in theirs if l[5] == "1"]
fixed = share(sum(r["status"] == "fixed" for r in epochs))
ours_s, theirs_s = map(sum, zip(*pairs))
print(f"| `{name}` | {bands} | {ambiguity} | {fixed}, {spread(ours_m)} m | {share(len(theirs_m))}, {spread(theirs_m)} m "
      f"| {ours_s / len(pairs):.4f} | {theirs_s / len(pairs):.3f} | {theirs_s / ours_s:.1f} |")
PY
}

m=$data/matrtklib_static u=$data/upc2011 g=$data/geonet2005 s=$work/shadow
echo "| observations | bands | ambiguity | Kurs fixed, length | RTKLIB fixed, length | Kurs, s | RTKLIB, s | times |"
echo "|---|---|---|---|---|---|---|---|"
for who in base rover; do
    gzip -dc "$data/shadow2026/${who}_all.rtcm3.gz" >"$s-$who.rtcm3"
    convbin -r rtcm3 -v 3.04 -od -os -tr 2026/06/26 16:00:00 -o "$s-$who.obs" -n "$s-$who.nav" "$s-$who.rtcm3" 2>/dev/null
done
for ambiguity in instantaneous continuous; do
    matrtklib=(matrtklib "$m/base.obs" "$m/rover.obs" "$m/base.nav")
    upc=(upc2011 "$u/UPC10770.11o" "$u/UPC20770.11o" "$u/brdc0770.11n")
    geonet=(geonet2005 "$g/07590920.05o" "$g/30400920.05o" "$g/30400920.05n")
    row "${matrtklib[@]}" G1 L1_G $ambiguity
    row "${matrtklib[@]}" G1,G2 L1L2_G $ambiguity
    row "${matrtklib[@]}" G1,E1,C2 L1_GEC $ambiguity
    row "${matrtklib[@]}" G1,G2,E1,E5,C2,C7 L1L2_GEC $ambiguity
    row "${upc[@]}" G1,G2 L1L2_G $ambiguity
    row "${geonet[@]}" G1,G2 L1L2_G $ambiguity
    row shadow2026 "$s-base.obs" "$s-rover.obs" "$s-base.nav" C2 L1_GEC $ambiguity 32
done
