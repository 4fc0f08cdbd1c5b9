"""Retentive memory on disk, written atomically, with two marks that detect an old or copied file."""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Protocol

from controller.common.errors import InputError
from controller.common.files.set_aside import set_aside

FORMAT: Final = "transplanter-retentive-2"
MARK_FORMAT: Final = "transplanter-retentive-mark-1"
FORMER_FORMAT: Final = "transplanter-retentive-1"
"""Format of earlier versions, which had no marks."""
MARK: Final = ".mark"
"""Ending of the name of the second file."""
UNCONFIRMED: Final = -1
"""Mark B of a store that has none yet; its first mark, 0, precedes its first memory, 1."""


class DamagedStoreError(ValueError):
    """Raised for a damaged, old or copied store; its values are not used.

    The message is one line that includes the remedy.
    """


class NewerStoreError(InputError):
    """Raised for a store of a newer program, which is not changed; the message is one line with the remedy."""


class RetentiveStore(Protocol):
    """Storage of the battery-backed devices."""

    def load(self) -> dict[str, int] | None:
        """Return the most recently saved values; None if nothing has been saved."""
        ...

    def save(self, values: Mapping[str, int]) -> None:
        """Store the values; they are durable when the method returns."""
        ...

    def confirm(self) -> None:
        """Record that the last save is complete; nothing waits for this."""
        ...

    def close(self) -> None:
        """Record that the run ended in order and that the last save is complete."""
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

    def confirm(self) -> None:
        """Do nothing, because there is no file that can be exchanged."""

    def close(self) -> None:
        """Do nothing, because there is no file that can be exchanged."""


class FileStore:
    """Store in one JSON file with a checksum, and a second file with its mark.

    A new state is written to a temporary file in the same folder, synchronised to disk and renamed over the old one,
    so each file always contains either its old or its new state. Other damage is detected by the checksum.

    Both files contain the identity of the store, which is random, and its generation, which each save increases by one.
    The generation of the memory is mark A, that of the second file is mark B. They are written in a fixed order: B is
    equal to A before the next A is written. B = A and B = A - 1 are therefore the results of a run, at whatever moment
    it was killed; with any other pair, one of the files is an old copy. Mark B also states whether the run has ended.

    Attributes:
        path: File with the values and mark A.
        mark_path: File with mark B, `<name>.mark` in the same folder.
        interrupted: True if the loaded memory is that of a run that did not end in order.
        missing: True if nothing had been saved when the store was loaded.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.mark_path = path.with_name(path.name + MARK)
        self.interrupted = False
        self.missing = False
        self._identity: str | None = None
        """Identity of the store; None until its files have been read."""
        self._generation = 0
        self._confirmed = UNCONFIRMED

    def load(self) -> dict[str, int] | None:
        """Return the most recently saved values; None if nothing has been saved.

        Raises:
            DamagedStoreError: The content of a file differs from what was written, or the memory is not the one that
                was saved last.
            NewerStoreError: A file was written by a newer program.
        """
        memory, mark = self._read(self.path, FORMAT), self._read(self.mark_path, MARK_FORMAT)
        if memory is None:
            if mark is not None and mark["generation"] != 0:
                raise self._lost(self.path, f"missing, although {self.mark_path.name} exists")
            self.missing = True
            self._adopt(secrets.token_hex(16), 0, UNCONFIRMED)
            return None
        values: dict[str, int] = memory["values"]
        if mark is None:
            raise self._lost(self.path, f"{self.mark_path.name} is missing, so it may be an old copy")
        if mark["store"] != memory["store"]:
            raise self._lost(self.path, f"memory of another machine: {self.mark_path.name} belongs to another store")
        generation, confirmed = memory["generation"], mark["generation"]
        if confirmed not in (generation, generation - 1):
            raise self._lost(
                self.path if confirmed > generation else self.mark_path,
                f"an old copy: the mark says {confirmed}, the memory says {generation}",
            )
        self.interrupted = mark["open"] or confirmed != generation
        self._adopt(memory["store"], generation, confirmed)
        return values

    def save(self, values: Mapping[str, int]) -> None:
        """Write the values and mark A so that they survive a power failure; complete mark B of the last save first.

        Raises:
            DamagedStoreError: The store has not been loaded, and cannot be.
            OSError: Writing failed; the old state is unchanged.
        """
        if self._identity is None:
            self.load()
        self.confirm()
        self._write(
            self.path,
            {"format": FORMAT, "store": self._identity, "generation": self._generation + 1, "values": dict(values)},
        )
        self._generation += 1

    def confirm(self) -> None:
        """Write mark B of the last save.

        Raises:
            OSError: Writing failed; the next save writes the mark first.
        """
        if self._confirmed != self._generation:
            self._write_mark(is_open=True)

    def close(self) -> None:
        """Write mark B of the last save, and that the run has ended in order.

        Raises:
            OSError: Writing failed; the next start reports a run that did not end in order.
        """
        if self._identity is not None:
            self._write_mark(is_open=False)

    def set_aside(self) -> tuple[Path, ...]:
        """Rename the files, so that a new store begins, and return their new paths."""
        asides = set_aside(self.path, ("", MARK))
        self._identity = None
        self._adopt(secrets.token_hex(16), 0, UNCONFIRMED)
        return asides

    def _adopt(self, identity: str, generation: int, confirmed: int) -> None:
        """Continue the store that was read. Once it is in use, this object knows it better than a reader."""
        if self._identity is None:
            self._identity, self._generation, self._confirmed = identity, generation, confirmed

    def _read(self, path: Path, format_: str) -> dict[str, Any] | None:
        """Return the content of a file; None if it does not exist."""
        try:
            text = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise self._lost(path, error.strerror or str(error)) from error
        try:
            content = dict(json.loads(text))
            if content["format"] == FORMER_FORMAT:
                raise self._lost(path, "memory of an earlier version, without marks")
            _refuse_newer(path, str(content["format"]), format_)
            del content["sha256"]
            intact = text == _document(content) and content["format"] == format_ and _has_its_parts(content)
        except (DamagedStoreError, NewerStoreError):
            raise
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise self._lost(path, "not a retentive store, or truncated") from error
        if not intact:
            raise self._lost(path, "checksum or format does not match")
        return content

    def _write_mark(self, *, is_open: bool) -> None:
        self._write(
            self.mark_path,
            {"format": MARK_FORMAT, "store": self._identity, "generation": self._generation, "open": is_open},
        )
        self._confirmed = self._generation

    def _write(self, path: Path, content: Mapping[str, Any]) -> None:
        """Replace a file; its old state remains if the power fails."""
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(path.name + ".new")
        with temporary.open("wb") as file:
            file.write(_document(content))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        # the new name is part of the folder, which is stored separately
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    @staticmethod
    def _lost(path: Path, problem: str) -> DamagedStoreError:
        return DamagedStoreError(f"{path}: {problem}; retentive memory is lost; check rows and claws before resetting")


def _has_its_parts(content: Mapping[str, Any]) -> bool:
    """Return True if a file has the keys and types of its format."""
    numbers = [content["generation"]]
    if content["format"] == FORMAT:
        numbers += content["values"].values()
    return isinstance(content["store"], str) and all(type(number) is int for number in numbers)


def _refuse_newer(path: Path, found: str, known: str) -> None:
    """Raise `NewerStoreError` for a format with a higher number than the known one."""
    name, _, number = known.rpartition("-")
    found_name, _, found_number = found.rpartition("-")
    if found_name == name and re.fullmatch("[0-9]{1,6}", found_number) and int(found_number) > int(number):
        raise NewerStoreError(
            f"{path}: format {found} is newer than {known} of this program; use the program version that wrote the "
            "file, or rename it and check rows and claws: the retentive memory is then lost"
        )


def _document(content: Mapping[str, Any]) -> bytes:
    """Return the file with this content and its checksum; a reader accepts no other text."""
    checksum = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return json.dumps({**content, "sha256": checksum}).encode()
