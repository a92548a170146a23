"""Attitudes carried through outages by a gyro, and one antenna on a rotating arm."""

from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kurs._commands import Config, Results, config_file, run, settings
from kurs._whole import whole_file


class Fusion(Results):
    """What `fuse` found: `.table("attitude")` (degrees, `ned_from_body`), `.json("summary")`, and further tables."""


def fuse(config: Config, *, out: str | PathLike[str] | None = None, **overrides: Any) -> Fusion:
    """Fused attitudes `ned_from_body` (degrees) of every row, as of `kurs fuse`; `overrides`: keys as `--set`."""
    found = Fusion(out)
    with config_file(config) as path:
        run("fuse", path, "--out", found.folder, *settings(overrides, config))
    return found


def write_imu(path: str | PathLike[str], columns: Mapping[str, NDArray[np.float64]]) -> None:
    """A log for `fuse` and `calibrate` of columns (n,) such as time_s, gx_radps, ax_mps2, in sensor axes."""
    with whole_file(path) as temporary:
        numbers = np.column_stack(list(columns.values()))
        np.savetxt(temporary, numbers, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")


__all__ = ["Fusion", "fuse", "write_imu"]
