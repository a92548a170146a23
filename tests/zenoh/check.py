#!/usr/bin/env python3
"""Rows of `kurs live` as eclipse-zenoh hears them, a peer that it plays, and ROS 2's messages as rosbags reads them.

    tests/zenoh/check.py KURS        a program with the feature `zenoh`; called by tests/zenoh/run

Python is the router. It goes once, and comes back.
"""

import csv
import json
import math
import pathlib
import socket
import subprocess
import sys
import tempfile
import time
from datetime import datetime, timezone
from importlib.metadata import version

import zenoh
from rosbags.typesys import Stores, get_typestore

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "bench"))
from relative_rows import ANGLES, seen_from  # noqa: E402

PLACES_M = [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [0.0, 1.0, 0.0]]
SECONDS = 40
#: The peer is the body itself, turned by this.
TURNED_DEG = 30.0
TOPICS = {"imu": "sensor_msgs/msg/Imu", "heading": "geometry_msgs/msg/QuaternionStamped", "fix": "sensor_msgs/msg/NavSatFix"}
SCENARIO = f"""
seed = 3
start = "2024-03-10T12:00:00"
duration_s = {SECONDS}.0
interval_s = 0.2
[sky]
systems = ["G", "E"]
[[body]]
name = "ferry"
motion = {{ kind = "static", place = {{ latitude_deg = 52.0, longitude_deg = 13.0, height_m = 100.0 }}, heading_deg = 40.0, pitch_deg = 3.0 }}
"""


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Router:
    """Hears everything, and answers every row of the ferry with one of the barge."""

    def __init__(self, port, heard):
        self.heard = heard
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", f'["tcp/127.0.0.1:{port}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self.session = zenoh.open(config)
        self.barge = self.session.declare_publisher("kurs/barge")
        self.subscribers = [
            self.session.declare_subscriber("kurs/ferry", self.row),
            self.session.declare_subscriber("7/kurs/**", self.message),
        ]

    def row(self, sample):
        row = json.loads(sample.payload.to_bytes())
        self.heard["rows"].append(row)
        if row["heading_deg"] is not None:
            turned = {**row, "body": "barge", "heading_deg": (row["heading_deg"] + TURNED_DEG) % 360}
            self.heard["barge"][row["time_gpst"]] = turned
            self.barge.put(json.dumps(turned))

    def message(self, sample):
        entry = (str(sample.key_expr), sample.payload.to_bytes(), sample.attachment.to_bytes())
        self.heard["messages"].append(entry)

    def tokens(self):
        replies = self.session.liveliness().get("@ros2_lv/7/**")
        return sorted(str(reply.ok.key_expr) for reply in replies)

    def close(self):
        self.session.close()


def ports_in_a_row(count):
    while True:
        first = free_port()
        if first + count < 65_536 and all(is_free(first + more) for more in range(count)):
            return first


def is_free(port):
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) != 0


def run(kurs, folder):
    """What was heard, the tokens, and the rows of the files."""
    streams, port = ports_in_a_row(len(PLACES_M)), free_port()
    scenario, live = SCENARIO, ""
    for number, place in enumerate(PLACES_M):
        scenario += f'[[body.antenna]]\nname = "A{number}"\nposition_m = {place}\n'
        live += f'[[antenna]]\nname = "A{number}"\nstream = "tcp://127.0.0.1:{streams + number}"\nposition_m = {place}\n'
    at = f"zenoh://127.0.0.1:{port}"
    live += f'[live]\nbody = "ferry"\n[[output]]\nto = "{at}/kurs/ferry"\nprofile = "jsonl"\n'
    live += f'[[output]]\nto = "{at}/7"\nprofile = "ros2"\n[[peer]]\nname = "barge"\nfrom = "{at}/kurs/barge"\n'
    (folder / "scenario.toml").write_text(scenario)
    (folder / "live.toml").write_text(live)
    heard = {"rows": [], "barge": {}, "messages": []}
    router = Router(port, heard)
    simulator = subprocess.Popen([kurs, "simulate", folder / "scenario.toml", "--stream", str(streams), "--quiet"])
    time.sleep(1)
    service = subprocess.Popen([kurs, "live", folder / "live.toml", "--out", folder / "out", "--quiet"])
    try:
        time.sleep(SECONDS / 3)
        tokens = router.tokens()
        router.close()
        before = len(heard["rows"])
        time.sleep(5)
        router = Router(port, heard)
        simulator.wait(2 * SECONDS)
        time.sleep(1)
    finally:
        for process in (service, simulator):
            process.terminate()
            process.wait(20)
        router.close()
    day = next((folder / "out").iterdir())
    tables = [list(csv.DictReader((day / name).open())) for name in ("attitude.csv", "relative.csv")]
    return heard, before, tokens, *tables


class Faults(list):
    """What differs, beside how much was compared."""

    def __init__(self):
        super().__init__()
        self.count = 0

    def check(self, what, is_right):
        self.count += 1
        if not is_right:
            self.append(what)


def check_rows(faults, heard, rows):
    """Every line has the values of the row of its time, those of rows that are not fixed empty."""
    of_time = {row["time_gpst"]: row for row in rows}
    for line in heard["rows"]:
        row = of_time.get(line["time_gpst"])
        faults.check(f"{line['time_gpst']}: a line without a row", row is not None)
        for name, text in (row or {}).items():
            value = line[name]
            if row["status"] == "fixed" and text:
                same = str(value) == text if isinstance(value, str) else math.isclose(float(text), value, abs_tol=1e-12)
                faults.check(f"{line['time_gpst']} {name}: {value}, {text}", same)
            elif not text:
                faults.check(f"{line['time_gpst']} {name}: {value}, not empty", value is None)


def check_peer(faults, heard, rows, relative):
    """The barge as the ferry sees it is what both angles say."""
    of_time = {row["time_gpst"]: row for row in rows}
    fixed = [row for row in relative if row["status"] == "fixed" and row["peer_age_s"] == "0.0000"]
    for row in fixed:
        own, other = of_time[row["time_gpst"]], heard["barge"][row["time_gpst"]]
        wanted = seen_from([float(own[f"{a}_deg"]) for a in ANGLES], [other[f"{a}_deg"] for a in ANGLES])
        for angle, value in zip(ANGLES, wanted):
            off = (float(row[f"{angle}_deg"]) - value + 180) % 360 - 180
            faults.check(f"{row['time_gpst']}: the barge's {angle} is off by {off}°", abs(off) < 2e-3)
    reasons = {row["reason"] for row in relative if row["status"] == "lost"}
    faults.check(f"reasons {reasons}: no `peer_silent`", "peer_silent" in reasons)
    return len(fixed)


def check_messages(faults, heard, rows, tokens):
    """Keys, attachments and values of the topics."""
    store = get_typestore(Stores.ROS2_JAZZY)
    of_time = {round(unix_s(row["time_gpst"]), 1): row for row in rows}
    numbers = {}
    for key, payload, attachment in heard["messages"]:
        topic = key.split("/")[2]
        package, _, name = TOPICS[topic].split("/")
        wanted = f"7/kurs/{topic}/{package}::msg::dds_::{name}_/{store.hash_rihs01(TOPICS[topic])}"
        faults.check(f"key {key}, wanted {wanted}", key == wanted)
        number, sent_ns = (int.from_bytes(attachment[at : at + 8], "little") for at in (0, 8))
        faults.check(f"attachment {attachment.hex()}", len(attachment) == 33 and attachment[16] == 16)
        faults.check(f"{topic} was sent at {sent_ns} ns", abs(sent_ns * 1e-9 - time.time()) < 600)
        # They begin anew with the router.
        last = numbers.get((topic, attachment[17:]), 0)
        faults.check(f"number {number} of {topic} after {last}", number > last)
        numbers[topic, attachment[17:]] = number
        message = store.deserialize_cdr(payload, TOPICS[topic])
        row = of_time[round(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9, 1)]
        if topic == "fix":
            faults.check(f"{row['time_gpst']}: latitude", abs(message.latitude - float(row["latitude_deg"])) < 1e-8)
        elif row["status"] == "fixed":
            q = message.orientation if topic == "imu" else message.quaternion
            yaw_deg = math.degrees(math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z)))
            off = (90 - yaw_deg - float(row["heading_deg"]) + 180) % 360 - 180
            faults.check(f"{row['time_gpst']} {topic}: heading is off by {off}°", abs(off) < 1e-3)
    kinds = sorted((token.split("/")[5], token.split("/")[8]) for token in tokens)
    wanted = [("MP", f"kurs_{topic}") for topic in sorted(TOPICS)] + [("NN", f"kurs_{topic}") for topic in sorted(TOPICS)]
    faults.check(f"tokens {kinds}", kinds == wanted)
    seen = {topic for topic, _ in numbers}
    faults.check(f"topics {seen}", seen == set(TOPICS))


def unix_s(time_gpst):
    """Of a row's time; UTC was 18 s behind in 2024."""
    return datetime.fromisoformat(time_gpst).replace(tzinfo=timezone.utc).timestamp() - 18


def main(kurs):
    with tempfile.TemporaryDirectory() as name:
        heard, before, tokens, rows, relative = run(kurs, pathlib.Path(name))
    faults = Faults()
    check_rows(faults, heard, rows)
    fixed = check_peer(faults, heard, rows, relative)
    check_messages(faults, heard, rows, tokens)
    again = len(heard["rows"]) - before
    faults.check(f"{before} rows before the router went, {again} after it came back", min(before, again) > 20)
    faults.check(f"only {fixed} rows of the peer", fixed > 40)
    print(
        f"eclipse-zenoh {version('eclipse-zenoh')}, rosbags {version('rosbags')}: {len(heard['rows'])} of {len(rows)} rows, "
        f"{fixed} rows of the peer, {len(heard['messages'])} messages of ROS 2, {faults.count} comparisons, {len(faults)} faults"
    )
    sys.exit("\n".join(faults[:20]) if faults else 0)


if __name__ == "__main__":
    main(sys.argv[1])
