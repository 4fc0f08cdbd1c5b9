"""Serial communication and its conversions: RS (FNC 80), ASCI HEX CCD (FNC 82-84).

The order of the bytes, the flags M8122 and M8123, the counts D8122 and D8123, the 8-bit mode M8161, header and
terminator, which are sent and received but not stored, and the end of a reception are those of the FX communication
manual, pages 9-13 and 9-14, and of the FX programming manual, page 10-19 (verified, docs/sources/fx2n.md 1.11). The
bits of D8120 and the timeout are from memory. The line is that of the file of peripherals; each byte takes its time.
"""

from __future__ import annotations

from fractions import Fraction
from functools import reduce
from operator import xor
from typing import Final

from controller.fx.engine.access import Action, ActionFactory, Level, LevelFactory, Words, reader, signed, within, words
from controller.fx.engine.cpu import Cpu, OperationError
from controller.fx.language.instruction import Operand

SEND_WAITS, SEND, RECEIVED, TIMED_OUT, EIGHT_BITS = 8121, 8122, 8123, 8129, 8161
"""Special relays: transmission waits for a reception, transmission request, reception complete, timeout, 8-bit mode."""
FORMAT, HEADER, TERMINATOR, TIMEOUT_10_MS = 8120, 8124, 8125, 8129
"""Special registers: format, characters of header and terminator, timeout."""
_BAUD: Final = {3: 300, 4: 600, 5: 1200, 6: 2400, 7: 4800, 8: 9600, 9: 19200}
"""Speeds by bits 4 to 7 of D8120."""
_DEFAULT_BAUD: Final = 9600
_LONGEST: Final = 4096
_HAS_HEADER, _HAS_TERMINATOR = 0x100, 0x200


class _Format:
    """Format of the bytes in D8120.

    Attributes:
        byte_ms: Time of one byte, ms.
        header: Character before a message; None = none.
        terminator: Character after a message; None = none.
    """

    def __init__(self, data: list[int]) -> None:
        code = data[FORMAT] & 0xFFFF
        baud = _BAUD.get(code >> 4 & 0xF, _DEFAULT_BAUD)
        bits = 1 + (8 if code & 1 else 7) + bool(code >> 1 & 0b11) + (2 if code & 0b1000 else 1)
        self.byte_ms = Fraction(bits * 1000, baud)
        self.header = data[HEADER] & 0xFF if code & _HAS_HEADER else None
        self.terminator = data[TERMINATOR] & 0xFF if code & _HAS_TERMINATOR else None


class _Transfer:
    """State of one RS instruction between scans."""

    def __init__(self, cpu: Cpu, source: Words, target: Words) -> None:
        self._cpu, self._source, self._target = cpu, source, target
        self._format = _Format(cpu.memory.D)
        self._end_ms: Fraction | None = None
        self._sending = 0
        self._begun = False
        self._received: list[int] = []
        self._last_ms = Fraction(0)

    def step(self, count: int, most: int) -> None:
        """Send `count` bytes on request, and receive up to `most` bytes.

        Raises:
            OperationError: The bytes are out of range.
        """
        special, data = self._cpu.memory.M, self._cpu.memory.D
        for row, number in ((self._source, count), (self._target, most)):
            if number:
                row.places(number if special[EIGHT_BITS] else -(-number // 2))
        if not special[RECEIVED] and len(self._received) and not self._begun:
            self._received.clear()  # the program has reset the flag
            data[RECEIVED] = 0
        self._receive(most)
        if self._end_ms is None and special[SEND]:
            special[SEND_WAITS] = self._begun
            if not self._begun:
                self._send(count)
        self._sent()

    def _send(self, count: int) -> None:
        now_ms, form = Fraction(self._cpu.now_ms), self._format
        body = _read_bytes(self._cpu, self._source, count) if count else []
        message = [*([] if form.header is None else [form.header]), *body]
        message += [] if form.terminator is None else [form.terminator]
        self._sending = count
        self._end_ms = now_ms + len(message) * form.byte_ms
        if message:
            self._cpu.line.send(bytes(message), self._end_ms)

    def _sent(self) -> None:
        """Update the number of remaining bytes, and the request at the end of the transmission."""
        if self._end_ms is None:
            return
        special, data = self._cpu.memory.M, self._cpu.memory.D
        left = max(Fraction(0), self._end_ms - self._cpu.now_ms) / self._format.byte_ms
        data[SEND] = min(self._sending, -(-left.numerator // left.denominator))
        if not left:
            self._end_ms, special[SEND], data[SEND] = None, False, 0

    def _receive(self, most: int) -> None:
        special, data, form = self._cpu.memory.M, self._cpu.memory.D, self._format
        for at_ms, byte in self._cpu.line.take(self._cpu.now_ms, form.byte_ms):
            if special[RECEIVED] or not most:
                continue
            self._last_ms = at_ms
            if not self._begun:
                self._begun, self._received = form.header is None or byte == form.header, []
                special[TIMED_OUT] = False
                if form.header is not None or not self._begun:
                    continue
            if form.terminator is not None and byte == form.terminator:
                self._complete()
                continue
            self._received.append(byte)
            if len(self._received) == most:
                self._complete()
        limit_ms = data[TIMEOUT_10_MS] * 10
        if self._begun and limit_ms > 0 and self._cpu.now_ms - self._last_ms >= limit_ms:
            special[TIMED_OUT] = True
            self._complete()
        if self._begun:
            self._store()

    def _complete(self) -> None:
        self._begun, self._cpu.memory.M[RECEIVED] = False, True
        self._store()

    def _store(self) -> None:
        """Write the received bytes to the target, and their number to D8123."""
        self._cpu.memory.D[RECEIVED] = len(self._received)
        if self._received:
            _write_bytes(self._cpu, self._target, self._received)


def rs(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """RS s m d n: send m bytes from s on request M8122, and receive up to n bytes to d; M8123 = reception complete.

    The format in D8120 is read when the drive input turns on.
    """
    count, most = reader(cpu, operands[1], wide), reader(cpu, operands[3], wide)
    transfer: _Transfer | None = None

    def run(on: bool) -> None:
        nonlocal transfer
        if not on:
            transfer = None
            return
        if transfer is None:
            transfer = _Transfer(cpu, words(cpu, operands[0], wide), words(cpu, operands[2], wide))
        transfer.step(within(count(), 0, _LONGEST), within(most(), 0, _LONGEST))

    return run


def asci(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """ASCI s d n: write the low n hexadecimal digits of the words from s as characters to d, highest digit first.

    Two characters occupy one word, the first one its low byte; with M8161 on, each character occupies one word. The
    digits beyond the fourth come from the following words (from memory).
    """
    source, target, count = words(cpu, operands[0], wide), words(cpu, operands[1], wide), reader(cpu, operands[2], wide)

    def run() -> None:
        n = within(count(), 1, 256)
        values = source.read(-(-n // 4))
        digits = "".join(f"{value & 0xFFFF:04X}" for value in reversed(values))[-n:]
        _write_bytes(cpu, target, [ord(digit) for digit in digits])

    return run


def hex_(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """HEX s d n: convert n characters from s, highest digit first, to words from d; any other character is an error."""
    source, target, count = words(cpu, operands[0], wide), words(cpu, operands[1], wide), reader(cpu, operands[2], wide)

    def run() -> None:
        n = within(count(), 1, 256)
        text = bytes(_read_bytes(cpu, source, n)).decode("latin-1")
        if not set(text) <= set("0123456789ABCDEF"):
            raise OperationError
        ends = range(len(text), 0, -4)
        target.write([signed(int(text[max(end - 4, 0) : end], 16), 16) for end in ends])

    return run


def ccd(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """CCD s d n: d := sum of n bytes from s; d+1 := their bitwise exclusive disjunction."""
    source, target, count = words(cpu, operands[0], wide), words(cpu, operands[1], wide), reader(cpu, operands[2], wide)

    def run() -> None:
        found = _read_bytes(cpu, source, within(count(), 1, 256))
        target.write([signed(sum(found), 16), reduce(xor, found)])

    return run


def _read_bytes(cpu: Cpu, source: Words, count: int) -> list[int]:
    """Return bytes from words: both bytes of each, low byte first, or only the low byte if M8161 is on."""
    if cpu.memory.M[EIGHT_BITS]:
        return [word & 0xFF for word in source.read(count)]
    found = [part for word in source.read(-(-count // 2)) for part in (word & 0xFF, word >> 8 & 0xFF)]
    return found[:count]


def _write_bytes(cpu: Cpu, target: Words, found: list[int]) -> None:
    """Write bytes to words: two to each, low byte first, or one to each if M8161 is on."""
    if cpu.memory.M[EIGHT_BITS]:
        target.write(found)
        return
    pairs = zip(found[::2], [*found[1::2], 0], strict=False)
    target.write([signed(low | high << 8, 16) for low, high in pairs])


ACTIONS: Final[dict[str, ActionFactory]] = {"ASCI": asci, "HEX": hex_, "CCD": ccd}
LEVELS: Final[dict[str, LevelFactory]] = {"RS": rs}
