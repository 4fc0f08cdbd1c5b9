"""Calls of the operating system and of SQLite, recorded by kind; one of them can be made to fail.

The lowest function that Python code reaches is replaced: methods of sockets, with and without TLS, `open`, `os.fsync`,
`os.replace`, the functions of serial lines, and the connections of `sqlite3`. Files are watched in one folder, sockets
if they belong to the network, serial lines if they are named. `os.mkdir` is not watched: `pathlib` ignores its error if
the folder exists.
"""

from __future__ import annotations

import builtins
import errno
import fcntl
import io
import os
import socket
import sqlite3
import ssl
import termios
import threading
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from weakref import WeakKeyDictionary

import pytest

_UNNAMED: Final = getattr(os, "O_TMPFILE", 0)
_DELETED: Final = " (deleted)"
"""End of the path of a descriptor whose file has no name any more: an unplugged line, or a temporary file."""
PARTIAL: Final = "partial"
"""Fault of a call that transmits one byte instead of all."""

_SEND: Final = ("send",)
_RECEIVE: Final = ("recv", "recv_into")
_NETWORK: Final = ("accept", "connect", "connect_ex", "close", *_SEND, *_RECEIVE)
TLS: Final = "TLS client"
_TLS: Final = ("do_handshake", "send", "recv")
_FILE: Final = ("fsync", "replace", "open", "read", "write", "close")
_LINE: Final = {fcntl: ("ioctl",), termios: ("tcgetattr", "tcsetattr", "tcflush")}
"""Functions that set a serial line up, by module."""
_NOT_RETRIED: Final = frozenset({"connect", "connect_ex", "close", "replace"})
"""Calls that Python does not repeat itself after EINTR (PEP 475)."""
_SQLITE: Final = {
    "ENOSPC": ("database or disk is full", sqlite3.SQLITE_FULL),
    "EIO": ("disk I/O error", sqlite3.SQLITE_IOERR),
}
Place = tuple[int, int]
"""Scan of a call, counted over all runs, and its number among the calls of its kind in that scan."""


@dataclass(frozen=True, order=True)
class Kind:
    """Kind of a call.

    Attributes:
        party: Thread, connection or file that the call belongs to.
        call: Name of the function, or statement of SQLite.
        is_sql: True for a statement.
        is_line: True for a call of a serial line.
    """

    party: str
    call: str
    is_sql: bool = False
    is_line: bool = False

    @property
    def is_network(self) -> bool:
        """True for a call of a socket."""
        return self.call in (*_NETWORK, *_TLS) and not self.is_line and not self.party.startswith("var")

    def faults(self) -> tuple[str, ...]:
        """Return the faults of this kind: names of `errno`, or `PARTIAL`."""
        if self.is_sql:
            return ("ENOSPC", "EIO")
        if self.is_line:
            partial = (PARTIAL,) if self.call in ("read", "write") else ()
            return ("EIO", *partial, *(("EINTR",) if self.call in (*partial, "close") else ()))
        partial = (PARTIAL,) if self.call in (*_SEND, *_RECEIVE) else ()
        full = ("ENOSPC",) if self.call in ("open", "write", "flush", "fsync", "replace") else ()
        resources = ("EMFILE",) if self.call in ("accept", "open") else ()
        return ("EIO", *full, *resources, *partial, *(("EINTR",) if self.call in _NOT_RETRIED else ()))


@dataclass(frozen=True)
class Fault:
    """Fault of one call.

    Attributes:
        kind: Kind of the call.
        name: Name of `errno`, or `PARTIAL`.
        place: Place of the call; the first one at or after it fails.
        number: Number of the call among all of its kind, which fails also before its place; None = only the place
            counts. A thread may call in another scan than without the fault, but hardly more or less often.
    """

    kind: Kind
    name: str
    place: Place
    number: int | None = None

    def error(self) -> Exception:
        """Return the exception of the call."""
        if self.kind.is_sql:
            text, code = _SQLITE[self.name]
            error = sqlite3.OperationalError(text)
            error.sqlite_errorcode = code
            return error
        number = getattr(errno, self.name)
        if self.kind.is_line and self.kind.call in _LINE[termios]:
            return termios.error(number, os.strerror(number))
        return OSError(number, os.strerror(number))


@dataclass
class Calls:
    """Record of the calls of a run.

    Attributes:
        folder: Folder whose files are watched.
        fault: Fault to inject; None = none.
        ports: Names of the parties that connect to a port.
        lines: Names of the serial lines by the path of their device.
        at: Scan in which the run is.
        places: Places of the calls by kind, in order.
        has_struck: True if the fault has been injected.
    """

    folder: Path
    fault: Fault | None = None
    ports: dict[int, str] = field(default_factory=dict)
    lines: dict[str, str] = field(default_factory=dict)
    at: int = 0
    places: dict[Kind, list[Place]] = field(default_factory=lambda: defaultdict(list))
    has_struck: bool = False

    def __post_init__(self) -> None:
        self._lock = threading.Lock()
        self._parties: WeakKeyDictionary[socket.socket, str] = WeakKeyDictionary()

    def fails(self, kind: Kind) -> Fault | None:
        """Record a call and return the fault if it must fail."""
        with self._lock:
            places = self.places[kind]
            number = places[-1][1] + 1 if places and places[-1][0] == self.at else 0
            places.append((self.at, number))
            fault = self.fault
            if fault is None or self.has_struck or fault.kind != kind:
                return None
            if places[-1] < fault.place and len(places) - 1 != fault.number:
                return None
            self.has_struck = True
            return fault

    def check(self, kind: Kind) -> None:
        """Record a call and raise the error with which it must fail."""
        if fault := self.fails(kind):
            raise fault.error()

    def watch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Replace the functions until the end of a test."""
        for name in _NETWORK:
            monkeypatch.setattr(socket.socket, name, self._network(name, getattr(socket.socket, name)), raising=False)
        opened = self._opened(io.open)
        monkeypatch.setattr(io, "open", opened)
        monkeypatch.setattr(builtins, "open", opened)
        for name in _TLS:
            monkeypatch.setattr(ssl.SSLSocket, name, self._secured(name, getattr(ssl.SSLSocket, name)))
        for name in _FILE:
            monkeypatch.setattr(os, name, self._of_path(name, getattr(os, name)))
        for module, names in _LINE.items():
            for name in names:
                monkeypatch.setattr(module, name, self._of_path(name, getattr(module, name)))
        monkeypatch.setattr(sqlite3, "connect", self._connected(sqlite3.connect))

    def _network(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def watched(of: socket.socket, *arguments: Any) -> Any:
            if of.family not in (socket.AF_INET, socket.AF_INET6) or (name == "close" and of.fileno() < 0):
                return call(of, *arguments)
            if name in ("connect", "connect_ex"):
                self._parties[of] = self.ports.get(arguments[0][1], "")
            party = self._parties.get(of) or threading.current_thread().name
            if party == "telemetry" and threading.current_thread() is threading.main_thread():
                party = "field"
            if not (fault := self.fails(Kind(party, name))):
                return call(of, *arguments)
            if fault.name == PARTIAL:
                return _partial(of, name, call, arguments)
            if name == "close":
                call(of)  # the descriptor is released although an error is reported
            if name == "connect_ex":
                return getattr(errno, fault.name)
            raise fault.error()

        return watched

    def _secured(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def watched(of: ssl.SSLSocket, *arguments: Any) -> Any:
            if of.server_side or not (fault := self.fails(Kind(TLS, name))):
                return call(of, *arguments)
            if fault.name == PARTIAL:
                return _partial(of, name, call, arguments)
            raise fault.error()

        return watched

    def _opened(self, open_: Callable[..., Any]) -> Callable[..., Any]:
        def watched(file: Any, mode: str = "r", *arguments: Any, **options: Any) -> Any:
            if not (name := self._name(file)):
                return open_(file, mode, *arguments, **options)
            self.check(Kind(name, "open"))
            return WatchedFile(self, name, open_(file, mode, *arguments, **options))

        return watched

    def _of_path(self, call: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def watched(path: Any, *arguments: Any, **options: Any) -> Any:
            name = self._name(path)
            is_line = name in self.lines.values()
            if not name or (call == "open" and _is_unnamed(arguments[0])):
                return function(path, *arguments, **options)
            if fault := self.fails(Kind(name, call, is_line=is_line)):
                if fault.name == PARTIAL:
                    return function(path, arguments[0][:1] if call == "write" else 1)
                if call == "close":
                    function(path)  # the descriptor is released although an error is reported
                raise fault.error()
            return function(path, *arguments, **options)

        return watched

    def _connected(self, connect: Callable[..., sqlite3.Connection]) -> Callable[..., sqlite3.Connection]:
        def connection(party: str) -> type[sqlite3.Connection]:
            def check(call: str) -> None:
                self.check(Kind(party, call, is_sql=True))

            class Watched(sqlite3.Connection):
                def execute(self, sql: str, *values: Any) -> sqlite3.Cursor:
                    check(_statement(sql))
                    return super().execute(sql, *values)

                def executemany(self, sql: str, *values: Any) -> sqlite3.Cursor:
                    check(_statement(sql))
                    return super().executemany(sql, *values)

                def executescript(self, sql: str) -> sqlite3.Cursor:
                    check("script")
                    return super().executescript(sql)

                def __exit__(self, kind: Any, error: Any, traceback: Any) -> Any:
                    if kind is None:
                        try:
                            check("end of a transaction")
                        except sqlite3.Error:
                            self.rollback()
                            raise
                    return super().__exit__(kind, error, traceback)

            return Watched

        def watched(path: Any, *arguments: Any, **options: Any) -> sqlite3.Connection:
            if str(self.folder) not in str(path):
                return connect(path, *arguments, **options)
            party = "trends" if "trends" in str(path) else "history"
            self.check(Kind(party, "connect to the file", is_sql=True))
            return connect(path, *arguments, factory=connection(party), **options)

        return watched

    def _name(self, file: Any) -> str:
        """Return the name of a file of the folder, or of a serial line; an empty string for any other file."""
        if isinstance(file, int):
            try:
                file = os.readlink(f"/proc/self/fd/{file}")
            except OSError:
                return ""
        path = os.fspath(file)
        if not isinstance(path, str):
            return ""
        if self.lines and (name := self.lines.get(os.path.realpath(path).removesuffix(_DELETED))):
            return name
        if not path.startswith(str(self.folder)) or path.endswith(_DELETED):
            return ""
        return os.path.relpath(path, self.folder.parent)


class WatchedFile:
    """File whose calls are recorded."""

    def __init__(self, calls: Calls, name: str, file: Any) -> None:
        self._calls, self._name, self._file = calls, name, file

    def __enter__(self) -> WatchedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def read(self, *arguments: Any) -> Any:
        self._calls.check(Kind(self._name, "read"))
        return self._file.read(*arguments)

    def write(self, text: Any) -> Any:
        self._calls.check(Kind(self._name, "write"))
        return self._file.write(text)

    def flush(self) -> None:
        self._calls.check(Kind(self._name, "flush"))
        self._file.flush()

    def close(self) -> None:
        is_closed = self._file.closed
        self._file.close()
        if not is_closed:
            self._calls.check(Kind(self._name, "close"))


def _statement(sql: str) -> str:
    """Return the words that distinguish a statement."""
    words = sql.replace("(", " ").split()
    return " ".join(words[: 2 if words[0] == "PRAGMA" else 3])


def _is_unnamed(flags: int) -> bool:
    """Return True for a file without a name, with which the library of the locks finds out what the file system can."""
    return bool(_UNNAMED) and flags & _UNNAMED == _UNNAMED


def _partial(of: socket.socket, name: str, call: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    if name == "recv_into":
        return call(of, arguments[0], 1)
    return call(of, 1 if name == "recv" else memoryview(arguments[0])[:1])
