"""Files of other file systems, such as `s3://bucket/day1.rnx`."""

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
        import fsspec
    except ImportError:
        from pyarrow import fs

        system, path = fs.FileSystem.from_uri(address)
        return system.open_input_stream(path)
    return fsspec.open(address, "rb").open()
