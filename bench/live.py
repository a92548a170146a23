#!/usr/bin/env python3
"""`kurs live` on simulated receivers: latency, losses, processor time, memory, faults, and beside rtkrcv.

    bench/live.py guaranteed [--seconds 600] [--hz 20] [--slack 1]     four antennas, 30 satellites, two bands
    bench/live.py soak [--seconds 3600] [--hz 20] [--speed 1]          a cut, a reconnect, a day and week end
    bench/live.py rtkrcv [--seconds 3600] [--hz 5]                     both programs on the same streams
    bench/live.py page [--seconds 60] [--hz 20]                        what a page costs the service
    bench/live.py bodies [--seconds 60] [--hz 5]                       eight services that see each other
    bench/live.py two-bodies                                           the scenario of this name, beside its truth

Needs `cargo build --release` (or KURS=path of the program) and, for the last, rtkrcv (Debian: rtklib). Prints a table, and
ends with status 1 where a bound is missed; `--slack N` allows N times the bounds of time.
"""

import argparse
import calendar
import csv
import json
import os
import pathlib
import random
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

from relative_rows import attitudes, view

ROOT = pathlib.Path(__file__).resolve().parent.parent
KURS = os.environ.get("KURS", str(ROOT / "target/release/kurs"))
PLACES_M = [(0.0, 0.0, 0.0), (1.2, 0.0, 0.0), (0.0, 0.9, 0.0), (1.2, 0.9, 0.1)]
# A GPS week ends with the Saturday before.
WEEK_END = calendar.timegm((2024, 3, 10, 0, 0, 0))
# Columns of attitude.csv.
GPS_WEEK, STATUS, HEADING = 1, 3, 8
LATENCY_MS = {0.99: 10.0, 0.999: 20.0}
MEMORY_KB, GROWTH_KB = 64 * 1024, 1024
PROCESSOR_SHARE_AT_20_HZ = 0.15


def free_ports(count):
    """The first of so many ports in a row that are free now."""
    for first in random.sample(range(21_000, 60_000), 100):
        sockets = [socket.socket() for _ in range(count)]
        try:
            for port, one in enumerate(sockets, first):
                one.bind(("127.0.0.1", port))
            return first
        except OSError:
            continue
        finally:
            for one in sockets:
                one.close()
    sys.exit("no free ports")


class Cable(threading.Thread):
    """Passes the bytes of a port on to the client of another one, until it is cut."""

    def __init__(self, source):
        super().__init__(daemon=True)
        self.source = source
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.is_cut = threading.Event()
        self.start()

    def run(self):
        client, _ = self.listener.accept()
        receiver = socket.create_connection(("127.0.0.1", self.source))
        self.listener.setblocking(False)
        while data := receiver.recv(1000):
            if client and self.is_cut.is_set():
                client.sendall(data[: len(data) // 2])
                client.close()
                client = None
            if client is None:
                try:
                    client, _ = self.listener.accept()
                except BlockingIOError:
                    continue
                if self.is_cut.is_set():
                    client.close()
                    client = None
                    continue
                client.setblocking(True)
            try:
                client.sendall(data)
            except OSError:
                client = None


class Listener(threading.Thread):
    """Lines of a port with the time of their arrival."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.port, self.lines = port, []
        self.start()

    def run(self):
        with connected(self.port) as stream, stream.makefile("rb") as file:
            for line in file:
                self.lines.append((time.monotonic(), line))


def connected(port):
    """A connection to a port that may not be there yet."""
    for _ in range(300):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except OSError:
            time.sleep(0.1)
    sys.exit(f"nobody listens at port {port}")


class Process:
    """A program with its use of memory, files and processor."""

    def __init__(self, command, nice=0, **options):
        self.child = subprocess.Popen([str(part) for part in command], **options)
        if nice:
            os.setpriority(os.PRIO_PROCESS, self.child.pid, nice)
        self.samples = []

    def sample(self):
        status = pathlib.Path(f"/proc/{self.child.pid}/status").read_text()
        resident_kb = int(status.split("VmRSS:")[1].split()[0])
        self.samples.append((time.monotonic(), resident_kb, len(os.listdir(f"/proc/{self.child.pid}/fd"))))

    def processor_s(self):
        fields = pathlib.Path(f"/proc/{self.child.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def halves(self, column):
        """Largest value of the third quarter and of the last one: both after everything is warm."""
        values = [sample[column] for sample in self.samples]
        half, quarter = len(values) // 2, 3 * len(values) // 4
        return max(values[half:quarter] or values), max(values[quarter:] or values)

    def end(self):
        self.child.terminate()
        self.child.wait(20)


class Bench:
    """Simulated receivers and the service that listens to them."""

    def __init__(self, folder, args, antennas, start, has_page=True):
        self.folder, self.args = folder, args
        self.ports = free_ports(antennas + 2)
        self.page = self.ports + antennas if has_page else None
        self.output = self.ports + antennas + 1
        self.scenario = folder / "scenario.toml"
        self.scenario.write_text(scenario(args, antennas, start))

    def begin(self, streams):
        command = [KURS, "simulate", self.scenario, "--stream", self.ports, "--speed", self.args.speed, "--quiet"]
        self.simulator = Process(command, self.args.nice)
        time.sleep(1)
        configuration = self.folder / "live.toml"
        configuration.write_text(live_toml(streams, self.page, self.output, self.folder))
        self.began = time.monotonic()
        command = [KURS, "live", configuration, "--out", self.folder / "rows", "--quiet"]
        self.service = Process(command, self.args.nice)
        self.listener = Listener(self.output)

    def metrics(self):
        with urllib.request.urlopen(f"http://127.0.0.1:{self.page}/metrics") as answer:
            lines = answer.read().decode().splitlines()
        return {name: float(value) for name, value in (l.rsplit(" ", 1) for l in lines if not l.startswith("#"))}

    def watch(self, at=lambda seconds: None):
        """Samples until the simulator ends."""
        interval_s = max(0.2, self.args.seconds / self.args.speed / 400)
        while self.simulator.child.poll() is None:
            at(time.monotonic() - self.began)
            self.service.sample()
            time.sleep(interval_s)
        self.wall_s = time.monotonic() - self.began
        self.used_s = self.service.processor_s()
        time.sleep(0.5)
        found = self.metrics() if self.page else {}
        self.service.end()
        return found

    def rows(self):
        days = sorted((self.folder / "rows").glob("*/attitude.csv"))
        return [line.split(",") for day in days for line in day.read_text().splitlines()[1:]], len(days)


def scenario(args, antennas, start):
    text = f"""
seed = 11
start = "{start}"
duration_s = {float(args.seconds)}
interval_s = {1 / args.hz}
signals = ["G1C", "G2L", "R1C", "R2C", "E1C", "E5Q", "C2I", "C7I"]
[sky]
systems = ["G", "R", "E", "C"]
max_satellites = 30
[[body]]
name = "body"
motion = {{ kind = "static", place = {{ latitude_deg = 52.0, longitude_deg = 13.0, height_m = 100.0 }}, heading_deg = 40.0, pitch_deg = 3.0 }}
"""
    for number in range(antennas):
        text += f'[[body.antenna]]\nname = "A{number}"\nposition_m = {list(PLACES_M[number])}\n'
    return text


def live_toml(streams, page, output, folder):
    text = f'[live]\nstate_dir = "{folder}/state"\n'
    text += f'page = "127.0.0.1:{page}"\n' if page else ""
    text += f'[log]\ndir = "{folder}/raw"\n'
    text += f'[[output]]\nto = "tcp-listen://127.0.0.1:{output}"\nprofile = "jsonl"\n'
    for number, port in enumerate(streams):
        text += f'[[antenna]]\nname = "A{number}"\nstream = "tcp://127.0.0.1:{port}"\n'
        text += f"position_m = {list(PLACES_M[number])}\n"
    return text


def quantile_ms(metrics, share):
    """Upper bound of the class in which this share of the latencies ends, ms."""
    prefix = 'kurs_latency_seconds_bucket{le="'
    classes = [(name[len(prefix) : -2], count) for name, count in metrics.items() if name.startswith(prefix)]
    total = metrics["kurs_latency_seconds_count"]
    return next(1e3 * float(bound) for bound, count in classes if count >= share * total)


def check(name, found, limit, faults):
    verdict = "" if found <= limit else "  MISSED"
    print(f"| {name} | {found:g} | ≤ {limit:g}{verdict} |")
    if verdict:
        faults.append(name)


def judge(bench, metrics, slack, faults, lost_epochs):
    args = bench.args
    print(f"{args.seconds} s at {args.hz} Hz, {args.speed:g} times real time, {bench.wall_s:.0f} s, nice {args.nice}")
    print(f"load average at the end {os.getloadavg()[0]:.1f}, satellites of the last row {metrics['kurs_satellites']:.0f}")
    rows, days = bench.rows()
    fixed = sum(row[STATUS] == "fixed" for row in rows)
    print(f"rows {len(rows)} in {days} days, fixed {fixed}, messages {len(bench.listener.lines)}\n")
    print("| what | found | bound |\n|---|---|---|")
    check("epochs without a row", args.seconds * args.hz + 1 - len(rows), lost_epochs, faults)
    late = sum(value for name, value in metrics.items() if name.startswith("kurs_stream_late_total"))
    check("antenna epochs that missed the deadline", late, 0 if not lost_epochs else float("inf"), faults)
    check("messages that were too old", metrics["kurs_messages_expired_total"], 0, faults)
    for share, bound_ms in LATENCY_MS.items():
        name = f"last byte in to row out, {100 * share:g} %, ms"
        check(name, quantile_ms(metrics, share), slack * bound_ms, faults)
    share = bench.used_s / bench.wall_s
    allowed = PROCESSOR_SHARE_AT_20_HZ * args.hz / 20 * args.speed
    check("processor, % of one core", round(100 * share, 1), 100 * slack * allowed, faults)
    before, after = bench.service.halves(1)
    check("resident memory, kB", after, MEMORY_KB, faults)
    check("growth over the last half, kB", after - before, GROWTH_KB, faults)
    files = bench.service.halves(2)
    check("more files open over the last half", files[1] - files[0], 0, faults)
    return rows


def wrong(rows):
    """Fixed rows whose heading is off by more than a degree."""
    return sum(row[STATUS] == "fixed" and abs(float(row[HEADING]) - 40.0) > 1.0 for row in rows)


def guaranteed(args, folder, faults):
    bench = Bench(folder, args, 4, "2024-03-10T12:00:00")
    bench.begin(range(bench.ports, bench.ports + 4))
    rows = judge(bench, bench.watch(), args.slack, faults, lost_epochs=0)
    check("wrong fixes", wrong(rows), 0, faults)


def page(args, folder, faults):
    """Without a page, with one that nobody looks at, and with one that is open: for it the engine reports residuals."""
    print(f"{args.seconds} s at {args.hz} Hz, nice {args.nice}\n\n| page | processor, % of one core |\n|---|---|")
    for name in ("none", "nobody looks", "open"):
        (folder / name).mkdir()
        bench = Bench(folder / name, args, 4, "2024-03-10T12:00:00", has_page=name != "none")
        bench.begin(range(bench.ports, bench.ports + 4))
        if name == "open":
            threading.Thread(target=look_at, args=(bench.page,), daemon=True).start()
        bench.watch()
        print(f"| {name} | {100 * bench.used_s / bench.wall_s:.1f} |")
    print(f"\nload average at the end {os.getloadavg()[0]:.1f}")


def look_at(port):
    """Reads what a page gets, as long as the service lives."""
    with connected(port) as stream:
        stream.sendall(b"GET /feed HTTP/1.1\r\nHost: localhost\r\n\r\n")
        while stream.recv(65536):
            pass


def soak(args, folder, faults):
    begin = time.gmtime(WEEK_END - args.seconds / 2)
    bench = Bench(folder, args, 4, time.strftime("%Y-%m-%dT%H:%M:%S", begin))
    cable = Cable(bench.ports + 1)
    wall_s = args.seconds / args.speed
    cut_s, back_s = 0.25 * wall_s, 0.25 * wall_s + min(60, 0.05 * wall_s)

    def at(now_s):
        if cut_s <= now_s < back_s:
            cable.is_cut.set()
        else:
            cable.is_cut.clear()

    bench.begin([bench.ports, cable.port, bench.ports + 2, bench.ports + 3])
    metrics = bench.watch(at)
    rows = judge(bench, metrics, args.slack, faults, lost_epochs=0)
    check("wrong fixes", wrong(rows), 0, faults)
    weeks = len({row[GPS_WEEK] for row in rows})
    connections = metrics['kurs_stream_connections_total{stream="A1"}']
    print(f"\nGPS weeks {weeks}, connections of the antenna that was cut {connections:.0f}")
    if weeks != 2 or connections < 2:
        faults.append("week end or reconnect")


RTKRCV = """
console-passwd =x
pos1-posmode =movingbase
pos1-frequency =l1+2
pos1-soltype =forward
pos1-elmask =15
pos1-dynamics =off
pos1-ionoopt =brdc
pos1-tropopt =saas
pos1-sateph =brdc
pos1-navsys =41
pos2-armode =instantaneous
pos2-gloarmode =off
pos2-bdsarmode =on
pos2-arthres =3
out-solformat =enu
out-timesys =gpst
out-timeform =tow
inpstr1-type =tcpcli
inpstr1-path =127.0.0.1:{rover}
inpstr1-format =ubx
inpstr2-type =tcpcli
inpstr2-path =127.0.0.1:{base}
inpstr2-format =ubx
outstr1-type =tcpsvr
outstr1-path =:{output}
outstr1-format =enu
misc-svrcycle =10
file-cmdfile1 =
"""


def rtkrcv(args, folder, faults):
    """Both programs have the same two antennas; the second one's cables are cut twice."""
    if shutil.which("rtkrcv") is None:
        print("skipped: no rtkrcv")
        return
    bench = Bench(folder, args, 2, "2024-03-10T12:00:00")
    cables = [Cable(bench.ports + number) for number in (0, 1, 0, 1)]
    wall_s = args.seconds / args.speed
    cuts = [(0.3 * wall_s, min(5.0, 0.1 * wall_s)), (0.6 * wall_s, min(60.0, 0.2 * wall_s))]

    def at(now_s):
        is_cut = any(begin <= now_s < begin + length for begin, length in cuts)
        for cable in (cables[1], cables[3]):
            (cable.is_cut.set if is_cut else cable.is_cut.clear)()
        other.sample()

    command = folder / "rtkrcv.conf"
    output = free_ports(2)
    command.write_text(RTKRCV.format(rover=cables[3].port, base=cables[2].port, output=output))
    bench.begin([cables[0].port, cables[1].port])
    other = Process(
        ["rtkrcv", "-s", "-p", output + 1, "-o", command], args.nice,
        cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )
    others = Listener(output)
    bench.watch(at)
    other_used_s = other.processor_s()
    other.end()
    epochs = args.seconds * args.hz + 1
    found = [
        ("Kurs", bench.service, bench.used_s, kurs_fixes(bench.listener.lines)),
        ("rtkrcv", other, other_used_s, rtklib_fixes(others.lines)),
    ]
    print(f"{args.seconds} s at {args.hz} Hz, cuts of {cuts[0][1]:g} s and {cuts[1][1]:g} s; a client that reads each output")
    cut_epochs = sum(length for _, length in cuts) * args.hz
    print(f"{epochs} epochs, {cut_epochs:.0f} of them while the cable was cut\n")
    print("| program | fixed | not fixed beyond the cuts | fixed again after the first cut, the second | processor | memory, half and end |")
    print("|---|---|---|---|---|---|")
    for name, process, used_s, fixes in found:
        if not fixes:
            sys.exit(f"{name} fixed nothing: its streams did not come up, no comparison")
        backs = [fixed_after(fixes, bench.began + begin + length) for begin, length in cuts]
        memory = process.halves(1)
        print(
            f"| {name} | {len(fixes)} | {epochs - cut_epochs - len(fixes):.0f} | {backs[0]}, {backs[1]} "
            f"| {100 * used_s / bench.wall_s:.1f} % | {memory[0] / 1024:.1f}, {memory[1] / 1024:.1f} MB |"
        )


BODIES = 8
BODY_TOML = """
[[body]]
name = "b{number}"
motion = {{ kind = "static", place = {{ latitude_deg = {latitude}, longitude_deg = 13.0, height_m = 100.0 }}, heading_deg = {heading} }}
[[body.antenna]]
name = "B{number}0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "B{number}1"
position_m = [1.2, 0.0, 0.0]
"""


def bodies(args, folder, faults):
    """Eight bodies with two antennas each, every one of which sees the seven others."""
    ports = free_ports(2 * BODIES)
    file = folder / "scenario.toml"
    headings = [40.0 * number for number in range(BODIES)]
    text = scenario(args, 0, "2024-03-10T12:00:00").split("[[body]]")[0]
    for number, heading in enumerate(headings):
        text += BODY_TOML.format(number=number, heading=heading, latitude=52.0 + 1e-4 * number)
    file.write_text(text)
    rows = free_ports(BODIES)
    command = [KURS, "simulate", file, "--stream", ports, "--speed", args.speed, "--quiet"]
    simulator = Process(command, args.nice)
    time.sleep(1)
    services = []
    for number in range(BODIES):
        toml = f'[live]\nbody = "b{number}"\n[[output]]\nto = "tcp-listen://:{rows + number}"\nprofile = "jsonl"\n'
        for antenna in range(2):
            port = ports + 2 * number + antenna
            toml += f'[[antenna]]\nname = "A{antenna}"\nstream = "tcp://127.0.0.1:{port}"\n'
            toml += f"position_m = {list(PLACES_M[antenna])}\n"
        for other in range(BODIES):
            if other != number:
                toml += f'[[peer]]\nname = "b{other}"\nfrom = "tcp://127.0.0.1:{rows + other}"\n'
        configuration = folder / f"b{number}.toml"
        configuration.write_text(toml)
        out = folder / f"b{number}"
        services.append(Process([KURS, "live", configuration, "--out", out, "--quiet"], args.nice))
    began = time.monotonic()
    while simulator.child.poll() is None:
        for service in services:
            service.sample()
        time.sleep(0.5)
    wall_s = time.monotonic() - began
    used_s = sum(service.processor_s() for service in services)
    for service in services:
        service.end()
    found = {"fixed": 0, "float": 0, "lost": 0}
    worst = 0.0
    for number in range(BODIES):
        for table in (folder / f"b{number}").glob("*/relative.csv"):
            for row in csv.DictReader(table.open()):
                found[row["status"]] += 1
                if row["status"] == "fixed" and row["heading_deg"]:
                    truth = headings[int(row["peer"][1:])] - headings[number]
                    error = (float(row["heading_deg"]) - truth + 180) % 360 - 180
                    worst = max(worst, abs(error) / float(row["heading_sd_deg"]))
    epochs = args.seconds * args.hz + 1
    wanted = epochs * BODIES * (BODIES - 1)
    print(f"{BODIES} bodies, {args.seconds} s at {args.hz} Hz, load average at the end {os.getloadavg()[0]:.1f}\n")
    print("| what | found | bound |\n|---|---|---|")
    check("relative rows missing", wanted - sum(found.values()), 0, faults)
    check("relative rows without a fix, %", round(100 - 100 * found["fixed"] / wanted, 1), 5, faults)
    check("worst relative heading, standard deviations", round(worst, 1), 6, faults)
    check("processor, % of one core, all services", round(100 * used_s / wall_s, 1), 100, faults)
    check("resident memory of the largest, kB", max(s.halves(1)[1] for s in services), MEMORY_KB, faults)


def two_bodies(args, folder, faults):
    """The ready scenario of a tractor and its implement: on one band, and on its own ones."""
    text = (ROOT / "scenarios/two-bodies.toml").read_text()
    cases = [("G1C, E1C", 'signals = ["G1C", "E1C"]\n' + text), ("its own", text)]
    print("| bands | seen from | attitudes | fixed rows | NEES of an angle, band | worst heading, sd |\n|---|---|---|---|---|---|")
    for number, (bands, text) in enumerate(cases):
        scenario = folder / f"{number}" / "scenario.toml"
        scenario.parent.mkdir(parents=True, exist_ok=True)
        scenario.write_text(text)
        views = see_each_other(args, scenario)
        for body, view in views.items():
            rows = sum(view.statuses.values())
            for what, score in (("of one time", view.of_one_time), ("brought to one time", view.by_rates)):
                print(
                    f"| {bands} | {body} | {what} | {score.rows} of {rows} "
                    f"| {score.nees:.2f}, 1 ± {score.band:.2f} | {score.worst_heading_sd:.1f} |"
                )
                # More is allowed for the rates, and for several bands, than the simulation has in it.
                is_exact = number == 0 and what == "of one time"
                if not (1 - score.band if is_exact else 0) <= score.nees <= 1 + score.band:
                    faults.append(f"NEES of {bands}, {body}, {what}")


def see_each_other(args, scenario):
    """Both bodies of a scenario as services; the second one is killed after a third of the time, and comes back."""
    folder = scenario.parent
    subprocess.run([KURS, "simulate", scenario, "--out", folder, "--quiet"], check=True)
    names = {"tractor": "kurs.toml", "implement": "kurs-implement.toml"}
    antennas = {"T0": 0, "T1": 1, "T2": 2, "I0": 3, "I1": 4, "S0": 5}
    ports, rows = free_ports(len(antennas)), free_ports(len(names))
    configurations = {}
    for number, (body, file) in enumerate(names.items()):
        text = (folder / file).read_text()
        for antenna, port in antennas.items():
            text = text.replace(f'obs = ["{antenna}.rnx"]', f'stream = "tcp://127.0.0.1:{ports + port}"')
        peer = next(name for name in names if name != body)
        text += f'[live]\nbody = "{body}"\n[[output]]\nto = "tcp-listen://:{rows + number}"\nprofile = "jsonl"\n'
        text += f'[[peer]]\nname = "{peer}"\nfrom = "tcp://127.0.0.1:{rows + 1 - number}"\n'
        configurations[body] = folder / f"live-{body}.toml"
        configurations[body].write_text(text)

    def begin(body):
        return Process([KURS, "live", configurations[body], "--out", folder / body, "--quiet"], args.nice)

    command = [KURS, "simulate", scenario, "--stream", ports, "--speed", args.speed, "--quiet"]
    simulator = Process(command, args.nice)
    time.sleep(1)
    services = {body: begin(body) for body in names}
    # A third of the two minutes of the scenario.
    time.sleep(40 / args.speed)
    services["implement"].child.kill()
    services["implement"].child.wait()
    time.sleep(5 / args.speed)
    services["implement"] = begin("implement")
    simulator.child.wait()
    for service in services.values():
        service.end()
    truth = {body: attitudes(folder / file) for body, file in zip(names, ("truth.csv", "truth-implement.csv"))}
    return {
        body: view(sorted((folder / body).glob("*/relative.csv")), truth[body], truth[other])
        for body, other in zip(names, reversed(names))
    }


def fixed_after(fixes, since):
    """How long after an instant the next fix came."""
    return next((f"{at - since:.2f} s" for at in fixes if at >= since), "never")


def kurs_fixes(lines):
    return [at for at, line in lines if json.loads(line)["status"] == "fixed"]


def rtklib_fixes(lines):
    """Times of arrival of solutions with quality 1: `week tow e n u Q …`."""
    fields = [(at, line.split()) for at, line in lines if not line.startswith(b"%")]
    return [at for at, words in fields if len(words) > 5 and words[5] == b"1"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["guaranteed", "soak", "page", "rtkrcv", "bodies", "two-bodies"])
    parser.add_argument("--seconds", type=int)
    parser.add_argument("--hz", type=int)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--slack", type=float, default=1.0)
    parser.add_argument("--nice", type=int, default=0, help="priority of the programs that are measured")
    parser.add_argument("--keep", type=pathlib.Path, help="folder that keeps the files")
    args = parser.parse_args()
    usual = {
        "guaranteed": (guaranteed, 600, 20),
        "soak": (soak, 3600, 20),
        "page": (page, 60, 20),
        "rtkrcv": (rtkrcv, 3600, 5),
        "bodies": (bodies, 60, 5),
        "two-bodies": (two_bodies, 120, 5),
    }
    run, seconds, hz = usual[args.what]
    args.seconds, args.hz = args.seconds or seconds, args.hz or hz
    faults = []
    with tempfile.TemporaryDirectory() as name:
        folder = args.keep or pathlib.Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        run(args, folder, faults)
    if faults:
        sys.exit("missed: " + ", ".join(faults))


if __name__ == "__main__":
    main()
