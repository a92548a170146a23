"""Programs that are measured: their processor time and memory, and the tables of `kurs solve`."""

import csv
import os
import shutil
import subprocess
import tempfile
from dataclasses import dataclass


@dataclass
class Cost:
    """Of one process: user and system time, and the most memory it had (NaN without GNU time)."""

    processor_s: float
    memory_mb: float


def measured(command, **options):
    """Runs a command; its cost, its exit status and what it printed."""
    with tempfile.NamedTemporaryFile("r") as report:
        # Memory is that of GNU time's child: a child of this interpreter would begin with the interpreter's own.
        whole = ["/usr/bin/time", "-q", "-f", "%M", "-o", report.name] if shutil.which("/usr/bin/time") else []
        with tempfile.TemporaryFile() as output:
            child = subprocess.Popen([*whole, *map(str, command)], stdout=output, stderr=subprocess.STDOUT, **options)
            _, status, used = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
            output.seek(0)
            text = output.read().decode(errors="replace")
        memory_kb = float(report.read().split()[-1]) if whole else float("nan")
    return Cost(used.ru_utime + used.ru_stime, memory_kb / 1024), child.returncode, text


def solve(kurs, text, folder):
    """What `kurs solve` makes of a configuration: rows of attitude.csv and of baselines.csv, and the cost."""
    path = f"{folder}/kurs.toml"
    with open(path, "w") as file:
        file.write(text)
    cost, _, said = measured([kurs, "solve", "--quiet", path, "--out", f"{folder}/out"])
    if not os.path.exists(f"{folder}/out/attitude.csv"):
        raise RuntimeError(said.strip()[:200])
    return table(f"{folder}/out/attitude.csv"), table(f"{folder}/out/baselines.csv"), cost


def table(path):
    with open(path) as file:
        return list(csv.DictReader(file))


def time(row):
    """GPS week and second of a row, a key of epochs."""
    return int(row["gps_week"]), round(float(row["tow_s"]), 2)
