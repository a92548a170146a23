#!/usr/bin/env python3
"""Every output profile of `kurs live` in the eyes of its readers: tests/profiles/run, which installs them.

    python3 check.py KURS MESSAGES      the program, and what the example `ros_messages` prints

A body with three antennas is simulated at four headings with tilts of both signs; two antennas are without signals for
a while (no heading), and the first row is without ephemerides (no position). The service sends its rows by all
profiles at once. What a reader understands of each has to be the row of attitude.csv, as exactly as the format says it, and
"not available" where the row is empty.
"""

import csv
import json
import math
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
LEAP_SECONDS = 18
# Heading, pitch, roll in degrees, held for so many seconds each, with turns between them.
ATTITUDES = [(0.0, 5.0, 8.0), (90.0, -6.0, 10.0), (200.0, 4.0, -12.0), (359.9, -3.0, -7.0)]
HOLD_S, TURN_S = 4.0, 3.0
VELOCITY_MPS = (3.0, 2.0)  # north, east
PLACE = (-43.1, 131.9, 30.0)
OUTAGE_S = (9.0, 10.0)  # of all antennas but the first
ANTENNAS = [(0.0, 0.0, 0.0), (1.2, 0.1, -0.05), (0.3, 0.9, 0.1)]
# A0 to A1, the longest line seen from above.
LINE = (1.2, 0.1, -0.05)
SPEED = 6
PROFILES = [
    "jsonl", "marine", "gpsd", "survey", "agopen", "ardupilot", "ardupilot:ubx", "ardupilot:mavlink", "px4", "signalk",
    "nmea2000", "nmea2000:bus", "nmea2000:canboat", "ros2",
]
# Of simulated receivers with 0.1 Hz of noise in the Doppler: three times what messages state.
VELOCITY_LIMIT_MPS = 3 * 0.1
REQUIRED = os.environ.get("KURS_REQUIRE_TOOLS") == "1"


def file_of(profile):
    return profile.replace(":", "-")


# What is simulated


def scenario(folder):
    """Scenario and motion of the body."""
    metres_per_degree = 111_000.0
    duration_s = len(ATTITUDES) * (HOLD_S + TURN_S)
    with open(folder / "motion.csv", "w") as file:
        file.write("time_s,latitude_deg,longitude_deg,height_m,heading_deg,pitch_deg,roll_deg\n")
        for tick in range(int(2 * duration_s) + 5):  # it stands still behind the last row
            seconds = tick / 2
            leg, in_leg = divmod(seconds, HOLD_S + TURN_S)
            here = ATTITUDES[min(int(leg), len(ATTITUDES) - 1)]
            there = ATTITUDES[min(int(leg) + 1, len(ATTITUDES) - 1)]
            share = min(max((in_leg - HOLD_S) / TURN_S, 0.0), 1.0)
            angles = [a + share * (b - a) for a, b in zip(here, there)]
            latitude = PLACE[0] + VELOCITY_MPS[0] * seconds / metres_per_degree
            longitude = PLACE[1] + VELOCITY_MPS[1] * seconds / metres_per_degree / math.cos(math.radians(PLACE[0]))
            values = [seconds, latitude, longitude, PLACE[2], *angles]
            file.write(",".join(f"{value:.12g}" for value in values) + "\n")
    antennas = "".join(
        f'[[body.antenna]]\nname = "A{k}"\nposition_m = {list(place)}\n' for k, place in enumerate(ANTENNAS)
    )
    text = f"""
start = "2024-03-10T12:00:00"
duration_s = {duration_s}
interval_s = 0.2
[[outage]]
from_s = {OUTAGE_S[0]}
to_s = {OUTAGE_S[1]}
antennas = ["A1", "A2"]
[[body]]
name = "body"
[body.motion]
kind = "recorded"
file = "motion.csv"
{antennas}"""
    (folder / "scenario.toml").write_text(text)


def free_ports(count):
    """Ports that are free now."""
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def connect(port):
    for _ in range(300):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except OSError:
            time.sleep(0.05)
    sys.exit(f"nobody listens at port {port}")


class Client(threading.Thread):
    """Takes everything that comes by a connection."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.socket = connect(port)
        self.bytes = b""
        self.start()

    def run(self):
        while piece := self.socket.recv(65536):
            self.bytes += piece

    def send(self, message):
        self.socket.sendall(message)


class Relay(threading.Thread):
    """Passes bytes on: the receiver that connects to the service, so late that all readers are there."""

    def __init__(self, source, sink):
        super().__init__(daemon=True)
        self.source, self.sink = connect(source), connect(sink)
        self.start()

    def run(self):
        while piece := self.source.recv(65536):
            self.sink.sendall(piece)
        self.sink.close()


def serve(kurs, folder):
    """Runs the service; gives rows, clients by profile, and what gpspipe said."""
    scenario(folder)
    first = 20_000 + os.getpid() % 20_000
    receivers = subprocess.Popen(
        [kurs, "simulate", folder / "scenario.toml", "--stream", str(first), "--speed", str(SPEED)],
        stdout=subprocess.DEVNULL,
    )
    *ports, last = free_ports(len(PROFILES) + 1)
    streams = [f"tcp://127.0.0.1:{first}", f"tcp://127.0.0.1:{first + 1}", f"tcp-listen://127.0.0.1:{last}"]
    text = "[live]\ndeadline_ms = 3000\n" + "".join(
        f'[[antenna]]\nname = "A{k}"\nstream = "{stream}"\nposition_m = {list(place)}\n'
        for k, (stream, place) in enumerate(zip(streams, ANTENNAS))
    )
    for profile, port in zip(PROFILES, ports):
        text += f'[[output]]\nto = "tcp-listen://127.0.0.1:{port}"\nprofile = "{profile}"\n'
    (folder / "kurs.toml").write_text(text)
    service = subprocess.Popen([kurs, "live", folder / "kurs.toml", "--once", "--quiet", "--out", folder / "out"])
    try:
        clients = {profile: Client(port) for profile, port in zip(PROFILES, ports)}
        daemon = Gpsd(ports[PROFILES.index("gpsd")], folder)
        asked = configure(clients["px4"])
        Relay(first + 2, last)
        if service.wait(timeout=60) != 0:
            sys.exit(f"kurs live ended with status {service.returncode}")
    finally:
        service.kill()
        receivers.kill()
    for profile, client in clients.items():
        client.join(timeout=5)
        (folder / file_of(profile)).write_bytes(client.bytes)
    (day,) = (folder / "out").glob("????-??-??")
    with open(day / "attitude.csv", newline="") as file:
        rows = [{k: number(v) for k, v in row.items()} for row in csv.DictReader(file)]
    return rows, clients, daemon.end(sum(row["status"] == "fixed" for row in rows)), asked


def number(text):
    """Empty fields are None, words stay words."""
    try:
        return float(text) if text else None
    except ValueError:
        return text


class Gpsd:
    """gpsd on the output, gpspipe on gpsd."""

    def __init__(self, port, folder):
        self.processes, self.heard = [], folder / "gpspipe"
        if not (shutil.which("gpsd") and shutil.which("gpspipe")):
            return
        (daemon,) = free_ports(1)
        command = ["gpsd", "-n", "-N", "-S", str(daemon), f"tcp://127.0.0.1:{port}"]
        self.processes.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        connect(daemon).close()
        with open(self.heard, "w") as file:
            # Line by line, because it is killed in the end.
            pipe = ["stdbuf", "-oL", "gpspipe", "-w", f"127.0.0.1:{daemon}"]
            self.processes.append(subprocess.Popen(pipe, stdout=file))
        # It is there before the first row comes.
        wait_for("gpspipe", lambda: self.heard.stat().st_size > 0)

    def end(self, count):
        """Its reports, when there are so many attitudes; None without gpsd."""
        if not self.processes:
            return None
        reports = lambda: [json.loads(line) for line in self.heard.read_text().splitlines(keepends=True) if line[-1] == "\n"]
        attitudes = lambda: sum(report["class"] == "ATT" for report in reports())
        wait_for("attitudes from gpsd", lambda: attitudes() >= count, is_needed=False)
        for process in self.processes:
            process.kill()
        return reports()


def wait_for(what, condition, is_needed=True):
    for _ in range(200):
        if condition():
            return
        time.sleep(0.05)
    if is_needed:
        sys.exit(f"waited in vain for {what}")


# Comparison


class Faults:
    """Counts what was compared by a reader, and keeps what differs."""

    def __init__(self, reader):
        self.reader, self.count, self.faults = reader, 0, []

    def equal(self, what, row, found, wanted, limit=0.0, turn=None):
        """`None` equals `None` alone."""
        self.count += 1
        if (found is None) != (wanted is None):
            wrong = True
        elif wanted is None:
            wrong = False
        elif isinstance(wanted, (str, bool)):
            wrong = found != wanted
        else:
            difference = found - wanted
            if turn:
                difference = (difference + turn / 2) % turn - turn / 2
            wrong = abs(difference) > limit
        if wrong:
            self.faults.append(f"{row['tow_s']:.1f} {row['status']}: {what} {found}, wanted {wanted}")

    def matches(self, rows, messages, share=1.0):
        """Whether there is a message for every row."""
        self.count += 1
        if not share * len(rows) <= len(messages) <= len(rows):
            self.faults.append(f"{len(messages)} messages of {len(rows)} rows")

    def done(self):
        print(f"{self.reader}: {self.count} values, {len(self.faults)} faults")
        return [f"{self.reader}: {fault}" for fault in self.faults]


def skipped(what):
    print(f"skipped: {what}")
    return [f"{what} is required"] if REQUIRED else []


def fixed(row, name):
    """A column that leaves with fixed rows alone."""
    return row[name] if row["status"] == "fixed" else None


def radians(degrees):
    return None if degrees is None else math.radians(degrees)


def half_turn(degrees):
    return degrees if degrees is None or degrees <= 180 else degrees - 360


def speed(row):
    return None if row["vel_north_mps"] is None else math.hypot(row["vel_north_mps"], row["vel_east_mps"])


def course(row):
    return row["course_deg"]


def line_in(row):
    """The vector from A0 to A1, north, east, down."""
    if row["status"] != "fixed":
        return None
    w, x, y, z = (row[name] for name in ("qw", "qx", "qy", "qz"))
    matrix = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return [sum(a * b for a, b in zip(line, LINE)) for line in matrix]


# NMEA 0183


def epochs_of_sentences(text, first):
    """Sentences by their names, epoch by epoch; each epoch begins with one of `first`."""
    epochs = []
    for line in text.decode().split():
        body, checksum = line[1:].split("*")
        total = 0
        for character in body.encode():
            total ^= character
        assert total == int(checksum, 16), line
        fields = body.split(",")
        name = fields[0] if fields[0] != "PTNL" else "PTNL" + fields[1]
        if name in first and (not epochs or name not in ("GNVTG", "GNGGA") or name == first[0]):
            epochs.append({})
        epochs[-1][name] = fields
    return epochs


def value(field):
    return float(field) if field else None


def read_by_pynmeagps(rows, clients):
    try:
        from pynmeagps import NMEAReader
    except ImportError:
        return skipped("pynmeagps")
    check = Faults("pynmeagps")
    for profile in ("marine", "survey"):
        epochs = []
        for line in clients[profile].bytes.splitlines(keepends=True):
            message = NMEAReader.parse(line)
            if message.msgID == "GGA":
                epochs.append({})
            epochs[-1][message.msgID] = message
        check.matches(rows, epochs)
        for row, epoch in zip(rows, epochs):
            angle = lambda what, found, name: check.equal(what, row, value(found), fixed(row, name), 0.0006, 360)
            angle("HDT", epoch["HDT"].headingT, "heading_deg")
            if (rate := fixed(row, "heading_rate_degps")) is not None:
                check.equal("ROT", row, value(epoch["ROT"].rot), 60 * rate, 0.01)
            has_place = row["latitude_deg"] is not None
            check.equal("GGA lat", row, value(epoch["GGA"].lat), row["latitude_deg"], 2e-9)
            check.equal("GGA quality", row, epoch["GGA"].quality > 0, has_place)
            check.equal("RMC status", row, epoch["RMC"].status, "A" if has_place else "V")
            if profile == "survey":
                angle("PASHR heading", epoch["ASHR"].trueHdg, "heading_deg")
                angle("PASHR pitch", epoch["ASHR"].pitch, "pitch_deg")
                angle("PASHR roll", epoch["ASHR"].roll, "roll_deg")
                check.equal("PASHR sd", row, value(epoch["ASHR"].rollAcc), fixed(row, "roll_sd_deg"), 0.0006)
            elif (pitch := fixed(row, "pitch_deg")) is not None:
                xdr = epoch["XDR"]
                check.equal("XDR names", row, (xdr.tdrid_01 + xdr.tdrid_02), "PTCHROLL")
                check.equal("XDR pitch", row, float(xdr.data_01), pitch, 0.0006)
                check.equal("XDR roll", row, float(xdr.data_02), fixed(row, "roll_deg"), 0.0006)
            else:
                check.equal("XDR", row, "XDR" in epoch, False)
    return check.done()


def proprietary_sentences(rows, clients):
    """PTNL,AVR, KSXT, PAOGI by their fields: pynmeagps knows none of them."""
    check = Faults("PTNL,AVR, KSXT, PAOGI by hand")
    epochs = epochs_of_sentences(clients["survey"].bytes, ["GNGGA"])
    check.matches(rows, epochs)
    for row, epoch in zip(rows, epochs):
        fields = epoch["PTNLAVR"]
        for k, name in ((3, "heading_deg"), (5, "pitch_deg"), (7, "roll_deg")):
            check.equal(f"AVR {name}", row, value(fields[k]), fixed(row, name), 0.0006, 360)
        check.equal("AVR quality", row, fields[10], "3" if row["status"] == "fixed" else "0")
        check.equal("AVR range", row, value(fields[9]), fixed(row, "status") and math.dist(LINE, (0, 0, 0)), 0.03)
    epochs = epochs_of_sentences(clients["ardupilot"].bytes, ["GNGGA"])
    check.matches(rows, epochs)
    for row, epoch in zip(rows, epochs):
        check.equal("KSXT", row, "KSXT" in epoch, row["status"] == "fixed")
        check.equal("no HDT, THS", row, "GNHDT" in epoch or "GNTHS" in epoch, False)
        if "KSXT" in epoch:
            fields = epoch["KSXT"]
            check.equal("KSXT quality", row, fields[11], "3")
            # ArduPilot wants 21 fields behind the name and adds the numbers itself.
            check.equal("KSXT fields", row, len(fields) - 1, 21)
            check.equal("KSXT time", row, fields[1][8:], f"{utc_clock(row)}")
            check.equal("KSXT lon", row, float(fields[2]), row["longitude_deg"], 2e-9)
            check.equal("KSXT lat", row, float(fields[3]), row["latitude_deg"], 2e-9)
            for k, name in ((5, "heading_deg"), (6, "pitch_deg"), (9, "roll_deg")):
                check.equal(f"KSXT {name}", row, value(fields[k]), row[name], 0.0006, 360)
            for k, (name, sign) in ((17, ("vel_east_mps", 1)), (18, ("vel_north_mps", 1)), (19, ("vel_down_mps", -1))):
                check.equal(f"KSXT {name}", row, float(fields[k]) / 3.6, sign * row[name], 3e-4)
    epochs = epochs_of_sentences(clients["agopen"].bytes, ["GNVTG", "PAOGI"])
    check.matches(rows, epochs)
    for row, epoch in zip(rows, epochs):
        check.equal("PAOGI", row, "PAOGI" in epoch, row["status"] == "fixed")
        if "PAOGI" in epoch:
            fields = epoch["PAOGI"]
            for k, name in ((12, "heading_deg"), (13, "roll_deg"), (14, "pitch_deg"), (15, "heading_rate_degps")):
                check.equal(f"PAOGI {name}", row, value(fields[k]), row[name], 0.0006, 360)
            check.equal("PAOGI speed", row, float(fields[11]) * 1.852 / 3.6, speed(row), 1e-3)
        else:
            check.equal("GGA goes on", row, "GNGGA" in epoch and "GNHDT" not in epoch, True)
    return check.done()


def utc_clock(row):
    seconds = round((row["tow_s"] - LEAP_SECONDS) % 86_400, 2)
    return f"{int(seconds // 3600):02}{int(seconds // 60 % 60):02}{seconds % 60:05.2f}"


def read_by_gpsd(rows, reports):
    if reports is None:
        return skipped("gpsd and gpspipe")
    check = Faults("gpsd")
    wanted = [row for row in rows if row["status"] == "fixed"]
    attitudes = [report for report in reports if report["class"] == "ATT"]
    places = [report for report in reports if report["class"] == "TPV" and "altHAE" in report]
    check.matches(wanted, attitudes)
    for row, attitude in zip(wanted, attitudes):
        for name in ("heading", "pitch", "roll"):
            check.equal(name, row, attitude.get(name), row[f"{name}_deg"], 0.0056, 360)
    by_clock = {report["time"][11:22]: report for report in places}
    with_place = [row for row in rows if row["latitude_deg"] is not None]
    # The first one it reports with the sentence that ends a cycle, which it has to learn.
    check.matches(with_place, list(by_clock), 0.97)
    for row in with_place:
        clock = utc_clock(row)
        if place := by_clock.get(f"{clock[:2]}:{clock[2:4]}:{clock[4:]}"):
            check.equal("lat", row, place["lat"], row["latitude_deg"], 2e-9)
            check.equal("lon", row, place["lon"], row["longitude_deg"], 2e-9)
            check.equal("altHAE", row, place["altHAE"], row["height_m"], 0.0011)
    return check.done()


# UBX


def configure(client):
    """What an autopilot does with a receiver before it listens; gives the answers by name."""
    try:
        from pyubx2 import SET, POLL, UBXMessage, UBXReader
    except ImportError:
        return None
    valset = UBXMessage.config_set(1, 0, [("CFG_UART1_BAUDRATE", 115200), ("CFG_UART1OUTPROT_UBX", 1)])
    questions = [
        valset,
        UBXMessage("MON", "MON-VER", POLL),
        UBXMessage.config_poll(0, 0, ["CFG_UART1_BAUDRATE"]),
        UBXMessage("CFG", "CFG-RATE", SET, measRate=200, navRate=1, timeRef=1),
    ]
    for question in questions:
        client.send(question.serialize())
    answers = {"ACK-ACK": 0}
    for _ in range(100):
        time.sleep(0.05)
        found = [UBXReader.parse(message) for message in messages_of_ubx(client.bytes)]
        if sum(message.identity == "ACK-ACK" for message in found) == 3:
            break
    for message in found:
        if message.identity == "ACK-ACK":
            answers["ACK-ACK"] += 1
        else:
            answers[message.identity] = message
    return answers


def messages_of_ubx(stream):
    begin = 0
    while begin + 8 <= len(stream):
        assert stream[begin:begin + 2] == b"\xb5b", stream[begin:begin + 8]
        end = begin + 8 + int.from_bytes(stream[begin + 4:begin + 6], "little")
        if end > len(stream):
            return
        yield stream[begin:end]
        begin = end


def read_by_pyubx2(rows, clients, asked):
    try:
        from pyubx2 import UBXReader
    except ImportError:
        return skipped("pyubx2")
    check = Faults("pyubx2")
    check.equal("acknowledged", rows[0], asked.get("ACK-ACK"), 3)
    check.equal("module", rows[0], "MON-VER" in asked and b"MOD=ZED-F9P" in asked["MON-VER"].serialize(), True)
    check.equal("read back", rows[0], getattr(asked.get("CFG-VALGET"), "CFG_UART1_BAUDRATE", None), 115200)
    for profile in ("px4", "ardupilot:ubx"):
        epochs = []
        for message in messages_of_ubx(clients[profile].bytes):
            message = UBXReader.parse(message)
            if message.identity == "NAV-DOP":
                epochs.append({})
            if message.identity.startswith("NAV-"):
                epochs[-1][message.identity] = message
        check.matches(rows, epochs)
        for row, epoch in zip(rows, epochs):
            for message in epoch.values():
                check.equal("iTOW", row, clock_of_iTOW(message), round(row["tow_s"] % 86_400, 3), 0.0005)
            ubx_of_row(check, row, epoch, profile == "px4")
    return check.done()


def clock_of_iTOW(message):
    """pyubx2 turns time of week into a time of day, in UTC."""
    t = message.iTOW
    if not hasattr(t, "hour"):
        return t / 1000 % 86_400
    return (t.hour * 3600 + t.minute * 60 + t.second + t.microsecond * 1e-6 + LEAP_SECONDS) % 86_400


def ubx_of_row(check, row, epoch, has_two_antennas):
    pvt, vector = epoch["NAV-PVT"], epoch["NAV-RELPOSNED"]
    has_place, is_fixed = row["latitude_deg"] is not None, row["status"] == "fixed"
    check.equal("fixType", row, pvt.fixType, 3 if has_place else 0)
    check.equal("gnssFixOk", row, bool(pvt.gnssFixOk), has_place)
    check.equal("invalidLlh", row, bool(pvt.invalidLlh), not has_place)
    check.equal("headVehValid", row, bool(pvt.headVehValid), is_fixed)
    if is_fixed:
        check.equal("headVeh", row, pvt.headVeh, row["heading_deg"], 6e-5, 360)
    if has_place:
        check.equal("lat", row, pvt.lat, row["latitude_deg"], 6e-8)
        check.equal("lon", row, pvt.lon, row["longitude_deg"], 6e-8)
        check.equal("height", row, pvt.height / 1000, row["height_m"], 6e-4)
        check.equal("vAcc", row, pvt.vAcc / 1000, row["sd_down_m"], 6e-4)
        for name, column in (("velN", "vel_north_mps"), ("velE", "vel_east_mps"), ("velD", "vel_down_mps")):
            check.equal(name, row, getattr(pvt, name) / 1000, row[column], 6e-4)
        check.equal("velN is true", row, pvt.velN / 1000, VELOCITY_MPS[0], VELOCITY_LIMIT_MPS)
        check.equal("velE is true", row, pvt.velE / 1000, VELOCITY_MPS[1], VELOCITY_LIMIT_MPS)
        check.equal("hDOP below pDOP", row, epoch["NAV-DOP"].hDOP < epoch["NAV-DOP"].pDOP < 5, True)
    wanted = line_in(row)
    check.equal("relPosValid", row, bool(vector.relPosValid), is_fixed)
    check.equal("relPosHeadingValid", row, bool(vector.relPosHeadingValid), is_fixed)
    check.equal("carrSoln", row, vector.carrSoln, 2 if is_fixed else 0)
    check.equal("isMoving", row, bool(vector.isMoving), True)
    check.equal("nothing missing", row, bool(vector.refPosMiss or vector.refObsMiss), False)
    check.equal("DAHEADING", row, "NAV-DAHEADING" in epoch, has_two_antennas)
    if is_fixed:
        length, heading = math.dist(wanted, (0, 0, 0)), math.degrees(math.atan2(wanted[1], wanted[0])) % 360
        for name, component in zip(("relPosN", "relPosE", "relPosD", "relPosLength"), [*wanted, length]):
            found = getattr(vector, name)
            check.equal(name, row, found / 100, component, 1.1e-4)
        check.equal("relPosHeading", row, vector.relPosHeading, heading, 1e-3, 360)
        # The line is 4.8° right of forward: the heading of the body is not far.
        check.equal("heading of the body", row, vector.relPosHeading, row["heading_deg"] + 4.8, 1.0, 360)
        check.equal("accHeading", row, 0 < vector.accHeading < 2, True)
        if has_two_antennas:
            two = epoch["NAV-DAHEADING"]
            for name, component in zip(("relPosN", "relPosE", "relPosD", "relPosLength"), [*wanted, length]):
                check.equal("two antennas " + name, row, getattr(two, name) / 1000, component, 1.1e-3)
            check.equal("two antennas heading", row, two.relPosHeading, heading, 1e-3, 360)
    if has_two_antennas:
        check.equal("two antennas valid", row, bool(epoch["NAV-DAHEADING"].relPosHeadingValid), is_fixed)


# MAVLink


def read_by_pymavlink(rows, clients):
    try:
        from pymavlink.dialects.v20 import common
    except ImportError:
        return skipped("pymavlink")
    check = Faults("pymavlink")
    messages = common.MAVLink(None).parse_buffer(clients["ardupilot:mavlink"].bytes) or []
    check.matches(rows, messages)
    for k, (row, message) in enumerate(zip(rows, messages)):
        has_place = row["latitude_deg"] is not None
        check.equal("name", row, message.get_type(), "GPS_INPUT")
        check.equal("sequence", row, message.get_seq(), k % 256)
        heading = fixed(row, "heading_deg")
        check.equal("yaw 0 is none", row, message.yaw != 0, heading is not None)
        if heading is not None:
            check.equal("yaw", row, message.yaw / 100, heading, 0.006, 360)
            check.equal("yaw in range", row, 1 <= message.yaw <= 36_000, True)
        check.equal("week", row, message.time_week, row["gps_week"])
        check.equal("time of week", row, message.time_week_ms / 1000, row["tow_s"], 6e-4)
        unix = 315_964_800 + row["gps_week"] * 604_800 + row["tow_s"] - LEAP_SECONDS
        check.equal("unix time", row, message.time_usec * 1e-6, unix, 1e-3)
        check.equal("fix", row, message.fix_type, 3 if has_place else 1)
        check.equal("ignored", row, message.ignore_flags, 0 if has_place else 255)
        if has_place:
            check.equal("lat", row, message.lat * 1e-7, row["latitude_deg"], 6e-8)
            check.equal("lon", row, message.lon * 1e-7, row["longitude_deg"], 6e-8)
            for name, column in (("vn", "vel_north_mps"), ("ve", "vel_east_mps"), ("vd", "vel_down_mps")):
                check.equal(name, row, getattr(message, name), row[column], 1e-4)
            check.equal("vert_accuracy", row, message.vert_accuracy, row["sd_down_m"], 1e-3)
    return check.done()


# NMEA 2000 and Signal K


def pgns_of_row(check, row, pgns):
    """`pgns`: fields by number, with None for what is not available."""
    angle = lambda degrees: radians(degrees)
    check.equal("numbers", row, ",".join(map(str, sorted(pgns))), "127250,127251,127257,129025,129026,129029")
    check.equal("heading", row, pgns[127250]["heading"], angle(fixed(row, "heading_deg")), 6e-5, 2 * math.pi)
    check.equal("deviation", row, pgns[127250].get("deviation"), None)
    check.equal("reference", row, pgns[127250]["reference"], "True")
    rate = fixed(row, "heading_rate_degps")
    check.equal("rate of turn", row, pgns[127251]["rate"], angle(rate), 1e-5)
    for name, degrees in (("pitch", fixed(row, "pitch_deg")), ("roll", fixed(row, "roll_deg"))):
        check.equal(name, row, pgns[127257][name], angle(degrees), 6e-5)
    check.equal("yaw", row, pgns[127257]["yaw"], angle(half_turn(fixed(row, "heading_deg"))), 6e-5)
    check.equal("latitude", row, pgns[129025]["latitude"], row["latitude_deg"], 6e-8)
    check.equal("longitude", row, pgns[129025]["longitude"], row["longitude_deg"], 6e-8)
    check.equal("course", row, pgns[129026]["cog"], angle(course(row)), 6e-5, 2 * math.pi)
    check.equal("speed", row, pgns[129026]["sog"], speed(row), 0.006)
    check.equal("latitude of the fix", row, pgns[129029]["latitude"], row["latitude_deg"], 2e-9)
    check.equal("longitude of the fix", row, pgns[129029]["longitude"], row["longitude_deg"], 2e-9)
    height = pgns[129029]["altitude"], pgns[129029]["geoidalSeparation"]
    ellipsoidal = None if None in height else sum(height)
    check.equal("height", row, ellipsoidal, row["height_m"], 0.006)


FORMS = ["nmea2000", "nmea2000:bus", "nmea2000:canboat"]


def in_groups(messages, count=6):
    return [messages[k:k + count] for k in range(0, len(messages), count)]


def read_by_nmea2000(rows, clients):
    try:
        from nmea2000.decoder import NMEA2000Decoder
    except ImportError:
        return skipped("nmea2000")
    check = Faults("nmea2000 (PyPI)")
    short = {"headingSensorReference": "reference"}
    for form in FORMS:
        decoder = NMEA2000Decoder()
        decoded = [decoder.decode(line) for line in clients[form].bytes.decode().splitlines()]
        epochs = in_groups([message for message in decoded if message is not None])
        check.matches(rows, epochs)
        for row, epoch in zip(rows, epochs):
            fields = {m.PGN: {short.get(f.id, f.id): f.value for f in m.fields} for m in epoch}
            pgns_of_row(check, row, fields)
    return check.done()


def read_by_node(rows, folder):
    """canboatjs, nmea0183-signalk, signalk-schema."""
    if shutil.which("node") is None or not (HERE / "node_modules/@canboat").exists():
        return skipped("node, canboatjs, nmea0183-signalk, signalk-schema")
    command = ["node", HERE / "read.mjs", folder]
    found = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
    check = Faults("canboatjs")
    for form in FORMS:
        epochs = in_groups(found[file_of(form)])
        check.matches(rows, epochs)
        for row, epoch in zip(rows, epochs):
            pgns_of_row(check, row, {message.get("pgn"): message.get("fields") for message in epoch})
    faults = check.done()

    check = Faults("nmea0183-signalk")
    check.matches(rows, found["marine"])
    for row, values in zip(rows, found["marine"]):
        heading = radians(fixed(row, "heading_deg"))
        check.equal("heading", row, values.get("navigation.headingTrue"), heading, 1.2e-5, 2 * math.pi)
        place = values.get("navigation.position") or {}
        check.equal("latitude", row, place.get("latitude"), row["latitude_deg"], 2e-9)
        check.equal("longitude", row, place.get("longitude"), row["longitude_deg"], 2e-9)
        if (rate := fixed(row, "heading_rate_degps")) is not None:
            check.equal("rate of turn", row, values.get("navigation.rateOfTurn"), radians(rate), 2e-5)
    faults += check.done()

    check = Faults("signalk-schema")
    check.matches(rows, found["deltas"])
    for row, item in zip(rows, found["deltas"]):
        check.equal("valid", row, json.dumps(item["errors"]), "[]")
        (update,) = item["delta"]["updates"]
        values = {entry["path"]: entry["value"] for entry in update["values"]}
        heading = fixed(row, "heading_deg")
        angles = values["navigation.attitude"] or {}
        check.equal("heading", row, values["navigation.headingTrue"], radians(heading), 2e-6)
        check.equal("yaw", row, angles.get("yaw"), radians(half_turn(heading)), 2e-6)
        check.equal("pitch", row, angles.get("pitch"), radians(fixed(row, "pitch_deg")), 2e-6)
        check.equal("roll", row, angles.get("roll"), radians(fixed(row, "roll_deg")), 2e-6)
        check.equal("turn", row, values["navigation.rateOfTurn"], radians(fixed(row, "heading_rate_degps")), 2e-6)
        check.equal("speed", row, values["navigation.speedOverGround"], speed(row), 6e-4)
        place = values["navigation.position"] or {}
        check.equal("latitude", row, place.get("latitude"), row["latitude_deg"], 2e-9)
        check.equal("altitude", row, place.get("altitude"), row["height_m"], 6e-5)
        clock = utc_clock(row)
        check.equal("time", row, update["timestamp"][11:22], f"{clock[:2]}:{clock[2:4]}:{clock[4:]}")
    return faults + check.done()


# ROS 2


def rotation(q):
    """Axes of the body in the world: columns forward, left, up."""
    w, x, y, z = q["w"], q["x"], q["y"], q["z"]
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def rosbridge(rows, clients):
    check = Faults("rosbridge lines by hand")
    lines = [json.loads(line) for line in clients["ros2"].bytes.splitlines()]
    advertised = {line["topic"]: line["type"] for line in lines if line["op"] == "advertise"}
    published = [line for line in lines if line["op"] == "publish"]
    check.equal("advertised", rows[0], ",".join(advertised.values()),
                "sensor_msgs/msg/Imu,geometry_msgs/msg/QuaternionStamped,sensor_msgs/msg/NavSatFix")
    of = lambda topic: [line["msg"] for line in published if line["topic"] == topic]
    imus, fixes, headings = of("/kurs/imu"), of("/kurs/fix"), of("/kurs/heading")
    check.matches(rows, imus)
    check.matches(rows, fixes)
    check.matches([row for row in rows if row["status"] == "fixed"], headings)
    for row, imu, fix in zip(rows, imus, fixes):
        unix = 315_964_800 + row["gps_week"] * 604_800 + row["tow_s"] - LEAP_SECONDS
        for message in (imu, fix):
            stamp = message["header"]["stamp"]
            check.equal("stamp", row, stamp["sec"] + stamp["nanosec"] * 1e-9, unix, 1e-3)
        covariance = imu["orientation_covariance"]
        check.equal("gyro", row, imu["angular_velocity_covariance"][0], -1.0)
        if row["status"] == "fixed":
            orientation_of_row(check, row, imu["orientation"])
            for k, (a, b) in enumerate([(r, c) for r in ("roll", "pitch", "heading") for c in ("roll", "pitch", "heading")]):
                check.equal(f"covariance {a} {b}", row, covariance[k], covariance_of(row, a, b), 2e-9)
            heading = headings.pop(0)["quaternion"]
            forward = rotation(heading)
            yaw = math.degrees(math.atan2(forward[1][0], forward[0][0]))
            check.equal("yaw", row, yaw, 90 - row["heading_deg"], 1e-4, 360)
            check.equal("upright", row, forward[2][2], 1.0, 1e-9)
        else:
            check.equal("no estimate", row, covariance[0], -1.0)
        has_place = row["latitude_deg"] is not None
        check.equal("fix", row, fix["status"]["status"], 0 if has_place else -1)
        check.equal("latitude", row, fix["latitude"], row["latitude_deg"], 2e-9)
        check.equal("altitude", row, fix["altitude"], row["height_m"], 6e-5)
        if has_place:
            sds = [math.sqrt(fix["position_covariance"][k]) for k in (0, 4, 8)]
            for found, name in zip(sds, ("sd_east_m", "sd_north_m", "sd_down_m")):
                check.equal(name, row, found, row[name], 6e-5)
    return check.done()


def orientation_of_row(check, row, q):
    """Forward and left axes of the body in east, north, up, from heading, pitch and roll."""
    h, p, r = (math.radians(row[name]) for name in ("heading_deg", "pitch_deg", "roll_deg"))
    forward = (math.sin(h) * math.cos(p), math.cos(h) * math.cos(p), math.sin(p))
    up = math.sin(r) * math.cos(p)  # the left side is up when the right side is down
    matrix = rotation(q)
    for k, name in enumerate(("east", "north", "up")):
        check.equal(f"forward {name}", row, matrix[k][0], forward[k], 1e-6)
    check.equal("left is up", row, matrix[2][1], up, 1e-6)
    check.equal("upright", row, matrix[2][2], math.cos(p) * math.cos(r), 1e-6)


def covariance_of(row, a, b):
    sign = {"roll": 1, "pitch": -1, "heading": -1}
    if a == b:
        return math.radians(row[f"{a}_sd_deg"]) ** 2
    name = {"heading": "h", "pitch": "p", "roll": "r"}
    pair = "".join(sorted(name[a] + name[b]))
    return sign[a] * sign[b] * row[f"cov_{pair}_deg2"] * math.radians(1) ** 2


def read_by_websockets(clients):
    """What examples/live/to_rosbridge.py passes on to a WebSocket server."""
    try:
        import websockets.sync.server
    except ImportError:
        return skipped("websockets")
    check = Faults("to_rosbridge.py")
    lines, heard = clients["ros2"].bytes.decode().splitlines(keepends=True), []
    source = socket.create_server(("127.0.0.1", 0))

    def hear(peer):
        try:
            for message in peer:
                heard.append(message)
        except websockets.ConnectionClosed:
            pass  # the script is killed

    with websockets.sync.server.serve(hear, "127.0.0.1", 0) as bridge:
        threading.Thread(target=bridge.serve_forever, daemon=True).start()
        port = bridge.socket.getsockname()[1]
        script = HERE.parent.parent / "examples/live/to_rosbridge.py"
        address = f"127.0.0.1:{source.getsockname()[1]}"
        passing = subprocess.Popen([sys.executable, script, address, f"ws://127.0.0.1:{port}"])
        try:
            peer, _ = source.accept()
            peer.sendall(clients["ros2"].bytes)
            wait_for("messages by WebSocket", lambda: len(heard) >= len(lines), is_needed=False)
        finally:
            passing.kill()
    check.matches(lines, heard)
    for line, message in zip(lines, heard):
        check.equal("message", {"tow_s": 0.0, "status": "line"}, message, line)
    return check.done()


def read_by_rosbags(path):
    """CDR beside JSON of the same messages, and the hashes of their types."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        return skipped("rosbags")
    check = Faults("rosbags (CDR)")
    store, newest = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS2_JAZZY)
    row = {"tow_s": 0.0, "status": "example"}
    kinds = []
    for line in pathlib.Path(path).read_text().splitlines():
        kind, type_hash, cdr, text = line.split("\t")
        check.equal("hash of the type", row, type_hash, newest.hash_rihs01(kind))
        kinds.append(kind.split("/")[-1])
        compare(check, row, kind, store.deserialize_cdr(bytes.fromhex(cdr), kind), json.loads(text)["msg"])
    check.equal("kinds", row, ",".join(kinds), ",".join(["Imu,QuaternionStamped,NavSatFix"] * 4 + ["Imu,NavSatFix"]))
    return check.done()


def compare(check, row, what, found, wanted):
    for name, value in wanted.items():
        field, place = getattr(found, name), f"{what}.{name}"
        if isinstance(value, dict):
            compare(check, row, place, field, value)
        elif isinstance(value, list):
            for a, b in zip(field, value, strict=True):
                check.equal(place, row, float(a), float(b))
        elif value is None:
            check.equal(place, row, math.isnan(field), True)
        else:
            check.equal(place, row, field, value)


def main(kurs, ros_messages):
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        rows, clients, reports, asked = serve(kurs, folder)
        kinds = {status: sum(row["status"] == status for row in rows) for status in ("fixed", "float", "lost")}
        without_place = sum(row["latitude_deg"] is None for row in rows)
        print(f"{len(rows)} rows: {kinds}, {without_place} without a position")
        faults = []
        if kinds["fixed"] < 100 or len(rows) - kinds["fixed"] < 5 or not without_place:
            faults.append("too few rows of a kind")
        faults += read_by_pynmeagps(rows, clients)
        faults += proprietary_sentences(rows, clients)
        faults += read_by_gpsd(rows, reports)
        faults += read_by_pyubx2(rows, clients, asked)
        faults += read_by_pymavlink(rows, clients)
        faults += read_by_nmea2000(rows, clients)
        faults += read_by_node(rows, folder)
        faults += rosbridge(rows, clients)
        faults += read_by_websockets(clients)
        faults += read_by_rosbags(ros_messages)
    print("\n".join(faults[:40]))
    print(f"{time.monotonic() - began:.0f} s")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main(*sys.argv[1:]) if len(sys.argv) == 3 else sys.exit(__doc__)
