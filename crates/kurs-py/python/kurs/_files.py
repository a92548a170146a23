"""Observation and navigation files as arrays."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kurs import _native
from kurs._table import Table, Words

#: One path or several.
Paths = str | PathLike[str] | Sequence[str | PathLike[str]]

_ALWAYS = (np.iinfo(np.int64).min, np.iinfo(np.int64).max)
#: Letters of georinex's variables and their columns.
_KINDS = {"C": "pseudorange_m", "L": "phase_cycles", "D": "doppler_hz", "S": "cn0_dbhz"}


def paths(given: Paths) -> list[str]:
    """Paths as a list of texts."""
    listed = [given] if isinstance(given, (str, PathLike, bytes)) else list(given)
    for path in listed:
        if not isinstance(path, (str, PathLike)):
            raise TypeError(f"the path is {path!r}, expected a text or an object of a path")
    return [str(path) for path in listed]


def _between(time: Sequence[Any]) -> tuple[int, int]:
    """First and last instant, nanoseconds."""
    if isinstance(time, str) or len(time) != 2:
        raise ValueError(f"time is {time!r}, expected two instants, the first and the last, or None for one of them")
    first, last = (
        always if instant is None else _nanoseconds(instant) for instant, always in zip(time, _ALWAYS, strict=True)
    )
    return first, last


def _nanoseconds(instant: Any) -> int:
    has_zone = getattr(instant, "tzinfo", None) is not None or (
        isinstance(instant, str) and re.search(r"[T ].*(Z|[+-][0-9:]+)$", instant.strip(), re.IGNORECASE)
    )
    if has_zone:
        raise ValueError(f"time has {instant!r}, expected an instant without a zone, GPST")
    if isinstance(instant, (int, np.integer)):
        return int(instant)
    coarse = np.datetime64(instant)
    if np.isnat(coarse):
        raise ValueError(f"time has {instant!r}, expected an instant, or None for an open end")
    if not 1678 <= int(coarse.astype("datetime64[Y]").astype(np.int64)) + 1970 <= 2261:
        raise ValueError(f"time has {instant!r}, expected an instant from 1678 to 2261, or None for an open end")
    return int(coarse.astype("datetime64[ns]").astype(np.int64))


class OfFiles(Table):
    """A table from files, with what was skipped in these."""

    def __init__(
        self, columns: Mapping[str, NDArray[Any] | Words], damage: Sequence[tuple[str, int, str]] = ()
    ) -> None:
        super().__init__(columns)
        #: What was skipped, as in summary.json: `file`, `line` (of a receiver log the offset of the byte), `what`.
        self.damage: list[dict[str, Any]] = [
            {"file": file, "line": line, "what": what} for file, line, what in damage
        ]


class Observations(OfFiles):
    """A row for every epoch, satellite and signal.

    time_gpst, satellite ("G05"), signal ("G1C"), pseudorange_m, phase_cycles (grows with the distance), doppler_hz (positive
    when approaching), cn0_dbhz, lock (RINEX digit).
    """

    def to_xarray(self) -> Any:
        """The same as xarray.Dataset: variables (time, sv) by RINEX code ("C1C", "L1C", …), as georinex has them; NaN where there is none."""
        xarray: Any = import_module("xarray")
        times, time_index = np.unique(self["time_gpst"], return_inverse=True)
        codes, satellites = self.words("satellite")
        order = np.argsort(satellites)
        place = np.empty(len(satellites), np.intp)
        place[order] = np.arange(len(satellites))
        signal_codes, signals = self.words("signal")
        variables: dict[str, tuple[tuple[str, str], NDArray[np.float64]]] = {}
        for number, signal in enumerate(signals):
            rows = np.flatnonzero(signal_codes == number)
            for letter, column in _KINDS.items():
                values = self[column][rows]
                there = ~np.isnan(values)
                if there.any():
                    shape = (len(times), len(satellites))
                    _, grid = variables.setdefault(letter + signal[1:], (("time", "sv"), np.full(shape, np.nan)))
                    grid[time_index[rows[there]], place[codes[rows[there]]]] = values[there]
        coordinates = {"time": times, "sv": np.array(satellites)[order]}
        return xarray.Dataset(variables, coords=coordinates)


def read_obs(
    path: Paths,
    *,
    systems: str | None = None,
    signals: str | Sequence[str] | None = None,
    time: Sequence[Any] | None = None,
) -> Observations:
    """Observations of one antenna (RINEX 2 to 4, CRINEX, UBX, RTCM 3, SBF, packed or not) as a long table.

    `path`: one file or several in any order; epochs of a file that are not later than those before are skipped, which
    `damage` of the table tells. `systems`: letters, "GE". `signals`: RINEX codes with the letter of the system, or bands:
    "G1C" or ["G1C", "E5"]. `time`: first and last instant, GPST, as anything that numpy.datetime64 takes; None leaves an end open.
    """
    between = _ALWAYS if time is None else _between(time)
    wanted = [signals] if isinstance(signals, str) else None if signals is None else list(signals)
    return Observations(*_native.read_obs(paths(path), systems, wanted, between))


class Navigation:
    """Broadcast and precise ephemerides of navigation files."""

    def __init__(self, files: Sequence[str]) -> None:
        self._files = list(files)
        self.native = _native.read_nav(self._files)

    def __reduce__(self) -> tuple[type[Navigation], tuple[list[str]]]:
        """Another process reads the files again."""
        return Navigation, ([str(Path(file).absolute()) for file in self._files],)

    @property
    def satellites(self) -> list[str]:
        """Names of the satellites: ["C06", "E01", …]."""
        return self.native.satellites

    def state(
        self, satellite: str, times: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Position (n, 3), m, velocity (n, 3), m/s, in rotating ECEF axes, and clock (n,), s, at GPS instants (n,).

        `times`: datetime64, GPST, the instants of transmission. The clock is satellite minus system time with the
        relativistic effect. NaN where no ephemeris is for an instant.
        """
        instants = np.atleast_1d(np.asarray(times, dtype="datetime64[ns]")).astype(np.int64)
        return self.native.state_at(satellite, instants)


def read_nav(files: Paths) -> Navigation:
    """Ephemerides of navigation files together: RINEX, SP3, receiver logs."""
    return Navigation(paths(files))
