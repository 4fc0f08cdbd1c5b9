"""Retentive memory on disk, written atomically so that the stored state is complete after a power failure."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

FORMAT = "transplanter-retentive-1"


class DamagedStoreError(ValueError):
    """Raised for a damaged store; its values are not used, and the message is one line that includes the remedy."""


class RetentiveStore(Protocol):
    """Storage of the battery-backed devices."""

    def load(self) -> dict[str, int] | None:
        """Return the most recently saved values; None if nothing has been saved."""
        ...

    def save(self, values: Mapping[str, int]) -> None:
        """Store the values; they are durable when the method returns."""
        ...


class MemoryStore:
    """Store in process memory, for machines in simulated time."""

    def __init__(self) -> None:
        self.values: dict[str, int] | None = None

    def load(self) -> dict[str, int] | None:
        """Return the most recently saved values; None if nothing has been saved."""
        return None if self.values is None else dict(self.values)

    def save(self, values: Mapping[str, int]) -> None:
        """Store a copy of the values."""
        self.values = dict(values)


class FileStore:
    """Store in one JSON file with a checksum.

    A new state is written to a temporary file in the same folder, synchronised to disk and renamed over the old one,
    so the file always contains either the old or the new state. Other damage is detected by the checksum.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def load(self) -> dict[str, int] | None:
        """Return the most recently saved values; None if the file does not exist.

        Raises:
            DamagedStoreError: The content of the file differs from what `save` wrote.
        """
        try:
            text = self.path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise self._damaged(error.strerror or str(error)) from error
        try:
            values = dict(json.loads(text)["values"])
            intact = text == _document(values)
        except (ValueError, KeyError, TypeError) as error:
            raise self._damaged("not a retentive store, or truncated") from error
        if not intact or not all(type(v) is int for v in values.values()):
            raise self._damaged("checksum or format does not match")
        return values

    def save(self, values: Mapping[str, int]) -> None:
        """Write the values so that they survive a power failure.

        Raises:
            OSError: Writing failed; the old state is unchanged.
        """
        self.path.parent.mkdir(parents=True, exist_ok=True)
        temporary = self.path.with_name(self.path.name + ".new")
        with temporary.open("wb") as file:
            file.write(_document(values))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(self.path)
        # the new name is part of the folder, which is stored separately
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def set_aside(self) -> Path:
        """Rename a damaged file and return its new path."""
        aside = self.path.with_name(self.path.name + ".damaged")
        self.path.replace(aside)
        return aside

    def _damaged(self, problem: str) -> DamagedStoreError:
        return DamagedStoreError(
            f"{self.path}: {problem}; retentive memory is lost; check rows and claws before resetting"
        )


def _document(values: Mapping[str, int]) -> bytes:
    """Return the file content for these values; `load` accepts no other content."""
    plain = dict(values)
    checksum = hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()
    return json.dumps({"format": FORMAT, "values": plain, "sha256": checksum}).encode()
