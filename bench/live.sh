#!/bin/sh
# Latency, losses, processor time and memory of `kurs live` on simulated streams:
#   bench/live.sh [SECONDS] [HZ]          (600 s at 20 Hz if nothing is said)
# Four antennas, GPS, Galileo and BeiDou on two bands, UBX over TCP. Needs `cargo build --release`, curl, socat.
set -eu
seconds=${1:-600} hz=${2:-20} port=${PORT:-17400}
kurs=${KURS:-target/release/kurs}
folder=$(mktemp -d) service= simulator=
trap 'kill $service $simulator 2>/dev/null || true; rm -rf "$folder"' EXIT

cat > "$folder/scenario.toml" <<END
seed = 11
start = "2024-03-10T12:00:00"
duration_s = $seconds.0
interval_s = $(awk "BEGIN { print 1 / $hz }")
signals = ["G1C", "G2L", "E1C", "E5Q", "C2I", "C7I"]
[sky]
systems = ["G", "E", "C"]
[[body]]
name = "body"
motion = { kind = "static", place = { latitude_deg = 52.0, longitude_deg = 13.0, height_m = 100.0 }, heading_deg = 40.0, pitch_deg = 3.0 }
END
: > "$folder/live.toml"
number=0
for place in "0.0, 0.0, 0.0" "1.2, 0.0, 0.0" "0.0, 0.9, 0.0" "1.2, 0.9, 0.1"; do
    printf '[[body.antenna]]\nname = "A%d"\nposition_m = [%s]\n' $number "$place" >> "$folder/scenario.toml"
    printf '[[antenna]]\nname = "A%d"\nstream = "tcp://127.0.0.1:%d"\nposition_m = [%s]\n' \
        $number $((port + number)) "$place" >> "$folder/live.toml"
    number=$((number + 1))
done
printf '[live]\npage = "127.0.0.1:%d"\n[[output]]\nto = "tcp-listen://127.0.0.1:%d"\nprofile = "jsonl"\n' \
    $((port + 10)) $((port + 11)) >> "$folder/live.toml"

"$kurs" simulate "$folder/scenario.toml" --stream $port --quiet &
simulator=$!
sleep 1
"$kurs" live "$folder/live.toml" --out "$folder/rows" --quiet &
service=$!
sleep 2
socat -u "TCP:127.0.0.1:$((port + 11))" "CREATE:$folder/messages.jsonl" 2>/dev/null &
resident() { awk '/VmRSS/ { print $2 }' /proc/$service/status; }
sleep $((seconds / 2))
half=$(resident)
wait $simulator
end=$(resident)
files=$(ls /proc/$service/fd | wc -l)
processor=$(awk -v hz="$(getconf CLK_TCK)" '{ print ($14 + $15) / hz }' /proc/$service/stat)
curl -s "http://127.0.0.1:$((port + 10))/metrics" > "$folder/metrics"
kill -TERM $service
wait $service || true

rows=$(cat "$folder"/rows/*/attitude.csv | grep -vc time_gpst)
fixed=$(cat "$folder"/rows/*/attitude.csv | grep -c ',fixed,' || true)
echo "rows $rows of $((seconds * hz + 1)), fixed $fixed, messages $(wc -l < "$folder/messages.jsonl")"
grep -E '^kurs_stream_late_total\{|^kurs_messages_expired_total |^kurs_rows_unwritten_total ' "$folder/metrics" | tr '\n' ' '
echo
awk '/^kurs_latency_seconds_bucket/ { split($0, part, "\""); bound[++n] = part[2]; below[n] = $2 }
    END { total = below[n]; for (share = 0.5; share < 1; share = share == 0.5 ? 0.99 : share == 0.99 ? 0.999 : 2)
        for (i = 1; i <= n; i++) if (below[i] >= share * total) {
            printf "last byte in to row out: %g %% within %s s\n", 100 * share, bound[i]; break } }' "$folder/metrics"
awk -v used="$processor" -v seconds="$seconds" \
    'BEGIN { printf "processor: %.1f s, %.1f %% of one core\n", used, 100 * used / seconds }'
echo "resident memory: $half kB at half time, $end kB at the end; $files files open"
