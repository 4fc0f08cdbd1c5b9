"""Recording file: one Parquet file, written in groups of rows and read by columns."""

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

from plant_sim.scope.errors import RecordingError

TIME = "time_ms"
"""Column of the plant time, ms."""

_ABOUT = b"seedling_transplanter"
_FORMAT = 1


class Writer:
    """Writer of a recording. Until `finish` is called, the file is named ``<name>.part``.

    Attributes:
        path: Path of the finished recording.
    """

    def __init__(self, path: Path) -> None:
        """Create the partial file.

        Args:
            path: Path of the recording; the file must not exist, its folder must.

        Raises:
            RecordingError: The file exists or cannot be written.
        """
        self.path = path
        if not path.name:
            raise RecordingError(f"{str(path)!r}: not a file name; use a name such as run.parquet")
        self._part = path.with_name(f"{path.name}.part")
        if path.exists():
            raise RecordingError(f"{path}: already exists; delete it or use another name")
        if not path.parent.is_dir():
            raise RecordingError(f"{path}: folder {path.parent} does not exist; create it or use another path")
        try:
            self._part.open("xb").close()
            self._file = _arrow_file(self._part, "wb")
        except FileExistsError:
            reason = "another run is writing it or was killed; delete it or use another name"
            raise RecordingError(f"{self._part}: already exists: {reason}") from None
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({_reason(error)}); use another path") from None
        self._table: pq.ParquetWriter | None = None
        self._failed = False

    def write(self, rows: pa.Table) -> None:
        """Append rows as one row group; the first group defines the columns.

        Raises:
            RecordingError: The rows cannot be written. The incomplete file is unreadable and is deleted.
        """
        if self._failed:
            return
        try:
            if self._table is None:
                self._table = _parquet(self._file, rows.schema)
            self._table.write_table(rows)
        except OSError as error:
            self._abandon()
            raise RecordingError(f"{self.path}: cannot be written ({_reason(error)}); free some disk space") from None

    def finish(self) -> None:
        """Complete the file and give it its final name; a recording without rows creates no file.

        Raises:
            RecordingError: The file cannot be written.
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
            raise RecordingError(f"{self.path}: cannot be completed ({_reason(error)}); free some disk space") from None

    def _abandon(self) -> None:
        self._failed = True
        for file in (self._table, self._file):
            with contextlib.suppress(OSError):
                if file is not None:
                    file.close()
        self._part.unlink(missing_ok=True)


def with_metadata(schema: pa.Schema, about: Mapping[str, Any]) -> pa.Schema:
    """Return a schema with metadata of the recording.

    Args:
        schema: The columns.
        about: Metadata, stored as JSON: seed, parameters, versions, sample period.
    """
    return schema.with_metadata({_ABOUT: json.dumps({"format": _FORMAT, **about}).encode()})


def _parquet(file: Any, schema: pa.Schema) -> pq.ParquetWriter:
    """Open a Parquet writer; splitting numbers into byte streams halves the file size for slow signals."""
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


class RecordingWindow(NamedTuple):
    """Time window of a recording in ms of plant time, including both ends."""

    from_ms: int
    to_ms: int


class Recording:
    """A finished recording.

    Attributes:
        path: Path of the file.
        about: Metadata of the recording.
        names: Columns in file order, excluding the time.
        units: Units of the numeric columns by name.
        labels: Terminals of the wire columns by name, such as ``Y5``.
    """

    def __init__(self, path: Path) -> None:
        """Open a recording.

        Args:
            path: Path of the file.

        Raises:
            RecordingError: The file does not exist or is not a recording.
        """
        self.path = path
        self._file = _open(path)
        schema = self._file.schema_arrow
        about = json.loads((schema.metadata or {}).get(_ABOUT, b"{}"))
        if about.get("format") != _FORMAT:
            raise RecordingError(f"{path}: not a recording of the plant; create one with --record")
        self.about: Mapping[str, Any] = MappingProxyType(about)
        self.names = [name for name in schema.names if name != TIME]
        self.units = _field_metadata(schema, b"unit")
        self.labels = _field_metadata(schema, b"terminal")
        self.time_ms: np.ndarray = self._file.read([TIME])[TIME].to_numpy()

    @property
    def full_window(self) -> RecordingWindow:
        """Window of the complete recording."""
        return RecordingWindow(int(self.time_ms[0]), int(self.time_ms[-1]))

    def read(self, names: Sequence[str], window: RecordingWindow | None = None) -> dict[str, np.ndarray]:
        """Return columns, with the sample times as `TIME`.

        Args:
            names: Columns to read; texts are returned as arrays of str, moves of seedlings as arrays of lists.
            window: Window to read; by default the complete recording.

        Raises:
            RecordingError: A column does not exist.
        """
        for name in names:
            if name not in self.names:
                raise RecordingError(f"{self.path}: {_unknown_column(name, self.names)}")
        first, last = self._rows(window or self.full_window)
        groups, skipped = self._groups(first, last)
        table = self._file.read_row_groups(groups, columns=[TIME, *names]).slice(first - skipped, last - first)
        return {name: _values(table[name]) for name in (TIME, *names)}

    def matching(self, patterns: Iterable[str]) -> list[str]:
        """Return the columns that match patterns, in the order of the patterns.

        Args:
            patterns: Names, or patterns such as ``y.left.*``.

        Raises:
            RecordingError: A pattern matches no column.
        """
        found: dict[str, None] = {}
        for pattern in patterns:
            names = [name for name in self.names if fnmatchcase(name, pattern)]
            if not names:
                raise RecordingError(f"{self.path}: {_unknown_column(pattern, self.names)}")
            found.update(dict.fromkeys(names))
        return list(found)

    def _rows(self, window: RecordingWindow) -> tuple[int, int]:
        first = int(np.searchsorted(self.time_ms, window.from_ms, "left"))
        return first, int(np.searchsorted(self.time_ms, window.to_ms, "right"))

    def _groups(self, first: int, last: int) -> tuple[list[int], int]:
        """Return the row groups that contain a range of rows, and the number of rows before them."""
        metadata = self._file.metadata
        ends = np.cumsum([metadata.row_group(group).num_rows for group in range(metadata.num_row_groups)])
        low = min(int(np.searchsorted(ends, first, "right")), len(ends) - 1)
        high = int(np.searchsorted(ends, max(last - 1, first), "right"))
        return list(range(low, min(high, len(ends) - 1) + 1)), int(ends[low - 1]) if low else 0


def _open(path: Path) -> pq.ParquetFile:
    if not path.is_file():
        raise RecordingError(f"{path}: file not found; use a recording created with --record")
    try:
        return pq.ParquetFile(_arrow_file(path, "rb"))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({_reason(error)}); use another file") from None
    except pa.ArrowInvalid:
        raise RecordingError(f"{path}: not a recording of the plant; create one with --record") from None


def _arrow_file(path: Path, mode: str) -> pa.OSFile:
    """Open a file; Arrow encodes a path given as text in UTF-8, which fails for the paths of another locale."""
    return pa.OSFile(os.fsencode(path), mode)


def _reason(error: OSError) -> str:
    """Return the reason for a system error in one line; Arrow states it in the first line of a longer text."""
    return os.strerror(error.errno) if error.errno else str(error).splitlines()[0]


def _field_metadata(schema: pa.Schema, key: bytes) -> dict[str, str]:
    return {field.name: field.metadata[key].decode() for field in schema if key in (field.metadata or {})}


def _values(column: pa.ChunkedArray) -> np.ndarray:
    if pa.types.is_dictionary(column.type):
        return np.array(column.to_pylist(), dtype=object)
    if pa.types.is_list(column.type):
        values = np.empty(len(column), dtype=object)
        values[:] = column.to_pylist()
        return values
    return np.asarray(column.to_numpy())


def _unknown_column(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    if near:
        return f"no column {name}; did you mean {near[0]}?"
    groups = sorted({f"{known_name.partition('.')[0]}.*" if "." in known_name else known_name for known_name in known})
    return f"no column {name}; valid columns are {', '.join(groups)}"
