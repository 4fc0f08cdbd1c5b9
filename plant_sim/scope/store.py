"""A recording on disk: one Parquet file, written in groups of rows, read by columns."""

from __future__ import annotations

import contextlib
import difflib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

#: Column of the plant time, ms.
TIME = "time_ms"
_ABOUT = b"seedling_transplanter"
_FORMAT = 1


class RecordingError(ValueError):
    """A recording cannot be written or read; the text is one line: which, what is wrong, remedy."""


class Writer:
    """Writes a recording. Until `finish` the file has the name ``<name>.part``.

    Attributes:
        path: Where the finished recording will lie.
    """

    def __init__(self, path: Path) -> None:
        """Take the place of the file.

        Args:
            path: Where the recording is to lie; there must be nothing. Its folder is made if need be, not those above.

        Raises:
            RecordingError: there is something, or nothing can be written there.
        """
        self.path = path
        if not path.name:
            raise RecordingError(f"{str(path)!r}: is no name for a file; give one, as run.parquet")
        self._part = path.with_name(f"{path.name}.part")
        if path.exists():
            raise RecordingError(f"{path}: is already there; delete it or give another name")
        try:
            if not path.parent.exists():
                path.parent.mkdir()
            self._part.open("xb").close()
            self._file = pa.OSFile(str(self._part), "wb")
        except FileExistsError:
            reason = "another run writes it or was killed; delete it or give another name"
            raise RecordingError(f"{self._part}: is already there: {reason}") from None
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({_reason(error)}); give another place") from None
        self._table: pq.ParquetWriter | None = None
        self._failed = False

    def write(self, rows: pa.Table) -> None:
        """Append rows as a group of their own; the first ones decide on the columns.

        Raises:
            RecordingError: the disk refuses. Nothing can be read without its end, so nothing is left.
        """
        if self._failed:
            return
        try:
            if self._table is None:
                self._table = _parquet(self._file, rows.schema)
            self._table.write_table(rows)
        except OSError as error:
            self._abandon()
            raise RecordingError(f"{self.path}: cannot be written ({_reason(error)}); make room") from None

    def finish(self) -> None:
        """Complete the file and give it its name; of a recording without rows nothing is left.

        Raises:
            RecordingError: the disk refuses.
        """
        if self._failed:
            return
        if self._table is None:
            self._abandon()
            return
        try:
            self._table.close()
            self._file.close()
            self._part.replace(self.path)
        except OSError as error:
            self._abandon()
            raise RecordingError(f"{self.path}: cannot be completed ({_reason(error)}); make room") from None

    def _abandon(self) -> None:
        self._failed = True
        for file in (self._table, self._file):
            with contextlib.suppress(OSError):
                if file is not None:
                    file.close()
        self._part.unlink(missing_ok=True)


def described(schema: pa.Schema, about: Mapping[str, Any]) -> pa.Schema:
    """Return a schema that says what its columns were recorded from.

    Args:
        schema: The columns.
        about: What a reader is to know, as JSON: seed, parameters, versions, sample period.
    """
    return schema.with_metadata({_ABOUT: json.dumps({"format": _FORMAT, **about}).encode()})


def _parquet(file: Any, schema: pa.Schema) -> pq.ParquetWriter:
    """Open a writer; numbers as separate streams of bytes, which for slow signals halves the file."""
    texts = [field.name for field in schema if pa.types.is_dictionary(field.type)]
    numbers = [field.name for field in schema if pa.types.is_floating(field.type)]
    return pq.ParquetWriter(
        file,
        schema,
        compression="zstd",
        use_dictionary=texts,
        use_byte_stream_split=numbers,
        write_statistics=[TIME],
    )


class Window(NamedTuple):
    """A part of a recording, both ends included, ms of plant time."""

    from_ms: int
    to_ms: int


class Recording:
    """A finished recording.

    Attributes:
        path: Where it lies.
        about: What its writer said about it.
        names: Its columns in their order, without the time.
        units: Unit of every number by column.
        labels: Terminal of every tag, as ``Y5``, by column.
    """

    def __init__(self, path: Path) -> None:
        """Open a recording.

        Args:
            path: Where it lies.

        Raises:
            RecordingError: there is none, or the file is something else.
        """
        self.path = path
        self._file = _opened(path)
        schema = self._file.schema_arrow
        about = json.loads((schema.metadata or {}).get(_ABOUT, b"{}"))
        if about.get("format") != _FORMAT:
            raise RecordingError(f"{path}: is no recording of the plant; make one with --record")
        self.about: Mapping[str, Any] = MappingProxyType(about)
        self.names = [name for name in schema.names if name != TIME]
        self.units = _noted(schema, b"unit")
        self.labels = _noted(schema, b"terminal")
        self.time_ms: np.ndarray = self._file.read([TIME])[TIME].to_numpy()

    @property
    def whole(self) -> Window:
        """All of it."""
        return Window(int(self.time_ms[0]), int(self.time_ms[-1]))

    def read(self, names: Sequence[str], window: Window | None = None) -> dict[str, np.ndarray]:
        """Return columns, and the time of their samples as `TIME`.

        Args:
            names: The columns; texts come as arrays of str, moves of seedlings as arrays of lists.
            window: The part; all of it by default.

        Raises:
            RecordingError: there is no such column.
        """
        for name in names:
            if name not in self.names:
                raise RecordingError(f"{self.path}: {_no_such(name, self.names)}")
        first, last = self._rows(window or self.whole)
        groups, skipped = self._groups(first, last)
        table = self._file.read_row_groups(groups, columns=[TIME, *names]).slice(first - skipped, last - first)
        return {name: _values(table[name]) for name in (TIME, *names)}

    def matching(self, patterns: Iterable[str]) -> list[str]:
        """Return the columns that patterns name, in the order of the patterns.

        Args:
            patterns: Names, or patterns as ``y.left.*``.

        Raises:
            RecordingError: one names no column.
        """
        found: dict[str, None] = {}
        for pattern in patterns:
            names = [name for name in self.names if fnmatchcase(name, pattern)]
            if not names:
                raise RecordingError(f"{self.path}: {_no_such(pattern, self.names)}")
            found.update(dict.fromkeys(names))
        return list(found)

    def _rows(self, window: Window) -> tuple[int, int]:
        first = int(np.searchsorted(self.time_ms, window.from_ms, "left"))
        return first, int(np.searchsorted(self.time_ms, window.to_ms, "right"))

    def _groups(self, first: int, last: int) -> tuple[list[int], int]:
        """The row groups that hold some rows, and how many rows lie before them."""
        metadata = self._file.metadata
        ends = np.cumsum([metadata.row_group(group).num_rows for group in range(metadata.num_row_groups)])
        low = min(int(np.searchsorted(ends, first, "right")), len(ends) - 1)
        high = int(np.searchsorted(ends, max(last - 1, first), "right"))
        return list(range(low, min(high, len(ends) - 1) + 1)), int(ends[low - 1]) if low else 0


def _opened(path: Path) -> pq.ParquetFile:
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such file; give a recording made with --record")
    try:
        return pq.ParquetFile(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({_reason(error)}); give another file") from None
    except pa.ArrowInvalid:
        raise RecordingError(f"{path}: is no recording of the plant; make one with --record") from None


def _reason(error: OSError) -> str:
    """Why the system refuses, in a line; Arrow tells it at the end of a longer text."""
    return os.strerror(error.errno) if error.errno else str(error).splitlines()[0]


def _noted(schema: pa.Schema, key: bytes) -> dict[str, str]:
    return {field.name: field.metadata[key].decode() for field in schema if key in (field.metadata or {})}


def _values(column: pa.ChunkedArray) -> np.ndarray:
    if pa.types.is_dictionary(column.type):
        return np.array(column.to_pylist(), dtype=object)
    if pa.types.is_list(column.type):
        values = np.empty(len(column), dtype=object)
        values[:] = column.to_pylist()
        return values
    return np.asarray(column.to_numpy())


def _no_such(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    if near:
        return f"has no {name}; did you mean {near[0]}?"
    groups = sorted({f"{known_name.partition('.')[0]}.*" if "." in known_name else known_name for known_name in known})
    return f"has no {name}; there are {', '.join(groups)}"
