"""Tables whose columns are numpy arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kurs import _native
from kurs._whole import whole_file

#: Codes of words and the words; -1 stands for none.
Words = tuple[NDArray[np.int32], list[str]]


class Table(Mapping[str, NDArray[Any]]):
    """Columns (n,) by name, in the order of the command line's CSV files.

    Numbers are float64 with NaN for "not available", or int64; instants are datetime64[ns] on the scale that the
    column's name tells; words are strings, the empty one for none. `words` gives them as codes of a dictionary.
    """

    def __init__(self, columns: Mapping[str, NDArray[Any] | Words]) -> None:
        self._columns = dict(columns)

    @classmethod
    def read_csv(cls, path: str | PathLike[str]) -> Table:
        """Columns of a CSV file that a command wrote."""
        return cls(_native.read_table(str(path)))

    def __getitem__(self, name: str) -> NDArray[Any]:
        column = self._columns[name]
        if isinstance(column, tuple):
            codes, words = column
            return np.array([*words, ""], dtype=np.str_)[codes]
        return column

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        """Number of columns; `rows` is the number of rows."""
        return len(self._columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        first = next(iter(self._columns.values()), np.empty(0))
        return len(first[0] if isinstance(first, tuple) else first)

    def words(self, name: str) -> Words:
        """Codes (n,), -1 for none, and the words of a column of words."""
        column = self._columns[name]
        if not isinstance(column, tuple):
            raise TypeError(f"{name} is a column of numbers")
        return column

    def __repr__(self) -> str:
        return f"Table({self.rows} rows: {', '.join(self)})"

    def to_arrow(self) -> Any:
        """The same as pyarrow.Table: NaN becomes null, words are dictionaries."""
        pa: Any = import_module("pyarrow")

        def arrow(column: NDArray[Any] | Words) -> Any:
            if isinstance(column, tuple):
                codes, words = column
                small = codes.astype(np.uint8 if len(words) < 255 else np.int32)
                return pa.DictionaryArray.from_arrays(pa.array(small, mask=codes < 0), pa.array(words, pa.string()))
            if column.dtype.kind == "f":
                missing = np.isnan(column)
                return pa.array(column, mask=missing) if missing.any() else pa.array(column)
            return pa.array(column)

        return pa.table({name: arrow(column) for name, column in self._columns.items()})

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """The same for whoever takes Arrow, by pyarrow, or by nanoarrow (words are strings then) where that is not there."""
        try:
            table = self.to_arrow()
        except ModuleNotFoundError:
            table = _struct(self._columns, self.rows)
        stream: object = table.__arrow_c_stream__(requested_schema)
        return stream

    def to_pandas(self) -> Any:
        """The same as pandas.DataFrame: words are categories."""
        pd: Any = import_module("pandas")

        def series(column: NDArray[Any] | Words) -> Any:
            if isinstance(column, tuple):
                return pd.Categorical.from_codes(column[0], categories=column[1])
            return column

        return pd.DataFrame({name: series(column) for name, column in self._columns.items()})

    def to_polars(self) -> Any:
        """The same as polars.DataFrame: NaN becomes null, words are categories."""
        pl: Any = import_module("polars")

        def series(name: str, column: NDArray[Any] | Words) -> Any:
            if isinstance(column, tuple):
                codes, words = column
                texts = pl.Series(name, [*words, None], dtype=pl.String)
                return texts.gather(np.where(codes < 0, len(words), codes)).cast(pl.Categorical)
            return pl.Series(name, column, nan_to_null=column.dtype.kind == "f")

        return pl.DataFrame([series(name, column) for name, column in self._columns.items()])

    def to_parquet(self, path: str | PathLike[str]) -> None:
        """Writes a Parquet file through pyarrow; it appears whole or not at all."""
        parquet: Any = import_module("pyarrow.parquet")
        with whole_file(path) as temporary:
            parquet.write_table(self.to_arrow(), temporary)


def _struct(columns: Mapping[str, NDArray[Any] | Words], rows: int) -> Any:
    """The columns as a nanoarrow.c_array_stream of one struct."""
    na: Any = import_module("nanoarrow")

    def array(column: NDArray[Any] | Words) -> tuple[Any, Any]:
        if isinstance(column, tuple):
            codes, words = column
            texts = [word.encode() for word in (*words, "")]
            ends = np.concatenate([[0], np.cumsum([len(texts[code]) for code in codes])]).astype(np.int32)
            return na.string(), [_bits(codes >= 0), ends, b"".join(texts[code] for code in codes)]
        if column.dtype.kind == "f":
            return na.float64(), [_bits(~np.isnan(column)), column]
        if column.dtype.kind == "M":
            return na.timestamp("ns"), [None, column.view(np.int64)]
        return getattr(na, column.dtype.name)(), [None, column]

    arrays = {name: array(column) for name, column in columns.items()}
    children = [na.c_array_from_buffers(kind, rows, buffers) for kind, buffers in arrays.values()]
    schema = na.struct({name: kind for name, (kind, _) in arrays.items()})
    return na.c_array_stream(na.c_array_from_buffers(schema, rows, [None], children=children))


def _bits(is_there: NDArray[np.bool_]) -> NDArray[np.uint8] | None:
    """Which values are there, a bit for each; nothing if all are."""
    return None if is_there.all() else np.packbits(is_there, bitorder="little")
