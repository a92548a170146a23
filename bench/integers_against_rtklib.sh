#!/usr/bin/env bash
# Right and wrong fixes of kurs and of RTKLIB's rnx2rtkp on the same bytes: each epoch alone with the
# length unknown and known (pos2-baselen), continuous, and GLONASS.
#
#   bench/integers_against_rtklib.sh        (needs rnx2rtkp, from Debian's package rtklib)
#
# What is a wrong fix stands in bench/judging.py.
# KURS_DATA: folder of the recordings (default ../shared/data). KURS: program (default release build).
set -euo pipefail
cd "$(dirname "$0")/.."
data=${KURS_DATA:-../shared/data}
kurs=${KURS:-target/release/kurs}
command -v rnx2rtkp >/dev/null || { echo "skipped: no rnx2rtkp (apt-get install rtklib)"; exit 0; }
[ -d "$data" ] || { echo "skipped: no recordings in $data"; exit 0; }
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
printf '%-12s %-8s %-28s | %-34s | %s\n' recording bands mode kurs rtklib

row() { # recording, base, rover, nav, bands, kurs settings, RTKLIB base configuration, its changes, length, truth, mode in words
    local base=$data/$2 rover=$data/$3 nav=$data/$4 place=
    local ours=("$kurs" solve --quiet --nav "$nav" --set elevation_mask_deg=15 --set "bands=[$5]" --out "$work/out")
    for setting in $6; do ours+=(--set "$setting"); done
    if [ -n "$9" ]; then place=1; fi
    ours+=(--antenna "base=$base${place:+@0,0,0}" --antenna "rover=$rover${place:+@$9,0,0}")
    "${ours[@]}" >/dev/null 2>&1 || true
    cp "$data/rtklib_conf/$7.conf" "$work/rtklib.conf"
    for change in $8; do
        sed -i "s/^${change%%=*} *=.*/$change/" "$work/rtklib.conf"
        grep -q "^${change%%=*}" "$work/rtklib.conf" || echo "$change" >> "$work/rtklib.conf"
    done
    rnx2rtkp -k "$work/rtklib.conf" -o "$work/out.pos" "$rover" "$base" "$nav" >/dev/null 2>&1 || true
    PYTHONPATH=bench python3 - "$1" "$5" "${11}" "${10}" "$work" <<'PY'
import csv, sys
from judging import is_wrong
name, bands, mode, truth, work = sys.argv[1:]
truth = [float(x) for x in truth.split(",")]
def judged(vectors, epochs, first):
    wrong = sum(is_wrong([v - t for v, t in zip(e, truth)], sd) for e, sd in vectors)
    return f"{100 * (len(vectors) - wrong) / max(epochs, 1):6.2f} % right {wrong:4} wrong {first}"
rows = list(csv.DictReader(open(f"{work}/out/attitude.csv")))
fixed = [r for r in csv.DictReader(open(f"{work}/out/baselines.csv")) if r["status"] == "fixed"]
ours = [([float(r[c]) for c in ("east_m", "north_m", "up_m")],
         [float(r[c]) for c in ("sd_east_m", "sd_north_m", "sd_up_m")]) for r in fixed]
theirs = [l.split() for l in open(f"{work}/out.pos") if not l.startswith("%")]
q1 = [([float(x) for x in l[2:5]], [float(x) for x in l[7:10]]) for l in theirs if l[5] == "1"]
first = "first epoch fixed" if rows and rows[0]["status"] == "fixed" else ""
print(f"{name:12} {bands:8} {mode:28} | {judged(ours, len(rows), first):34} | {judged(q1, len(rows), '')}")
PY
}

m=matrtklib_static; u=upc2011
m_files=("$m/base.obs" "$m/rover.obs" "$m/base.nav"); m_truth=-0.2235,-0.9645,0.009
u_files=("$u/UPC10770.11o" "$u/UPC20770.11o" "$u/brdc0770.11n"); u_truth=-27.4088,-26.2188,-0.0403
g=geonet2005
g_files=("$g/07590920.05o" "$g/30400920.05o" "$g/07590920.05n"); g_truth=953.6729,-3196.1390,4.6514
one=mb_instantaneous_L1_G
length() { echo "pos2-baselen=$1 pos2-basesig=$2"; }
row matrtklib "${m_files[@]}" G1 "" $one "" "" $m_truth "each epoch"
row matrtklib "${m_files[@]}" G1 "constraint=length array_sd_m=0.002" $one "$(length 0.990 0.002)" 0.990 $m_truth "each epoch, length 2 mm"
row upc2011 "${u_files[@]}" G1 "" $one "" "" $u_truth "each epoch"
row upc2011 "${u_files[@]}" G1 "constraint=length array_sd_m=0.01" $one "$(length 37.93 0.01)" 37.93 $u_truth "each epoch, length 1 cm"
row upc2011 "${u_files[@]}" G1 "constraint=length array_sd_m=0.01 elevation_mask_deg=10" $one "$(length 37.93 0.01) pos1-elmask=10" 37.93 $u_truth "the same, mask 10°"
row upc2011 "${u_files[@]}" G1 "elevation_mask_deg=10" $one "pos1-elmask=10" "" $u_truth "each epoch, mask 10°"
row upc2011 "${u_files[@]}" G1 "elevation_mask_deg=20" $one "pos1-elmask=20" "" $u_truth "each epoch, mask 20°"
row matrtklib "${m_files[@]}" G1 "elevation_mask_deg=25" $one "pos1-elmask=25" "" $m_truth "each epoch, mask 25°"
row matrtklib "${m_files[@]}" E1 "" $one "pos1-navsys=8" "" $m_truth "each epoch"
row geonet2005 "${g_files[@]}" G1 "" $one "" "" $g_truth "each epoch"
row geonet2005 "${g_files[@]}" G1 "ambiguity=continuous" mb_continuous_L1_G "" "" $g_truth "continuous"
row upc2011 "${u_files[@]}" G1 "ambiguity=continuous" mb_continuous_L1_G "" "" $u_truth "continuous"
row matrtklib "${m_files[@]}" G1 "ambiguity=continuous" mb_continuous_L1_G "" "" $m_truth "continuous"
row matrtklib "${m_files[@]}" R1,R2 "constraint=length array_sd_m=0.002" mb_instantaneous_L1L2_G "pos1-navsys=4 pos2-gloarmode=on $(length 0.990 0.002)" 0.990 $m_truth "GLONASS, length 2 mm"
