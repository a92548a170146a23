#!/bin/sh
# RTKLIB as referee of the simulator: rnx2rtkp must fix every epoch of the baseline A0-A1 of simulated
# scenarios (GPS and Galileo, two bands) and agree with truth.csv.
# Usage: bench/rtklib_referee.sh KURS-BINARY
set -eu
kurs=${1:-target/release/kurs}
command -v rnx2rtkp >/dev/null || { echo "skipped: rnx2rtkp is not installed"; exit 0; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat > "$work/rtklib.conf" <<CONF
pos1-posmode       =movingbase
pos1-frequency     =l1+l2
pos1-soltype       =forward
pos1-elmask        =10
pos1-ionoopt       =off
pos1-tropopt       =saas
pos1-sateph        =brdc
pos1-navsys        =9
pos2-armode        =instantaneous
pos2-arthres       =2
out-solformat      =enu
out-timesys        =gpst
out-timeform       =tow
out-timendec       =4
CONF
for scenario in roof-static car; do
    "$kurs" simulate "$scenario" --out "$work/$scenario" --quiet
    rnx2rtkp -k "$work/rtklib.conf" -o "$work/$scenario/rtklib.pos" \
        "$work/$scenario/A1.rnx" "$work/$scenario/A0.rnx" "$work/$scenario/nav.rnx" 2>/dev/null
    python3 "$(dirname "$0")/rtklib_referee.py" "$scenario" "$work/$scenario"
done
