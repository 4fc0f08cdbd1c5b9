"""Model of a disk: the operations of a program on one folder, and every state in which a crash may leave it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations, product
from pathlib import Path
from typing import Any

import pytest

Files = Mapping[str, bytes]
"""Content of a folder: the files by name."""

SUBSETS_OF = 4
"""Number of names of which any may be lost; all earlier ones are kept, because their subsets are too many."""


@dataclass
class Inode:
    """File without its name.

    Attributes:
        durable: Content that survives a crash.
        pending: Contents since the last synchronisation, the newest last; any of them may be on the disk.
    """

    durable: bytes = b""
    pending: list[bytes] = field(default_factory=list)

    @property
    def newest(self) -> bytes:
        return self.pending[-1] if self.pending else self.durable

    def contents(self) -> set[bytes]:
        """Return the contents that a crash may leave: each of them, or a part of the newest one."""
        whole = {self.durable, *self.pending}
        return whole | {self.newest[: len(self.newest) // 2]} if self.pending else whole


@dataclass(frozen=True)
class Naming:
    """Change of the names in the folder: an inode gets a name, and loses its old one."""

    inode: Inode | None
    name: str
    old_name: str = ""

    def apply(self, names: dict[str, Inode]) -> None:
        if self.old_name and names.get(self.old_name) is self.inode:
            del names[self.old_name]
        if self.inode is not None:
            names[self.name] = self.inode


class Disk:
    """Folder whose operations are carried out and recorded.

    A write without a synchronisation of its file may be lost, partial or complete; of the names that were given since
    the last synchronisation of the folder, any subset may be lost.

    Attributes:
        seen: Progress of the program and content of the folder, for every state in which a crash may leave it.
        note: Progress of the program, recorded with each state.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._durable: dict[str, Inode] = {path.name: Inode(path.read_bytes()) for path in folder.iterdir()}
        self._names = dict(self._durable)
        self._pending: list[Naming] = []
        self.seen: list[tuple[Any, frozenset[tuple[str, bytes]]]] = []
        self.note: Any = None

    def states(self) -> Iterator[Files]:
        """Yield every content of the folder that a crash may leave now."""
        older, newer = self._pending[:-SUBSETS_OF], self._pending[-SUBSETS_OF:]
        for count in range(len(newer) + 1):
            for kept in combinations(newer, count):
                names = dict(self._durable)
                for naming in (*older, *kept):
                    naming.apply(names)
                visible = {name: inode for name, inode in names.items() if not name.endswith(".new")}
                for contents in product(*(inode.contents() for inode in visible.values())):
                    yield dict(zip(visible, contents, strict=True))

    def record(self) -> None:
        """Record the states before the next operation, and after the last one."""
        found = {frozenset(files.items()) for files in self.states()}
        self.seen += [(self.note, files) for files in sorted(found, key=sorted)]

    def named(self, naming: Naming) -> None:
        naming.apply(self._names)
        self._pending.append(naming)

    def watch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Record the operations of the functions of the operating system on this folder."""
        fsync, replace, open_ = os.fsync, Path.replace, Path.open

        def recorded_fsync(descriptor: int) -> None:
            self.record()
            fsync(descriptor)
            path = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
            if path == self.folder:
                self._durable, self._pending = dict(self._names), []
            else:
                inode = self._names[path.name]
                inode.durable, inode.pending = inode.newest, []

        def recorded_replace(path: Path, target: Path) -> Path:
            self.record()
            self.named(Naming(self._names[path.name], target.name, path.name))
            return replace(path, target)

        def recorded_open(path: Path, mode: str = "r", *arguments: Any, **options: Any) -> Any:
            file = open_(path, mode, *arguments, **options)
            return RecordedFile(self, path, file) if mode == "wb" and path.parent == self.folder else file

        monkeypatch.setattr(os, "fsync", recorded_fsync)
        monkeypatch.setattr(Path, "replace", recorded_replace)
        monkeypatch.setattr(Path, "open", recorded_open)

    def create(self, name: str) -> Inode:
        """Create a file, or truncate the one with this name."""
        self.record()
        if (inode := self._names.get(name)) is None:
            inode = Inode()
            self.named(Naming(inode, name))
        inode.pending.append(b"")
        return inode


class RecordedFile:
    """File that is written; its content reaches the disk model when it is flushed or closed."""

    def __init__(self, disk: Disk, path: Path, file: Any) -> None:
        self._disk, self._file = disk, file
        self._inode = disk.create(path.name)
        self._buffer = b""

    def __enter__(self) -> RecordedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.flush()
        self._file.close()

    def write(self, text: bytes) -> None:
        self._buffer += text
        self._file.write(text)

    def flush(self) -> None:
        if self._buffer:
            self._disk.record()
            self._inode.pending.append(self._inode.newest + self._buffer)
            self._buffer = b""
        self._file.flush()

    def fileno(self) -> int:
        return int(self._file.fileno())
