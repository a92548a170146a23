"""Files of other file systems, such as `s3://bucket/day1.rnx`."""

from importlib import import_module
from pathlib import Path
from shutil import copyfileobj
from typing import Any


def fetched(address: str, folder: Path) -> Path:
    """A copy of the file in `folder`, through fsspec, or pyarrow's file systems where that is not there."""
    target = folder / f"{len(list(folder.iterdir()))}-{address.rsplit('/', 1)[-1]}"
    with _opened(address) as source, target.open("wb") as copy:
        copyfileobj(source, copy)
    return target


def _opened(address: str) -> Any:
    try:
        fsspec: Any = import_module("fsspec")
    except ImportError:
        file_systems: Any = import_module("pyarrow.fs")
        system, path = file_systems.FileSystem.from_uri(address)
        return system.open_input_stream(path)
    return fsspec.open(address, "rb").open()
