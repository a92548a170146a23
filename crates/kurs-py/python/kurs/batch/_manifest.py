"""`kurs batch` on an executor: a task for every session, which are done, retried and merged as on the command line."""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any
from urllib.parse import quote

from kurs._commands import run as run_command
from kurs._commands import settings
from kurs._native import InputError, UsageError
from kurs._table import Table
from kurs.batch._remote import fetched

_TABLES = ("attitude", "baselines", "points")


def run(
    manifest: str | PathLike[str],
    *,
    out: str | PathLike[str] = "kurs-out/batch",
    executor: Executor | None = None,
    jobs: int | None = None,
    format: str = "csv",
    **overrides: Any,
) -> Table:
    """Solves the sessions of a manifest into the data set `out`; the table of manifest-status.csv: a row for each session.

    `manifest`: CSV as of `kurs batch`; its paths may name file systems, `s3://…`, through fsspec or pyarrow. `executor`: any
    of `concurrent.futures`, or one like it (Dask: `Client.get_executor()`; Ray: `RayExecutor`); by default threads in Rust,
    `jobs` of them. `format`: "csv", or "parquet" beside it. What is done is not solved again.
    """
    if format not in ("csv", "parquet"):
        raise ValueError(f'format is {format!r}, expected "csv" or "parquet"')
    manifest, out = Path(manifest).absolute(), Path(out).absolute()
    arguments = settings(overrides)
    entries = _entries(manifest)
    is_remote = any("://" in path for entry in entries for path in _fields(entry))
    if executor is None and not is_remote and format == "csv":
        options = [] if jobs is None else ["--jobs", str(jobs)]
        _call(manifest, out, [*options, *arguments])
    elif executor is None:
        for entry in entries:
            solve_session(manifest, out, entry, arguments, format)
    else:
        tasks = [executor.submit(solve_session, manifest, out, entry, arguments, format) for entry in entries]
        for task in tasks:
            task.result()
    _call(manifest, out, ["--merge"])
    return Table.read_csv(out / "manifest-status.csv")


def solve_session(manifest: Path, out: Path, entry: dict[str, str], arguments: Sequence[str], format: str) -> None:
    """Solves one session of a manifest, unless it is done; what fails is told by its status."""
    with tempfile.TemporaryDirectory(prefix="kurs-") as folder:
        local = manifest
        if any("://" in path for path in _fields(entry)):
            local = _localised(entry, manifest.parent, Path(folder))
        _call(local, out, ["--session", entry["label"], *arguments])
    if format == "parquet":
        _write_parquet(out, entry["label"])


def _call(manifest: Path, out: Path, arguments: Sequence[str]) -> None:
    # What fails is told by the status of the sessions.
    with suppress(InputError):
        run_command("batch", manifest, "--out", out, *arguments)


def _entries(manifest: Path) -> list[dict[str, str]]:
    # The command line checks it in words; this only needs the labels and paths.
    try:
        with manifest.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(_without_comments(file), skipinitialspace=True) if row]
    except UnicodeDecodeError as error:
        raise UsageError(f"{manifest}: not UTF-8: {error}") from error
    except (OSError, csv.Error) as error:
        raise UsageError(f"{manifest}: {error}") from error
    header = [name.strip() for name in rows[0]] if rows else []
    entries = []
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(header):
            raise UsageError(f"{manifest}: session {number} has {len(row)} fields, expected {len(header)} as in the header")
        entries.append(dict(zip(header, (field.strip() for field in row), strict=True)))
    if not entries or any("label" not in entry for entry in entries):
        raise UsageError(f"{manifest}: no sessions with a `label`")
    return entries


def _without_comments(lines: Iterable[str]) -> Iterator[str]:
    is_quoted = False
    for line in lines:
        if is_quoted or not line.startswith("#"):
            is_quoted ^= line.count('"') % 2 == 1
            yield line


def _fields(entry: dict[str, str]) -> list[str]:
    return [value for column, value in entry.items() if column not in ("label", "set")]


def _localised(entry: dict[str, str], base: Path, folder: Path) -> Path:
    """A manifest of this session alone whose remote files are local."""
    row = {}
    for column, value in entry.items():
        if column in ("label", "set"):
            row[column] = value
        else:
            parts = [part.strip() for part in value.split(";") if part.strip()]
            row[column] = ";".join(
                str(fetched(part, folder) if "://" in part else base / part) for part in parts
            )
    path = folder / "manifest.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, row)
        writer.writeheader()
        writer.writerow(row)
    return path


def _write_parquet(out: Path, label: str) -> None:
    folder = out / folder_name(label)
    for name in _TABLES:
        rows, target = folder / f"{name}.csv", folder / f"{name}.parquet"
        if rows.exists() and not (target.exists() and target.stat().st_mtime_ns >= rows.stat().st_mtime_ns):
            Table.read_csv(rows).to_parquet(target)


def folder_name(label: str) -> str:
    """The folder of a session in the data set."""
    return f"session={quote(label, safe='~')}"
