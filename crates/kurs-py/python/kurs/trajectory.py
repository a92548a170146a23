"""Where an object is, from angles, ranges and range differences of ground stations; ECEF, metres."""

from os import PathLike
from typing import Any

from kurs._commands import Config, Results, config_file, run, settings
from kurs._native import locate


class Trajectory(Results):
    """What `track` found: `.table("trajectory")`, `.table("residuals")`, `.json("summary")`."""


def track(config: Config, *, out: str | PathLike[str] | None = None, **overrides: Any) -> Trajectory:
    """Trajectory (ECEF, m, and its tables) of measurements in files, as of `kurs track`; `overrides` as `--set`."""
    found = Trajectory(out)
    with config_file(config) as path:
        run("track", path, "--out", found.folder, *settings(overrides, config))
    return found


__all__ = ["Trajectory", "locate", "track"]
