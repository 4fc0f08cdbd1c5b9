"""PLC whose inputs, writes and outputs are captured, and the replay of a capture on a PLC."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from controller.common.capture import CONTROLLER, Capture, CaptureEntry, CaptureError, CaptureHeader, CaptureWriter
from controller.core.devices import DeviceError
from controller.core.expr import Bit, Word
from controller.core.program import Program
from controller.core.scan import Plc

_DEVICE: Final = re.compile(r"(M|S|D|TN|CN|T|C)(\d{1,4})")


def captured_name(device: Bit | Word) -> str:
    """Return the name of a device in a capture; TN246 and CN100 are current values."""
    return f"{device.kind}N{device.number}" if isinstance(device, Word) and device.kind in "TC" else str(device)


def captured_device(name: str) -> Bit | Word:
    """Return the device of a name in a capture.

    Raises:
        ValueError: There is no such device.
    """
    match = _DEVICE.fullmatch(name)
    if match is None:
        raise ValueError(f"{name!r} is not a device")
    kind, number = match[1], int(match[2])
    try:
        return Word(kind[0], number) if kind == "D" or kind.endswith("N") else Bit(kind, number)
    except DeviceError as error:
        raise ValueError(str(error)) from error


class CapturedPlc(Plc):
    """PLC that notes what a scan depends on; `begin` starts the capture."""

    _writer: CaptureWriter | None = None

    def __init__(self, program: Program, *, input_filter_ms: int) -> None:
        """Start the PLC; see `Plc`."""
        self.written: dict[str, int] = {}
        self._pending: list[tuple[str, int]] = []
        self._image: list[bool] = []
        self._now_ms: int | None = None
        self._is_held = False
        super().__init__(program, input_filter_ms=input_filter_ms)

    def begin(self, open_writer: Callable[[dict[str, int]], CaptureWriter], *, scan_ms: int) -> CaptureWriter:
        """Start the capture after the memory has been restored.

        Args:
            open_writer: Function that opens the file, given the values of the devices written so far.
            scan_ms: Scan period, ms.
        """
        self._scan_ms = scan_ms
        self._writer = open_writer(self.written)
        return self._writer

    def write(self, device: Bit | Word, value: int) -> None:
        """Write a device, and note it."""
        super().write(device, value)
        if self._writer is None:
            self.written[captured_name(device)] = int(value)
        else:
            self._pending.append((captured_name(device), int(value)))

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        """Run one scan, and note its inputs."""
        writer = self._writer
        if writer is not None:
            if self._now_ms is not None and now_ms != self._now_ms + self._scan_ms:
                writer.irregular(now_ms, self._now_ms)
            self._now_ms = now_ms
            for name, value in self._pending:
                writer.write(now_ms, name, value)
            self._pending.clear()
            writer.image(now_ms, "X", levels)
        self._image = super().scan(now_ms, levels)
        return self._image

    def released(self, now_ms: int, outputs: Sequence[bool]) -> None:
        """Note the outputs that have been written after a scan."""
        if self._writer is None:
            return
        self._writer.image(now_ms, "Y", outputs)
        held = list(outputs) != self._image[: len(outputs)]
        if held != self._is_held:
            self._is_held = held
            self._writer.hold(now_ms, held=held)


@dataclass(frozen=True, slots=True)
class ReplayDifference:
    """First difference of a replay.

    Attributes:
        scan: Number of the scan, from 1.
        at_ms: Time of the scan, ms.
        line: Line of the capture that contains the Y image.
        captured: Captured Y image.
        replayed: Y image of the program.
    """

    scan: int
    at_ms: int
    line: int
    captured: tuple[bool, ...]
    replayed: tuple[bool, ...]


def replay(capture: Capture, plc: Plc) -> tuple[int, ReplayDifference | None]:
    """Scan a program with captured inputs until its outputs differ; return the number of scans and the difference.

    The last scan of a capture that was not closed may lack its outputs and is not compared.

    Raises:
        CaptureError: The capture has no scans of a controller, or an unknown device.
    """
    if capture.header.source != CONTROLLER:
        raise CaptureError(
            f"{capture.path}:3: source: a capture of a proxy does not contain the scans and the memory of the program; "
            "use 'run --capture', or replay it against the plant with 'plant_sim replay'"
        )
    for name, value in capture.header.memory.items():
        plc.write(_device(capture, list(CaptureHeader.__dataclass_fields__).index("memory") + 2, name), value)
    count = 0
    levels: tuple[bool, ...] = ()
    outputs, line, held = tuple([False] * capture.header.outputs), 0, False
    for at_ms, entries in _scans(capture):
        for entry in entries:
            if entry.kind == "W":
                plc.write(_device(capture, entry.line, entry.device), entry.value)
            elif entry.kind == "X":
                levels = entry.image
            elif entry.kind == "Y":
                outputs, line = entry.image, entry.line
            elif entry.kind == "H":
                held = bool(entry.value)
        count += 1
        image = tuple(plc.scan(at_ms, levels)[: len(outputs)])
        is_whole = capture.is_closed or at_ms < capture.end_ms
        if is_whole and not held and image != outputs:
            return count, ReplayDifference(count, at_ms, line, outputs, image)
    return count, None


def _scans(capture: Capture) -> Iterator[tuple[int, Sequence[CaptureEntry]]]:
    """Yield the time and the lines of every scan."""
    by_time: dict[int, list[CaptureEntry]] = {}
    for entry in capture.entries:
        by_time.setdefault(entry.at_ms, []).append(entry)
    irregular = [entry for entry in capture.entries if entry.kind == "S"]
    if not by_time:
        return
    step_ms = max(1, capture.header.scan_ms)
    begins = [min(by_time), *(entry.at_ms for entry in irregular)]
    ends = [*(entry.value for entry in irregular), capture.end_ms]
    for begin_ms, last_ms in zip(begins, ends, strict=True):
        for at_ms in range(begin_ms, last_ms + 1, step_ms):
            yield at_ms, by_time.get(at_ms, [])


def _device(capture: Capture, line: int, name: str) -> Bit | Word:
    try:
        return captured_device(name)
    except ValueError as error:
        raise CaptureError(f"{capture.path}:{line}: {name}: {error}; capture again") from error
