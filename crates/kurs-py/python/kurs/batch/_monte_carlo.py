"""One scenario simulated and solved many times, each with a seed of its own."""

from __future__ import annotations

import hashlib
import json
import tempfile
import tomllib
from collections.abc import Mapping
from concurrent.futures import Executor
from os import PathLike
from pathlib import Path
from typing import Any

from kurs._commands import Config, config_file, simulate, solve, whole_paths
from kurs._native import toml_of_json, version
from kurs._table import Table
from kurs._whole import whole_file


class MonteCarlo:
    """The runs of a scenario: a summary and a table of attitudes for each, in the order of the runs."""

    def __init__(self, folder: Path, runs: int) -> None:
        self.folder = folder
        self._runs = runs

    def __len__(self) -> int:
        return self._runs

    def summary(self, run: int) -> dict[str, Any]:
        """The summary.json of a run, with its seed."""
        found: dict[str, Any] = json.loads((_folder(self.folder, run) / "run.json").read_text(encoding="utf-8"))
        return found

    def attitude(self, run: int) -> Table:
        """Attitudes `ned_from_body` (degrees) of a run."""
        return Table.read_csv(_folder(self.folder, run) / "attitude.csv")

    def truth(self, run: int) -> Table:
        """The truth of a run."""
        return Table.read_csv(_folder(self.folder, run) / "truth.csv")


def seed_of(configuration: str, run: int) -> int:
    """The seed of a run: a hash of the configuration and the number, 0 to 2^63 - 1."""
    digest = hashlib.sha256(f"{run}\n{configuration}".encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def monte_carlo(
    scenario: Config,
    runs: int,
    *,
    out: str | PathLike[str] = "kurs-out/monte-carlo",
    executor: Executor | None = None,
    solve_with: Mapping[str, Any] | None = None,
    **overrides: Any,
) -> MonteCarlo:
    """Simulates and solves a scenario `runs` times into a folder of its configuration in `out`; attitudes are `ned_from_body`, degrees.

    `scenario`: path of a TOML file, name of a built-in one, or its tables; `overrides`: its keys, as `--set`;
    `solve_with`: keys of `[solve]`. The seed of a run is a hash of the configuration and its number, so the result does not
    depend on the executor, and runs that are done are not repeated.
    """
    if runs < 0:
        raise ValueError(f"runs is {runs}, expected 0 or more")
    folder = Path(out).absolute()
    with config_file(scenario) as path:
        is_file = Path(path).exists()
        text = Path(path).read_text(encoding="utf-8") if is_file else path
    configuration = json.dumps([version(), text, overrides, dict(solve_with or {})], default=str)
    # Wherever a run is made, its paths are relative to what they were here.
    base = Path(scenario).absolute().parent if is_file and not isinstance(scenario, Mapping) else Path.cwd()
    whole = _with_whole_paths(text, base) if is_file else text
    whole_overrides = whole_paths(overrides, base)
    digest = hashlib.sha256(f"{configuration}\n{whole}\n{whole_overrides}".encode()).hexdigest()
    folder /= f"configuration={digest[:16]}"
    tasks = [((whole, is_file), run, folder, configuration, whole_overrides, dict(solve_with or {})) for run in range(runs)]
    if executor is None:
        for task in tasks:
            one_run(*task)
    else:
        for future in [executor.submit(one_run, *task) for task in tasks]:
            future.result()
    return MonteCarlo(folder, runs)


def _with_whole_paths(text: str, folder: Path) -> str:
    """The text of a scenario in a folder with whole paths; as it is where there are none."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        # The command says it in its words.
        return text
    whole = whole_paths(tables, folder)
    return text if whole == tables else toml_of_json(json.dumps(whole, default=str))


def one_run(
    scenario: tuple[str, bool],
    run: int,
    out: Path,
    configuration: str,
    overrides: dict[str, Any],
    solve_with: dict[str, Any],
) -> None:
    """Simulates and solves one run unless its result is there."""
    seed = seed_of(configuration, run)
    folder = _folder(out, run)
    if (folder / "run.json").exists() and json.loads((folder / "run.json").read_text())["seed"] == seed:
        return
    text, is_file = scenario
    with tempfile.TemporaryDirectory(prefix="kurs-") as temporary:
        path = Path(temporary) / "scenario.toml"
        if is_file:
            path.write_text(text, encoding="utf-8")
        made = Path(temporary) / "made"
        config = simulate(path if is_file else text, made, **{**overrides, "seed": seed})
        solution = solve(config, out=Path(temporary) / "solved", **solve_with)
        folder.mkdir(parents=True, exist_ok=True)
        for source in (solution.folder / "attitude.csv", solution.folder / "baselines.csv", made / "truth.csv"):
            with whole_file(folder / source.name) as whole:
                whole.write_bytes(source.read_bytes())
        with whole_file(folder / "run.json") as whole:
            whole.write_text(json.dumps({"seed": seed, **solution.summary}, indent=2), encoding="utf-8")


def _folder(out: Path, run: int) -> Path:
    return out / f"run={run:06d}"
