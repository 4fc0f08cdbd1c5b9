"""FX program that runs in real time while communication partners read and write its devices.

As in a simulator of the programming tool, all devices are writable. A written X is the level of the input terminal
until it is written again; the input filter applies. A Y, M, S, T or C that the program drives keeps a written value
only until the program drives it again. Writes take effect at the start of the next scan and return at its end, reads
return the memory at END of the last.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from controller.common.mitsubishi.devices import FIRST_32_BIT_COUNTER, Device
from controller.common.stop_request import Stop
from controller.core.devices import EXTENSION, RUN_MONITOR, SIZES
from controller.fx.engine.plc import FxPlc
from controller.hmi.serving.devices import (
    AccessRefusal,
    AccessRefusedError,
    check_bits,
    check_value,
    check_words,
    taken,
    word_index,
    words_of_counters,
)
from controller.hmi.serving.snapshot import RELEASE, HeldSnapshot, Snapshots, snapshot_of
from controller.io.pace import Pace
from controller.io.scan_writes import ScanWrites

_SIGN_16: Final = 0x8000
_SIGN_32: Final = 0x8000_0000
_STOPPED: Final = (False, True, False, True)
"""M8000-M8003 of a PLC in STOP: a real one answers 0Ah there (bomingfeng/Fx2N, doc: recordings of GPPW)."""


class LivePlc:
    """Program with the writes of its partners.

    Attributes:
        plc: Simulated PLC.
        snapshots: Memory after the last two scans.
        writes: Writes of all partners.
    """

    def __init__(self, plc: FxPlc) -> None:
        """Initialise with all inputs off.

        Args:
            plc: Simulated PLC.
        """
        self.plc = plc
        self.snapshots = Snapshots()
        self._levels = [False] * SIZES["X"]
        self._scanned_ms = 0
        self.writes = ScanWrites()

    def session(self, _peer: str) -> LiveSession:
        """Return the access of a new communication partner."""
        return LiveSession(self)

    def scan(self, now_ms: int) -> None:
        """Apply the writes and execute one scan.

        Args:
            now_ms: Time of the scan, ms.
        """
        if self.plc.is_sampled:  # timer interrupts; the terminals change at the scans only
            for at_ms in range(self._scanned_ms + 1, now_ms):
                self.plc.sample(at_ms, self._levels)
        self._scanned_ms = now_ms
        self.plc.cpu.now_ms = now_ms  # timer values written now must refer to this scan
        self.writes.take()
        self.plc.scan(now_ms, self._levels)
        latest = snapshot_of(self.plc.memory, now_ms, self.plc.scans)
        if not self.plc.running:
            latest.bits["M"][RUN_MONITOR : RUN_MONITOR + len(_STOPPED)] = _STOPPED
        self.snapshots.add(latest)
        self.writes.settle()

    def put_bits(self, levels: Sequence[tuple[Device, bool]]) -> None:
        """Write bits now; X at the terminals."""
        for device, level in levels:
            bits = self._levels if device.kind == "X" else self.plc.memory.bits(device.kind)
            bits[device.number] = level

    def put_words(self, values: Sequence[tuple[Device, int]]) -> None:
        """Write signed words now."""
        for device, value in values:
            if device.kind == "TN":
                self.plc.cpu.set_timer(device.number, value)
            else:
                self.plc.memory.set_word("C" if device.kind == "CN" else device.kind, device.number, value)


class LiveSession:
    """Devices of a live program as its partners may read and write them."""

    has_name = False
    """A live program has no register for the name of an operator."""

    def __init__(self, live: LivePlc) -> None:
        """Initialise the session of a partner.

        Args:
            live: The program.
        """
        self._live = live
        self._cpu = live.plc.ladder.cpu
        self.snapshot = HeldSnapshot(live.snapshots)

    @property
    def is_running(self) -> bool:
        """True if the PLC is in RUN."""
        return self._live.plc.running

    def on_request(self) -> None:
        """Do nothing: the program does not wait for its partners."""

    def on_disconnect(self) -> None:
        """Read the last scan again; written values remain."""
        self.snapshot.request(RELEASE)

    def read_bits(self, first: Device, count: int) -> list[bool]:
        """Return consecutive bits of the last scan, or of the one that is held."""
        check_bits(first, count, self._cpu)
        return self.snapshot.read().bits[first.kind][first.number : first.number + count]

    def read_words(self, first: Device, count: int) -> list[int]:
        """Return consecutive words of the last scan, or of the one that is held, unsigned."""
        check_words(first, count, cpu=self._cpu)
        words, start = self.snapshot.read().words["D" if first.kind == "R" else first.kind], first.number
        if first.kind == "R":
            start += EXTENSION
        elif first.kind == "CN":
            words, start = words_of_counters(words), word_index(start)
        return [word & 0xFFFF for word in words[start : start + count]]

    async def write_bits(self, levels: Sequence[tuple[Device, bool]]) -> None:
        """Write bits in the next scan."""
        for device, _ in levels:
            check_bits(device, 1, self._cpu)
        await taken(self._live.writes.submit(lambda: self._live.put_bits(levels)))

    async def write_words(self, values: Sequence[tuple[Device, int]]) -> None:
        """Write words in the next scan."""
        signed = []
        for device, value in values:
            check_value(device, cpu=self._cpu)
            is_long = device.kind == "CN" and device.number >= FIRST_32_BIT_COUNTER
            signed.append((device, _signed(value, _SIGN_32 if is_long else _SIGN_16)))
        await taken(self._live.writes.submit(lambda: self._live.put_words(signed)))

    async def set_running(self, *, running: bool) -> None:
        """Put the PLC into RUN or STOP before the next scan; RUN also ends a stop by an error."""
        plc = self._live.plc

        def change() -> None:
            if running and not plc.running:
                plc.run()
            elif plc.running and not running:
                plc.stop()

        await taken(self._live.writes.submit(change))

    def refused(self, _what: str, _value: str, refusal: AccessRefusal) -> AccessRefusedError:
        """Return the error of a refused write; there is no audit log."""
        return AccessRefusedError(refusal)


def run_live(
    live: LivePlc, pace: Pace, *, scan_ms: int, stop: Stop, on_scan: Callable[[LivePlc], None] = lambda _live: None
) -> int:
    """Scan until `stop` is set and return the number of scans.

    Args:
        live: The program.
        pace: Speed of its time.
        scan_ms: Scan period, ms; M8039 and D8039 can make it longer.
        stop: Event that ends the loop.
        on_scan: Function called after each scan.
    """
    now_ms = scans = period_ms = 0
    while pace.wait(period_ms, stop):
        now_ms += period_ms
        live.scan(now_ms)
        on_scan(live)
        scans += 1
        period_ms = max(scan_ms, live.plc.constant_scan_ms)
    return scans


def _signed(value: int, sign: int) -> int:
    return value - 2 * sign if value & sign else value
