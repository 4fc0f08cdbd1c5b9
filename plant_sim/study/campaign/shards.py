"""Folder of result files: Parquet files named by the checksum of their content."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from plant_sim.common.provenance.provenance import KEY, Provenance
from plant_sim.study.campaign.file import Campaign
from plant_sim.study.campaign.record import COLUMNS, Record
from plant_sim.study.errors import StudyError

Notice = Callable[[str], None]
"""Callback with a message of one line."""

_ABOUT: Final = b"seedling_transplanter_campaign"
_FORMAT: Final = 1
_DIGITS: Final = 32
_TYPES: Final = {
    "bool": pa.bool_(),
    "int32": pa.int32(),
    "double": pa.float64(),
    "string": pa.string(),
    "texts": pa.list_(pa.string()),
    "counts": pa.map_(pa.string(), pa.int32()),
    "cycle_times": pa.list_(
        pa.struct([("row", pa.string()), ("cycles", pa.int32()), ("mean_s", pa.float64()), ("waiting_s", pa.float64())])
    ),
}


def shard_schema(campaign: Campaign, version: str, provenance: Provenance | None = None) -> pa.Schema:
    """Return the columns of the result files of a campaign.

    Args:
        campaign: The campaign.
        version: Version of the program.
        provenance: Provenance that the files carry.
    """
    design = campaign.design
    # in the order of their names, so that a level that becomes a fixed value does not change the columns
    varied = sorted((*design.fixed, *design.parameters), key=lambda each: each.name)
    fields = [
        pa.field("key", pa.string()),
        pa.field("version", pa.string()),
        pa.field("trial", pa.int32()),
        pa.field("seed", pa.int64()),
        *(_field(each.name, pa.float64(), each.unit) for each in varied),
        pa.field("faults", pa.string()),
        *(_field(name, _TYPES[kind], unit) for name, (kind, unit) in COLUMNS.items()),
    ]
    about = {"format": _FORMAT, "version": version}
    metadata = {_ABOUT: json.dumps(about)} | ({} if provenance is None else {KEY: provenance.text})
    return pa.schema(fields, metadata=metadata)


@dataclass(frozen=True, slots=True)
class StoredRuns:
    """Runs in the result files.

    Attributes:
        keys: Keys of the runs.
        incomplete: Number of trials that did not complete.
    """

    keys: set[str]
    incomplete: int


@dataclass(frozen=True, slots=True)
class ShardFolder:
    """Result files of one campaign and one version of the program.

    The folder ``runs`` contains the files of this version only; those of other versions are in
    ``other-versions/<version>``. The name of a file is the checksum of its content, so a file that was damaged is
    recognised. A file is written under a temporary name and renamed when it is complete.

    Attributes:
        path: Folder of the campaign.
        version: Version of the program.
        schema: Columns of the files.
    """

    path: Path
    version: str
    schema: pa.Schema

    @property
    def runs(self) -> Path:
        """Folder of the files of this version."""
        return self.path / "runs"

    def files(self) -> list[Path]:
        """Return the files of this version."""
        return sorted(self.runs.glob("*.parquet"))

    def scan(self, notice: Notice) -> StoredRuns:
        """Return the stored runs; rename damaged files, and move files of other versions.

        Args:
            notice: Callback that reports every file or version that is not used.

        Raises:
            StudyError: The folder cannot be read or changed.
        """
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
            for part in self.runs.glob("*.part"):  # of a process that was killed
                part.unlink()
            self._restore()
            return self._scan(notice)
        except OSError as error:
            raise self._failed(error) from None

    def write(self, records: Sequence[Record]) -> None:
        """Write runs as one file, completely or not at all.

        Raises:
            StudyError: The file cannot be written.
        """
        table = pa.Table.from_pylist(list(records), self.schema)
        buffer = io.BytesIO()
        pq.write_table(table, buffer, compression="zstd")
        path = self.runs / f"{_checksum(buffer.getbuffer())}.parquet"
        part = path.with_suffix(".part")
        try:
            with part.open("wb") as file:
                file.write(buffer.getbuffer())
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
            _sync_folder(self.runs)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise self._failed(error) from None

    def _restore(self) -> None:
        """Move the files of this version back from the folder of other versions."""
        others = self.path / "other-versions" / self.version
        if others.is_dir():
            for path in others.glob("*.parquet"):
                path.replace(self.runs / path.name)
            others.rmdir()

    def _scan(self, notice: Notice) -> StoredRuns:
        keys: set[str] = set()
        incomplete = 0
        moved: dict[str, int] = {}
        for path in self.files():
            try:
                version, table = _read(path)
            except _DamagedFileError as error:
                path.replace(path.with_name(f"{path.name}.damaged"))
                notice(f"{path}: {error}; renamed to {path.name}.damaged, and its runs are computed again")
                continue
            if version != self.version:
                moved[version] = moved.get(version, 0) + len(table)
                self._move(path, version)
                continue
            own = set(table["key"].to_pylist())
            if len(own) < len(table) or own & keys:
                path.replace(path.with_name(f"{path.name}.damaged"))
                notice(f"{path}: repeats runs of another file; renamed to {path.name}.damaged")
                continue
            keys |= own
            incomplete += table["completed"].to_pylist().count(False)
        for version, count in moved.items():
            notice(
                f"{self.path}: {count} runs of version {version} moved to other-versions; this is version "
                f"{self.version}, which computes them again"
            )
        return StoredRuns(keys, incomplete)

    def _move(self, path: Path, version: str) -> None:
        folder = self.path / "other-versions" / version
        folder.mkdir(parents=True, exist_ok=True)
        path.replace(folder / path.name)

    def _failed(self, error: OSError) -> StudyError:
        reason = error.strerror or str(error).splitlines()[0]
        return StudyError(
            f"--out {self.path}: cannot be written ({reason}); free some disk space or use another folder"
        )


class _DamagedFileError(ValueError):
    """File that is not as it was written."""


def _read(path: Path) -> tuple[str, pa.Table]:
    """Return the version of a result file, and the keys of its runs with their completion.

    Raises:
        _DamagedFileError: The file is not as it was written.
        OSError: The file cannot be read.
    """
    content = path.read_bytes()
    if path.name != f"{_checksum(content)}.parquet":
        raise _DamagedFileError(
            f"is damaged or incomplete ({len(content)} bytes do not match the checksum in its name)"
        )
    try:
        file = pq.ParquetFile(io.BytesIO(content))
        about = json.loads(file.schema_arrow.metadata[_ABOUT])
        return str(about["version"]), file.read(["key", "completed"])
    except (pa.ArrowException, KeyError, TypeError, ValueError):
        raise _DamagedFileError("is not a result file of a campaign") from None


def _checksum(content: bytes | memoryview) -> str:
    return hashlib.sha256(content).hexdigest()[:_DIGITS]


def _field(name: str, kind: pa.DataType, unit: str) -> pa.Field:
    return pa.field(name, kind, metadata=None if unit == "-" else {"unit": unit})


def _sync_folder(path: Path) -> None:
    """Write the names in a folder to the disk, so that they survive a power failure."""
    if os.name == "nt":  # a folder cannot be opened there
        return
    folder = os.open(path, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
