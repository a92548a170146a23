"""Attitude from observations as they come."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from io import StringIO
from typing import Any

from kurs import _native
from kurs._commands import Config, config_file, settings
from kurs._files import Navigation

#: A row by the names of its columns: numbers, words, None for "not available".
Row = dict[str, Any]

#: Satellite ("G05"), signal ("G1C"), pseudorange (m), phase (cycles), Doppler (Hz), C/N0 (dB-Hz), lock (RINEX digit).
Observation = tuple[str, str, float, float, float, float, int]

_TEXTS = frozenset({"time_gpst", "time_utc", "status", "reason", "base", "rover", "name"})


class Engine:
    """The engine of a configuration: rows of `ned_from_body` (degrees) as `kurs live` writes them.

    Its `[nav] files` count from the start; observation files and streams are not read. An epoch leaves when every
    antenna has come, when a later epoch shows that one is late, `deadline_s` after its first antenna came (looked at with
    every call; `poll` only looks), or with `flush`. A `[station]` is not served. Each method gives the rows of
    `attitude.csv` that left, each with its rows of `baselines.csv` and `points.csv` under these names.
    """

    def __init__(self, config: Config, *, deadline_s: float | None = None, **overrides: Any) -> None:
        with config_file(config) as path:
            assignments = settings(overrides, config)[1::2]
            self._engine = _native.NativeEngine(path, assignments, deadline_s)
        self._columns = self._engine.columns()
        #: Names of the antennas, in the order of the configuration; the last one is "station" if there is a `[station]`.
        self.antennas: list[str] = self._engine.sources()

    def insert(self, ephemerides: Navigation | bytes) -> None:
        """Takes ephemerides that count from now on: of `read_nav`, or bytes of a navigation file or log."""
        if isinstance(ephemerides, Navigation):
            self._engine.insert(ephemerides.native)
        else:
            self._engine.insert_bytes(ephemerides)

    def push(self, antenna: int | str, time: tuple[int, float], observations: Sequence[Observation]) -> list[Row]:
        """Takes the observations of one antenna at a GPS week and second of week."""
        week, tow_s = time
        return self._rows(self._engine.push(self._index(antenna), week, tow_s, list(observations)))

    def push_bytes(self, antenna: int | str, data: bytes) -> list[Row]:
        """Takes the next bytes of one antenna's receiver: UBX, RTCM 3 or SBF, cut anywhere."""
        return self._rows(self._engine.push_bytes(self._index(antenna), data))

    def poll(self) -> list[Row]:
        """The rows whose deadline has passed."""
        return self._rows(self._engine.poll())

    def flush(self) -> list[Row]:
        """All rows that are left: nothing more of these streams will come."""
        return self._rows(self._engine.flush())

    def _index(self, antenna: int | str) -> int:
        if isinstance(antenna, str):
            if antenna not in self.antennas:
                raise ValueError(f"antenna {antenna!r}, expected one of {self.antennas}")
            return self.antennas.index(antenna)
        if not 0 <= antenna < len(self.antennas):
            raise ValueError(f"antenna {antenna}, expected 0 to {len(self.antennas) - 1}")
        return antenna

    def _rows(self, lines: tuple[str, str, str, str]) -> list[Row]:
        attitude, *others = (
            # Lines end with this alone: a name may hold what else ends lines in Unicode.
            [_row(columns, fields) for fields in csv.reader(StringIO(text, newline="\n"))]
            for columns, text in zip(self._columns, lines, strict=True)
        )
        for row in attitude:
            time = row["time_gpst"]
            for name, rows in zip(("baselines", "points", "by_code"), others, strict=True):
                row[name] = [other for other in rows if other["time_gpst"] == time]
        return attitude


def _row(columns: list[str], fields: list[str]) -> Row:
    def value(name: str, field: str) -> Any:
        if not field:
            return "" if name == "reason" else None
        return field if name in _TEXTS else float(field)

    return {name: value(name, field) for name, field in zip(columns, fields, strict=True)}


__all__ = ["Engine", "Observation", "Row"]
