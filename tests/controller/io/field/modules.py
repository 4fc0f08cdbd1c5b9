"""Simulated I/O modules, written from the documents of the modules and independently of the client.

Sources: Modbus Application Protocol V1.1b3; Beckhoff EK9000 and BK7300, Modbus interface; WAGO 750 manuals, MODBUS
functions; Moxa ioThinx 4510 manual, 4-8. Assumed where these are silent: the exception codes of a locked or tripped
module, and that the write lock ends with the connection of its owner.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable

POINTS = 64
BUSY, FAILURE = 6, 4


class RefusedWrite(Exception):  # noqa: N818
    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class Box:
    """Module with bits: inputs in discrete inputs, outputs in coils. Time is advanced by the test.

    Attributes:
        inputs: Levels of the input terminals.
        outputs: Levels of the output terminals.
        requests: PDU of every request, in order.
        silent: True to answer nothing.
        before_answer: Function called with every request before it is executed.
    """

    def __init__(self) -> None:
        self.inputs = [False] * POINTS
        self.outputs = [False] * POINTS
        self.requests: list[bytes] = []
        self.silent = False
        self.before_answer: Callable[[bytes], None] = lambda pdu: None
        self.lock = threading.RLock()

    def read(self, table: str, offset: int) -> int:
        return int({"di": self.inputs, "co": self.outputs}[table][offset])

    def write(self, table: str, offset: int, value: int, client: object) -> None:
        if table != "co":
            raise KeyError(offset)
        self.outputs[offset] = bool(value)

    def on_write_done(self, function: int, client: object) -> None:
        """Note a write that was executed completely."""

    def on_disconnect(self, client: object) -> None:
        """Note the end of a connection."""

    def advance(self, for_ms: int) -> None:
        """Advance the time of the module."""

    def answer(self, pdu: bytes, client: object) -> bytes | None:
        self.before_answer(pdu)
        with self.lock:
            self.requests.append(pdu)
            try:
                reply = self._execute(pdu, client)
            except RefusedWrite as refused:
                reply = bytes([pdu[0] | 0x80, refused.code])
            except (KeyError, IndexError):
                reply = bytes([pdu[0] | 0x80, 2])
        return None if self.silent else reply

    def _execute(self, pdu: bytes, client: object) -> bytes:
        function = pdu[0]
        if function in (1, 2):
            first, count = struct.unpack(">HH", pdu[1:5])
            bits = [self.read("co" if function == 1 else "di", first + n) for n in range(count)]
            packed = bytearray((count + 7) // 8)
            for n, bit in enumerate(bits):
                packed[n // 8] |= bit << n % 8
            return bytes([function, len(packed)]) + packed
        if function in (3, 4):
            first, count = struct.unpack(">HH", pdu[1:5])
            return bytes([function, 2 * count]) + self._words("hr" if function == 3 else "ir", first, count)
        if function in (5, 6):
            offset, value = struct.unpack(">HH", pdu[1:5])
            self.write("co" if function == 5 else "hr", offset, value, client)
        elif function == 15:
            first, count = struct.unpack(">HH", pdu[1:5])
            for n in range(count):
                self.write("co", first + n, pdu[6 + n // 8] >> n % 8 & 1, client)
        elif function == 16:
            first, count = struct.unpack(">HH", pdu[1:5])
            for n in range(count):
                self.write("hr", first + n, int.from_bytes(pdu[6 + 2 * n : 8 + 2 * n]), client)
        elif function == 23:
            read_first, read_count, first, count = struct.unpack(">HHHH", pdu[1:9])
            for n in range(count):
                self.write("hr", first + n, int.from_bytes(pdu[10 + 2 * n : 12 + 2 * n]), client)
            self.on_write_done(function, client)
            return bytes([function, 2 * read_count]) + self._words("hr", read_first, read_count)
        else:
            return bytes([function | 0x80, 1])
        self.on_write_done(function, client)
        return pdu[:5]

    def _words(self, table: str, first: int, count: int) -> bytes:
        return b"".join(self.read(table, first + n).to_bytes(2) for n in range(count))


def word_of(levels: list[bool], register: int) -> int:
    """Return 16 points as a register, the first one in the lowest bit."""
    return sum(1 << bit for bit in range(16) if levels[16 * register + bit])


class Coupler(Box):
    """Coupler with 16 points in each register and an output watchdog.

    Attributes:
        trips: Number of trips.
        is_tripped: True until the trip is reset.
        writes: Values written to the registers other than outputs, in order.
        model: Registers by table and offset in which it reports its model.
    """

    outputs_at = 0x0000
    watchdog_ms = 0

    def __init__(self) -> None:
        super().__init__()
        self.trips = 0
        self.is_tripped = self.is_armed = False
        self.left_ms = 0
        self.writes: list[tuple[int, int]] = []
        self.model: dict[str, dict[int, int]] = {}

    def advance(self, for_ms: int) -> None:
        with self.lock:
            self.left_ms -= for_ms
            if self.is_armed and self.left_ms <= 0:
                self.is_armed, self.is_tripped = False, True
                self.trips += 1
                self.outputs = [False] * POINTS
                self.on_trip()

    def on_trip(self) -> None:
        """Note a trip."""

    def read(self, table: str, offset: int) -> int:
        if offset < POINTS // 16:
            return word_of(self.inputs, offset)
        if offset in self.model.get(table, {}):
            return self.model[table][offset]
        if table == "hr" and offset in self.settings():
            return self.settings()[offset]
        raise KeyError(offset)

    def settings(self) -> dict[int, int]:
        """Return the registers of the module by offset; a plain coupler has none."""
        return {}

    def write(self, table: str, offset: int, value: int, client: object) -> None:
        if table == "hr" and self.outputs_at <= offset < self.outputs_at + POINTS // 16:
            if self.is_tripped:
                raise RefusedWrite(FAILURE)
            for bit in range(16):
                self.outputs[16 * (offset - self.outputs_at) + bit] = bool(value >> bit & 1)
        elif table == "hr" and offset in self.settings():
            self.writes.append((offset, value))
            self.set(offset, value)
        else:
            raise KeyError(offset)

    def set(self, offset: int, value: int) -> None:
        """Write one of the registers of `settings`."""
        raise KeyError(offset)

    def serve(self) -> None:
        if not self.is_tripped and self.watchdog_ms:
            self.is_armed, self.left_ms = True, self.watchdog_ms


class Beckhoff(Coupler):
    """Beckhoff coupler: EK9000 with write lock and trip counter, or BK9000 without them.

    Attributes:
        owner: Client that has the write lock.
    """

    outputs_at = 0x0800

    def __init__(self, *, has_lock: bool = True) -> None:
        super().__init__()
        self.has_lock = has_lock
        self.owner: object = None
        self.time_ms, self.kind, self.fallback, self.write_lock = 1_000, 1, 1, 0
        text = b"EK9000\0\0\0\0\0\0\0\0" if has_lock else b"BK9000\0\0\0\0\0\0\0\0"
        words = struct.unpack("<7H", text)  # the order of the bytes is assumed; the controller only compares them
        self.model = {"ir": {0x1000 + n: word for n, word in enumerate(words)}}
        self._code = 0

    def settings(self) -> dict[int, int]:
        found = {0x0800 + n: word_of(self.outputs, n) for n in range(POINTS // 16)} | {
            0x100C: 0x8000 * self.is_tripped,
            0x1020: max(0, self.left_ms),
            0x1120: self.time_ms,
            0x1121: 0,
            0x1122: self.kind,
        }
        return found | ({0x1021: self.trips, 0x1123: self.fallback, 0x1124: self.write_lock} if self.has_lock else {})

    def set(self, offset: int, value: int) -> None:
        if offset == 0x1121:
            if (self._code, value) == (0xBECF, 0xAFFE):
                self.is_tripped = False
            self._code = value
        elif offset == 0x1120 and self.is_armed:
            raise RefusedWrite(FAILURE)
        elif offset == 0x1120:
            self.time_ms = value
        elif offset == 0x1122:
            self.kind = value
        elif offset == 0x1123:
            self.fallback = value
        elif offset == 0x1124:
            self.write_lock = value

    def write(self, table: str, offset: int, value: int, client: object) -> None:
        if offset >= self.outputs_at and offset < 0x1000 and self.write_lock:
            if self.owner not in (None, client):
                raise RefusedWrite(BUSY)
            self.owner = client
        super().write(table, offset, value, client)

    def on_write_done(self, function: int, client: object) -> None:
        if function in (16, 23) and not self.is_tripped:
            self.watchdog_ms = self.time_ms
            self.serve()

    def on_trip(self) -> None:
        self.owner = None

    def on_disconnect(self, client: object) -> None:
        if self.owner is client:
            self.owner = None


class Wago(Coupler):
    """WAGO 750 coupler: the watchdog runs once it is triggered; outputs are read 0x0200 above."""

    def __init__(self) -> None:
        super().__init__()
        self.time_units, self.mask, self.trigger = 0, 0, 0
        self.model = {"hr": {0x2011: 750, 0x2012: 352}}

    def settings(self) -> dict[int, int]:
        status = 2 if self.is_tripped else int(self.is_armed)
        outputs = {0x0200 + n: word_of(self.outputs, n) for n in range(POINTS // 16)}
        return outputs | {
            0x1000: self.time_units,
            0x1001: self.mask,
            0x1003: self.trigger,
            0x1006: status,
            0x1007: 1,
        }

    def set(self, offset: int, value: int) -> None:
        if offset in (0x1000, 0x1001) and self.is_armed:
            raise RefusedWrite(FAILURE)
        if offset == 0x1000:
            self.time_units = value
        elif offset == 0x1001:
            self.mask = value
        elif offset == 0x1003 and value and self.time_units and not self.is_tripped:
            self.trigger, self.watchdog_ms = value, 100 * self.time_units
            self.serve()
        elif offset == 0x1007 and value == 1 and self.is_tripped:
            self.is_tripped = False
            self.serve()

    def on_write_done(self, function: int, client: object) -> None:
        if self.is_armed and self.mask >> (function - 1) & 1:
            self.serve()


FLAG_AT, CLEAR_AT = 40, 50


class SafeModeBox(Box):
    """Box with outputs whose safe mode follows when nobody has written for a time, and is latched."""

    def __init__(self, watchdog_ms: int) -> None:
        super().__init__()
        self.is_tripped = False
        self._watchdog_ms = watchdog_ms
        self._left_ms: int | None = None

    def advance(self, for_ms: int) -> None:
        with self.lock:
            if self._left_ms is not None:
                self._left_ms -= for_ms
                if self._left_ms <= 0:
                    self.is_tripped, self._left_ms = True, None
                    self.outputs = [False] * POINTS

    def read(self, table: str, offset: int) -> int:
        if (table, offset) == ("di", FLAG_AT):
            return int(self.is_tripped)
        if table == "di":
            raise KeyError(offset)
        return super().read(table, offset)

    def write(self, table: str, offset: int, value: int, client: object) -> None:
        if (table, offset) == ("co", CLEAR_AT) and value == 0:
            self.is_tripped = False
        elif not self.is_tripped:  # a write in the safe mode is confirmed, without an effect
            super().write(table, offset, value, client)
            self._left_ms = self._watchdog_ms
