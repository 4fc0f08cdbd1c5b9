"""File format of captured field traffic: a header, then one line per change.

::

    transplanter-capture 1
    made_by: seedling-transplanter 0.1.0
    source: controller
    io_map: 5b1f...                        SHA-256 of the wires (controller/iomap/digest.py)
    inputs: 22
    outputs: 18
    scan_ms: 10
    input_filter_ms: 10
    begun_utc: 2026-11-23T19:00:00Z
    memory: {"D200": 0}                    devices written before the first scan
    ---
    0 X 20022                              X image, hexadecimal: bit n is the level of X number n
    0 Y 0                                  Y image written
    1280 W M100 1                          device written before the scan (order, set-point, status)
    1280 H 1                               from here the outputs are not those of the program (safe, or held)
    2040 S 2010                            scan that does not follow the previous one, at 2010, after scan_ms
    9990 E                                 end: the last scan

Times are those of the scan in ms; with the source ``proxy``, they are the times of the answers, there is no memory, and
W, H and S do not occur.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import queue
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Final, Self, TextIO

from controller.common.errors import InputError
from controller.common.supervision.failures import Reaction, drop, failed
from controller.common.supervision.threads import supervised

_log = logging.getLogger(__name__)

FIRST_LINE: Final = "transplanter-capture 1"
CONTROLLER: Final = "controller"
PROXY: Final = "proxy"
SOURCES: Final = (CONTROLLER, PROXY)
_DIVIDER: Final = "---"
_ENTRY: Final = re.compile(r"(\d{1,12}) ([XYWHSE])(?: (\S{1,80}))?(?: (-?\d{1,6}))?")


def new_file_problem(path: Path) -> str:
    """Return the reason for which a file cannot be created, before anything is started; empty = none known."""
    if path.exists():
        return os.strerror(errno.EEXIST)
    if not path.parent.is_dir():
        return os.strerror(errno.ENOENT)
    return "" if os.access(path.parent, os.W_OK) else os.strerror(errno.EACCES)


class CaptureError(InputError):
    """Raised for an invalid capture; the message is one line with file, line, key and remedy."""


@dataclass(frozen=True)
class CaptureHeader:
    """Header of a capture.

    Attributes:
        made_by: Program and version.
        source: ``controller`` or ``proxy``.
        io_map: Digest of the I/O map.
        inputs: Length of an X image.
        outputs: Length of a Y image.
        scan_ms: Scan period, ms; 0 for a proxy.
        input_filter_ms: Input filter, ms; 0 for a proxy.
        begun_utc: Begin.
        memory: Values of the devices written before the first scan, by name.
    """

    made_by: str
    source: str
    io_map: str
    inputs: int
    outputs: int
    scan_ms: int
    input_filter_ms: int
    begun_utc: str
    memory: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class CaptureEntry:
    """Line of a capture.

    Attributes:
        line: Line number, from 1.
        at_ms: Time, ms.
        kind: Letter of the kind.
        image: Image, for X and Y.
        device: Name of the device, for W.
        value: Value of the device for W, 1 or 0 for H, or time of the previous scan for S, ms.
    """

    line: int
    at_ms: int
    kind: str
    image: tuple[bool, ...] = ()
    device: str = ""
    value: int = 0


@dataclass(frozen=True)
class Capture:
    """Capture read from a file.

    Attributes:
        path: Path of the file.
        header: Header.
        entries: Lines in the order of the file.
        is_closed: True if the capture ends with E; False after a loss of power or a killed process.
    """

    path: Path
    header: CaptureHeader
    entries: tuple[CaptureEntry, ...]
    is_closed: bool

    @property
    def end_ms(self) -> int:
        """Time of the last line, ms."""
        return self.entries[-1].at_ms if self.entries else 0

    def check_map(self, digest: str) -> None:
        """Check that the capture belongs to an I/O map.

        Raises:
            CaptureError: It belongs to another one.
        """
        if self.header.io_map != digest:
            line = 2 + list(asdict(self.header)).index("io_map")
            raise CaptureError(
                f"{self.path}:{line}: io_map: the capture belongs to another I/O map; specify it with --io-map"
            )


class CaptureWriter:
    """Writer of a capture in a thread, so that the scan does not wait for the disk."""

    def __init__(self, path: Path, header: CaptureHeader) -> None:
        """Create the file.

        Raises:
            CaptureError: The file exists or cannot be written.
        """
        try:
            self._file: TextIO = path.open("x", encoding="utf-8", newline="\n")
        except OSError as error:
            raise CaptureError(f"{path}: {error.strerror}; choose a new file in a writable folder") from error
        self._images: dict[str, tuple[bool, ...]] = {}
        self._last_ms = 0
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self.put_header(header)
        self._thread = supervised("capture", self._write)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Write the end and close the file."""
        self._put(self._last_ms, "E")
        self._lines.put(None)
        self._thread.join()

    def put_header(self, header: CaptureHeader) -> None:
        """Write the header."""
        values = {**asdict(header), "memory": json.dumps(header.memory, sort_keys=True)}
        self._lines.put("\n".join([FIRST_LINE, *(f"{key}: {value}" for key, value in values.items()), _DIVIDER]))

    def image(self, at_ms: int, kind: str, image: Sequence[bool]) -> None:
        """Write an image, kind X or Y, if it differs from the previous one."""
        self._last_ms = at_ms
        levels = tuple(image)
        if self._images.get(kind) != levels:
            self._images[kind] = levels
            self._put(at_ms, f"{kind} {sum(1 << number for number, level in enumerate(levels) if level):x}")

    def write(self, at_ms: int, device: str, value: int) -> None:
        """Write a value written to a device."""
        self._put(at_ms, f"W {device} {value}")

    def hold(self, at_ms: int, *, held: bool) -> None:
        """Write that the outputs are, or are no longer, other than those of the program."""
        self._put(at_ms, f"H {held:d}")

    def irregular(self, at_ms: int, previous_ms: int) -> None:
        """Write that a scan does not follow the previous one after one period."""
        self._put(at_ms, f"S {previous_ms}")

    def _put(self, at_ms: int, text: str) -> None:
        self._lines.put(f"{at_ms} {text}")

    def _write(self) -> None:
        """Write the lines; after an error, for example a full disk, the capture ends and the machine continues."""
        line: str | None = ""
        try:
            with self._file as file:
                while (line := self._lines.get()) is not None:
                    file.write(f"{line}\n")
                    if self._lines.empty():
                        file.flush()
        except Exception as error:  # noqa: BLE001 - whatever it is, the queue must not grow
            if isinstance(error, OSError):
                _log.error("capture %s ends here: %s", self._file.name, error.strerror)
            else:
                failed("capture", Reaction.END, error)
            while line is not None:
                drop("capture")
                line = self._lines.get()


def read_capture(path: Path) -> Capture:
    """Read a capture.

    Raises:
        CaptureError: The file cannot be read or is invalid.
    """
    try:
        lines = path.read_text(encoding="utf-8").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise CaptureError(f"{path}: {reason}; specify a capture of 'run --capture' or 'capture record'") from error
    header = _header(path, lines)
    first = lines.index(_DIVIDER) + 1
    complete = lines[first:-1]  # the last line ends the file or was not completed
    entries = tuple(_entries(path, complete, first + 1, header))
    closed = bool(entries) and entries[-1].kind == "E"
    return Capture(path, header, entries, closed)


def _header(path: Path, lines: Sequence[str]) -> CaptureHeader:
    if lines[0] != FIRST_LINE:
        raise CaptureError(f"{path}:1: file: does not begin with '{FIRST_LINE}'; specify a capture of this version")
    keys = list(CaptureHeader.__dataclass_fields__)
    values: dict[str, str] = {}
    for number, key in enumerate(keys, 2):
        text = lines[number - 1] if number <= len(lines) else ""
        found, colon, value = text.partition(": ")
        if found != key or not colon:
            raise CaptureError(f"{path}:{number}: {key}: is missing; write '{key}: VALUE' or capture again")
        values[key] = value
    if lines[len(keys) + 1 : len(keys) + 2] != [_DIVIDER]:
        raise CaptureError(f"{path}:{len(keys) + 2}: file: '{_DIVIDER}' is missing after the header; capture again")
    numbers = {key: _number(path, 2 + keys.index(key), key, values[key]) for key in keys if _is_number(key)}
    if values["source"] not in SOURCES:
        problem = f"{values['source']!r} is unknown; write one of {', '.join(SOURCES)}"
        raise CaptureError(f"{path}:{2 + keys.index('source')}: source: {problem}")
    return CaptureHeader(
        made_by=values["made_by"],
        source=values["source"],
        io_map=values["io_map"],
        begun_utc=values["begun_utc"],
        memory=_memory(path, 2 + keys.index("memory"), values["memory"]),
        **numbers,
    )


def _is_number(key: str) -> bool:
    return key in {"inputs", "outputs", "scan_ms", "input_filter_ms"}


def _number(path: Path, line: int, key: str, text: str) -> int:
    if not re.fullmatch(r"\d{1,4}", text):
        raise CaptureError(f"{path}:{line}: {key}: {text!r} is not a number from 0 to 9999; capture again")
    return int(text)


def _memory(path: Path, line: int, text: str) -> dict[str, int]:
    try:
        memory = json.loads(text)
    except ValueError:
        memory = None
    if not isinstance(memory, dict) or not all(type(value) is int for value in memory.values()):
        raise CaptureError(f"{path}:{line}: memory: is not an object of integers; capture again")
    return memory


def _entries(path: Path, lines: Sequence[str], first: int, header: CaptureHeader) -> Iterator[CaptureEntry]:
    length = {"X": header.inputs, "Y": header.outputs}
    before_ms, ended = 0, False
    for number, text in enumerate(lines, first):
        match = _ENTRY.fullmatch(text)
        if match is None or ended:
            problem = "follows the end" if ended else f"{text[:40]!r} is not a line of a capture"
            raise CaptureError(f"{path}:{number}: file: {problem}; see docs/commissioning.md, or capture again")
        at_ms, kind, word, value = int(match[1]), match[2], match[3], match[4]
        if at_ms < before_ms:
            raise CaptureError(f"{path}:{number}: {kind}: time {at_ms} is before {before_ms}; capture again")
        before_ms, ended = at_ms, kind == "E"
        yield _entry(path, number, at_ms, kind, (word, value), length=length.get(kind, 0))


def _entry(
    path: Path, line: int, at_ms: int, kind: str, words: tuple[str | None, str | None], *, length: int
) -> CaptureEntry:
    word, value = words
    expected = {"X": 1, "Y": 1, "W": 2, "H": 1, "S": 1, "E": 0}[kind]
    if sum(each is not None for each in words) != expected:
        raise CaptureError(f"{path}:{line}: {kind}: takes {expected} values; capture again")
    if kind in "XY":
        bits = int(word, 16) if re.fullmatch(r"[0-9a-f]{1,64}", word or "") and word else -1
        if not 0 <= bits < 1 << length:
            raise CaptureError(f"{path}:{line}: {kind}: {word!r} is not an image of {length} bits; capture again")
        return CaptureEntry(line, at_ms, kind, image=tuple(bool(bits >> number & 1) for number in range(length)))
    if kind == "H" and word not in ("0", "1"):
        raise CaptureError(f"{path}:{line}: H: {word!r} is not 0 or 1; capture again")
    if kind == "S" and not (re.fullmatch(r"\d{1,12}", word or "") and int(word or 0) < at_ms):
        raise CaptureError(f"{path}:{line}: S: {word!r} is not the time of an earlier scan; capture again")
    if kind == "W" and value is None:
        raise CaptureError(f"{path}:{line}: W: takes a device and a value; capture again")
    return CaptureEntry(line, at_ms, kind, device=word or "", value=int((value if kind == "W" else word) or 0))
