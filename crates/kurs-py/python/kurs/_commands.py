"""The commands as functions: their results as objects, their errors as exceptions."""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

from kurs import _native
from kurs._files import Paths, paths
from kurs._table import Table
from kurs._whole import whole_file

#: A configuration: the path of its file, or its tables as a dictionary.
Config = str | PathLike[str] | Mapping[str, Any]

#: Keys of configurations whose values are paths.
_PATHS = frozenset(
    {
        "attitude",
        "calibration",
        "dir",
        "file",
        "files",
        "log",
        "navigation",
        "obs",
        "solve",
        "state_dir",
        "token_file",
    }
)


@contextmanager
def config_file(config: Config) -> Iterator[str]:
    """The path of a configuration; paths in a dictionary are relative to the working directory."""
    if isinstance(config, (str, PathLike)):
        yield str(config)
        return
    if not isinstance(config, Mapping):
        raise TypeError(f"the configuration is {config!r}, expected the path of a file or a dictionary")
    with tempfile.TemporaryDirectory(prefix="kurs-") as folder:
        path = Path(folder) / "config.toml"
        text = _native.toml_of_json(json.dumps(_for_json(config), default=str))
        path.write_text(text, encoding="utf-8")
        yield str(path)


def _for_json(value: Any, key: str = "") -> Any:
    """Arrays as lists, paths whole, and only numbers that JSON has."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {name: _for_json(inner, name) for name, inner in value.items()}
    if isinstance(value, (list, tuple)):
        _check_list(value, key)
        return [_for_json(inner, key) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise _native.UsageError(f"{key} is {value}, expected a finite number")
    return whole_paths(value, Path.cwd(), key)


def _check_list(values: Sequence[Any], key: str) -> None:
    if any(value is None for value in values):
        raise _native.UsageError(f"{key} has None in a list, expected values")


def whole_paths(value: Any, folder: Path, key: str = "") -> Any:
    """Tables, or the value of a key, whose paths are relative to a folder: with whole ones."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {name: whole_paths(inner, folder, name) for name, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [whole_paths(inner, folder, key) for inner in value]
    # Of an override the last part is the key.
    is_path = re.split(r"__|\.", str(key))[-1] in _PATHS and isinstance(value, (str, PathLike))
    return str(folder / value) if is_path else value


def settings(overrides: Mapping[str, Any], config: Config = "") -> list[str]:
    """`--set` for each override; `nav__as_received=True` sets the key `nav.as_received`, None leaves one as it is.

    Paths are relative to the file `config`, of a dictionary to the working directory.
    """
    if isinstance(config, Mapping):
        overrides = whole_paths(overrides, Path.cwd())
    return [
        argument
        for key, value in overrides.items()
        if value is not None
        for argument in ("--set", f"{key.replace('__', '.')}={_toml_value(value, key)}")
    ]


def _toml_value(value: Any, key: str) -> str:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (str, PathLike)):
        # TOML knows no halves of a character, and escapes one more than JSON.
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (list, tuple)):
        _check_list(value, key)
        return "[" + ",".join(_toml_value(inner, key) for inner in value) + "]"
    # TOML writes nan and inf as Python does.
    return repr(value) if isinstance(value, float) else json.dumps(value)


def run(command: str, *arguments: str | PathLike[str]) -> int:
    """Runs a command without its printed lines; gives the exit status 0 or 3."""
    return _native.call(["kurs", command, *map(str, arguments), "--quiet"])


class Results:
    """The files that a command wrote, read when they are asked for."""

    def __init__(self, folder: str | PathLike[str] | None = None) -> None:
        self.folder = self._temporary_folder() if folder is None else Path(folder)
        self._tables: dict[str, Table] = {}

    def _temporary_folder(self) -> Path:
        # It goes with this object.
        self._temporary = tempfile.TemporaryDirectory(prefix="kurs-")
        return Path(self._temporary.name)

    def __getstate__(self) -> dict[str, Any]:
        """A temporary folder does not outlive this object, so its files go along: to another process, or into a pickle."""
        state = self.__dict__.copy()
        if state.pop("_temporary", None) is not None:
            state["folder"] = {path.name: path.read_bytes() for path in self.folder.iterdir()}
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if isinstance(state["folder"], dict):
            self.folder = self._temporary_folder()
            for name, content in state["folder"].items():
                (self.folder / name).write_bytes(content)

    def table(self, name: str) -> Table:
        """The table of `name.csv`."""
        if name not in self._tables:
            self._tables[name] = Table.read_csv(self.folder / f"{name}.csv")
        return self._tables[name]

    def json(self, name: str) -> dict[str, Any]:
        """The content of `name.json`."""
        found: dict[str, Any] = json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8"))
        return found


class Solution(Results):
    """What `solve` found: tables with the columns of the command line's files."""

    def __init__(self, config: Config, overrides: Mapping[str, Any], out: str | PathLike[str] | None) -> None:
        super().__init__(out)
        self._config = config
        self._overrides = dict(overrides)
        self._run(self.folder)

    def _run(self, folder: str | PathLike[str], *options: str) -> None:
        with config_file(self._config) as path:
            run("solve", path, *settings(self._overrides, self._config), *options, "--require-fix", "0", "--out", folder)

    @property
    def attitude(self) -> Table:
        """A row for every epoch: status, reason, angles in degrees (north-east-down), position, velocity."""
        return self.table("attitude")

    @property
    def baselines(self) -> Table:
        """A row for every baseline and epoch: east, north, up in metres, from the first antenna."""
        return self.table("baselines")

    @property
    def points(self) -> Table:
        """A row for every `[[point]]` and epoch: place and standard deviations."""
        return self.table("points")

    @property
    def status(self) -> int:
        """The exit status of the command line: 0, 3 if nothing is fixed."""
        return 0 if self.summary["fixed"] else 3

    @property
    def summary(self) -> dict[str, Any]:
        """The counts of summary.json."""
        return self.json("summary")

    def report(self, path: str | PathLike[str]) -> None:
        """Solves once more with everything that the report shows, and writes its page to `path`."""
        with tempfile.TemporaryDirectory(prefix="kurs-") as folder, whole_file(path) as temporary:
            self._run(folder, "--report")
            temporary.write_bytes((Path(folder) / "report.html").read_bytes())

    def __repr__(self) -> str:
        counts = self.summary
        return f"Solution({counts['epochs']} epochs, {counts['fixed']} fixed)"


def solve(config: Config, *, out: str | PathLike[str] | None = None, **overrides: Any) -> Solution:
    """Attitude `ned_from_body` (degrees), baselines (east-north-up, metres) and positions of every epoch.

    `config`: path of a TOML file, or its tables as a dictionary, whose paths are relative to the working directory.
    `overrides`: keys of `[solve]`, as `--set`; `table__key` for those of another table; their paths are relative to what
    those of `config` are. `out`: folder that keeps the files. Raises UsageError and InputError with the words of the command line.
    """
    return Solution(config, overrides, out)


def simulate(
    scenario: Config,
    out: str | PathLike[str],
    **overrides: Any,
) -> Path:
    """Observation and navigation files, truth and configuration of a scenario in the folder `out`; the path of its kurs.toml.

    `scenario`: path of a TOML file, name of a built-in one, or its tables. `overrides`: its keys, as `--set`.
    """
    with config_file(scenario) as path:
        run("simulate", path, "--out", out, *settings(overrides, scenario))
    return Path(out) / "kurs.toml"


def plan(
    array: Config,
    *,
    nav: Paths = (),
    at: str | None = None,
    duration: str | None = None,
    **overrides: Any,
) -> dict[str, Any]:
    """Predicted accuracy of an array (angles in degrees), weak directions, baselines: the content of plan.json.

    `array`: path of a TOML file with `[[antenna]]` and `[plan]`, or its tables. `at`: GPS time such as
    "2024-06-24T08:20:00"; `duration` such as "24h". `overrides`: keys of `[plan]`, as `--set`.
    """
    results = Results()
    arguments = [argument for file in paths(nav) for argument in ("--nav", file)]
    arguments += ["--at", at] if at else []
    arguments += ["--for", duration] if duration else []
    with config_file(array) as path:
        run("plan", path, "--out", results.folder, *arguments, *settings(overrides, array))
    return results.json("plan")


def inspect(*files: str | PathLike[str]) -> list[dict[str, Any]]:
    """What is in each of the files (signals, gaps, slips, strengths, damage), as of `kurs inspect --json`."""
    with tempfile.TemporaryDirectory(prefix="kurs-") as folder:
        path = Path(folder) / "inspect.json"
        run("inspect", *files, f"--json={path}")
        found: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
        return found
