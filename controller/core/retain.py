"""Retentive memory on disk: whole or not at all, whenever the power goes."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

FORMAT = "transplanter-retentive-1"


class DamagedStoreError(ValueError):
    """The store exists but cannot be trusted; nothing of it is used. One line, with file and remedy."""


class RetentiveStore(Protocol):
    """Keeps the battery-backed devices."""

    def load(self) -> dict[str, int] | None:
        """Return what was saved last; None if nothing was ever saved."""
        ...

    def save(self, values: Mapping[str, int]) -> None:
        """Keep the values; they are safe when this returns."""
        ...


class MemoryStore:
    """A store that lives as long as the process: for machines in simulated time."""

    def __init__(self) -> None:
        self.values: dict[str, int] | None = None

    def load(self) -> dict[str, int] | None:
        """Return what was saved last."""
        return None if self.values is None else dict(self.values)

    def save(self, values: Mapping[str, int]) -> None:
        """Keep a copy of the values."""
        self.values = dict(values)


class FileStore:
    """A store in one file of JSON with a checksum.

    A new state is written beside the old one, forced to the disk and renamed over it, so at any moment the
    file is the old state or the new one. A file that was damaged otherwise fails its checksum.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def load(self) -> dict[str, int] | None:
        """Return what was saved last; None if the file does not exist.

        Raises:
            DamagedStoreError: The file is not what `save` wrote.
        """
        try:
            text = self.path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise self._damaged(error.strerror or str(error)) from error
        try:
            values = dict(json.loads(text)["values"])
            whole = text == _document(values)
        except (ValueError, KeyError, TypeError) as error:
            raise self._damaged("not a retentive store, or cut short") from error
        if not whole or not all(type(v) is int for v in values.values()):
            raise self._damaged("checksum or format does not match")
        return values

    def save(self, values: Mapping[str, int]) -> None:
        """Write the values so that they survive the loss of power.

        Raises:
            OSError: The disk refuses; the old state is still there.
        """
        self.path.parent.mkdir(parents=True, exist_ok=True)
        beside = self.path.with_name(self.path.name + ".new")
        with beside.open("wb") as file:
            file.write(_document(values))
            file.flush()
            os.fsync(file.fileno())
        beside.replace(self.path)
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def set_aside(self) -> Path:
        """Move a damaged file out of the way and return its new name."""
        aside = self.path.with_name(self.path.name + ".damaged")
        self.path.replace(aside)
        return aside

    def _damaged(self, what: str) -> DamagedStoreError:
        return DamagedStoreError(
            f"{self.path}: {what}; retentive memory is lost, check rows and claws before resetting"
        )


def _document(values: Mapping[str, int]) -> bytes:
    """Return the one text of these values; `load` trusts no other."""
    kept = dict(values)
    checksum = hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()
    return json.dumps({"format": FORMAT, "values": kept, "sha256": checksum}).encode()
