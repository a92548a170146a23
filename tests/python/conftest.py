"""What the tests share: the project, recordings, vectors, and the command beside the module."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
KURS = Path(sys.executable).with_name("kurs")

#: Two antennas at rest, twenty seconds across midnight, 5 Hz.
SCENARIO = """
seed = 5
start = "2024-03-09T23:59:50"
duration_s = 20.0
interval_s = 0.2
signals = ["G1C", "G2L", "E1C", "E5Q", "C2I"]

[output]
formats = ["rinex", "ubx", "sbf"]

[sky]
systems = ["G", "E", "C"]

[[body]]
name = "roof"
motion = { kind = "static", place = { latitude_deg = 52.0, longitude_deg = 13.0, height_m = 100.0 }, \
heading_deg = 40.0, pitch_deg = 3.0 }
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "A1"
position_m = [1.2, 0.0, 0.0]
"""


def outside(variable: str, default: str) -> Path:
    folder = Path(os.environ.get(variable, ROOT / default))
    if not folder.exists():
        pytest.skip(f"no {folder}")
    return folder


@pytest.fixture(scope="session")
def recordings() -> Path:
    return outside("KURS_DATA", "../shared/data")


@pytest.fixture(scope="session")
def vectors() -> dict[str, list[dict[str, Any]]]:
    folder = outside("KURS_VECTORS", "../shared/vectors")
    merged: dict[str, list[dict[str, Any]]] = {}
    for file in sorted(folder.glob("*.json")):
        for key, cases in json.loads(file.read_text()).items():
            if isinstance(cases, list):
                merged.setdefault(key, []).extend(cases)
    return merged


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Observations and logs of SCENARIO."""
    folder = tmp_path_factory.mktemp("simulated")
    (folder / "scenario.toml").write_text(SCENARIO)
    command("simulate", folder / "scenario.toml", "--out", folder)
    return folder


def command(*arguments: object, status: int = 0) -> str:
    """Runs the command `kurs` of the wheel; what it printed."""
    done = subprocess.run([KURS, *map(str, arguments), *quiet(arguments)], capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    return done.stdout


def quiet(arguments: tuple[object, ...]) -> list[str]:
    return [] if str(arguments[0]).startswith("-") or "--json" in arguments else ["--quiet"]
