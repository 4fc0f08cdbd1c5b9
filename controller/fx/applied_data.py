"""Data and refresh: ZRST DECO ENCO BON ANS ANR REF REFF ALT SEGD (FNC 40-51, 66, 73).

Details are general knowledge (GK) unless a docstring says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from controller.core.devices import ANNUNCIATORS
from controller.fx.access import (
    Action,
    BitReader,
    Level,
    LevelMaker,
    Maker,
    bit_reader,
    bit_writer,
    bits,
    is_bit,
    reader,
    width_of,
    within,
    words,
    writer,
)
from controller.fx.cpu import Cpu, OperationError
from controller.fx.instruction import Device, Operand

INPUT_FILTER: Final = 8020
"""Data register: time of the input filter of X0-X17, ms."""
_FILTERED_INPUTS: Final = 16
_SEGMENTS: Final = (
    0x3F, 0x06, 0x5B, 0x4F, 0x66, 0x6D, 0x7D, 0x27, 0x7F, 0x6F, 0x77, 0x7C, 0x39, 0x5E, 0x79, 0x71,
)  # fmt: skip
"""Segments a (bit 0) to g (bit 6) of the hexadecimal digits."""


def zrst(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """ZRST d1 d2: every device from d1 to d2 is reset, one kind (FX.md 1.2); only d1 if d2 is below it.

    Of timers and counters contact and current value. C200 and up are not mixed with those below.
    """
    first, last = operands
    if not (isinstance(first, Device) and isinstance(last, Device) and first.kind == last.kind):
        raise TypeError(f"not devices of one kind: {first} {last}")
    memory, kind = cpu.memory, first.kind
    long = kind == "C" and first.number >= 200
    find_first, find_last = _single(cpu, first, wide or long), _single(cpu, last, wide or long)

    def run() -> None:
        low, high = find_first(), find_last()
        if kind in "MD" and low < 8000 <= high:
            raise OperationError
        size = max(high - low, 0) + 1
        row = slice(low, low + size)
        if kind == "D":
            memory.D[row] = [0] * size
            return
        memory.bits(kind)[row] = [False] * size
        if kind == "T":
            memory.TV[row], memory.TS[row] = [0] * size, [-1] * size
        elif kind == "C":
            memory.CV[row] = [0] * size

    return run


def _single(cpu: Cpu, device: Device, wide: bool) -> Callable[[], int]:
    """Return what finds the number of one device."""
    if device.kind in "DTC":
        row = words(cpu, device, wide)
        return lambda: row.find(1)
    _, span = bits(cpu, device)
    return lambda: int(span(1).start)


def deco(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """DECO s d n: of the 2**n bits from d the one whose number is in the low n bits of s is on, all others off.

    Bits of s: n of them from s on if it is a bit device. n is 1-8, 1-4 into a word; 0 does nothing. Source of the
    one-hot rule: FX.md 1.2.
    """
    number, count = _low_bits(cpu, operands[0], wide), reader(cpu, operands[2], wide)
    target = operands[1]
    if not is_bit(target):
        put = writer(cpu, target, wide)

        def run_word() -> None:
            if n := within(count(), 0, 4):
                put(1 << number(n))

        return run_word
    cells, row = bits(cpu, target)

    def run() -> None:
        if n := within(count(), 0, 8):
            on, span = number(n), row(1 << n)
            cells[span] = [place == on for place in range(1 << n)]

    return run


def _low_bits(cpu: Cpu, operand: Operand, wide: bool) -> Callable[[int], int]:
    """Return what reads so many low bits of a word, or bits from a bit device on."""
    if not is_bit(operand):
        get = reader(cpu, operand, wide)
        return lambda count: get() & ((1 << count) - 1)
    cells, row = bits(cpu, operand)
    return lambda count: sum(bit << place for place, bit in enumerate(cells[row(count)]))


def enco(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """ENCO s d n: d := number of the highest of the 2**n bits of s that is on; none on is an error.

    n is 1-8, 1-4 of a word; 0 does nothing.
    """
    value, put, count = (
        _low_bits(cpu, operands[0], wide),
        writer(cpu, operands[1], wide),
        reader(cpu, operands[2], wide),
    )
    most = 8 if is_bit(operands[0]) else 4

    def run() -> None:
        if n := within(count(), 0, most):
            found = value(1 << n)
            if not found:
                raise OperationError
            put(found.bit_length() - 1)

    return run


def bon(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """BON s d n: d := bit n of s, 0-15, or 0-31 in 32 bits."""
    get, put, count = reader(cpu, operands[0], wide), bit_writer(cpu, operands[1]), reader(cpu, operands[2], wide)
    highest = width_of(wide) - 1

    def run() -> None:
        n = within(count(), 0, highest)
        put(bool(get() >> n & 1))

    return run


def ans(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """ANS T n S: the annunciator S is set once the drive has been on for n times 100 ms; T shows the time.

    The drive off resets T and leaves S. M8048, M8049 and D8049 are the scan's.
    """
    timer = operands[0]
    if not isinstance(timer, Device):
        raise TypeError(f"not a timer: {timer}")
    number, memory = timer.number, cpu.memory
    preset, put = reader(cpu, operands[1], wide), bit_writer(cpu, operands[2])

    def run(on: bool) -> None:
        if on:
            counts = within(preset(), 0, 32767)
            start = memory.TS[number] if memory.TS[number] >= 0 else cpu.ticks(number)
            elapsed = cpu.ticks(number) - start
            if elapsed >= counts:
                put(True)
            memory.TS[number], memory.TV[number] = start, min(elapsed, counts)
            memory.T[number] = elapsed >= counts
        elif memory.TS[number] >= 0:
            memory.TS[number], memory.TV[number], memory.T[number] = -1, 0, False

    return run


def anr(cpu: Cpu, _operands: tuple[Operand, ...], _wide: bool) -> Action:
    """ANR: the lowest annunciator that is on goes off."""
    states = cpu.memory.S

    def run() -> None:
        lowest = next((number for number in ANNUNCIATORS if states[number]), None)
        if lowest is not None:
            states[lowest] = False

    return run


def ref(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """REF d n: n terminals from d are read (X) or written (Y) at once; d ends in 0, n is a multiple of 8 (FX.md 1.4).

    Outputs outside the zone keep the level they have at the terminals.
    """
    device, count = operands[0], reader(cpu, operands[1], wide)
    if not isinstance(device, Device):
        raise TypeError(f"not a terminal: {device}")
    cells, row = bits(cpu, device)
    inputs = device.kind == "X"

    def run() -> None:
        n = count()
        span = row(n)
        if span.start % 8 or n % 8:
            raise OperationError
        if inputs:
            _read_terminals(cpu, span)
            return
        if cpu.refreshed is None:
            cpu.refreshed = list(cpu.latches or cells)
        cpu.refreshed[span] = cells[span]

    return run


def _read_terminals(cpu: Cpu, span: slice) -> None:
    """Copy the raw levels of inputs into their image; where there is no terminal it stays."""
    levels = cpu.terminals[span]
    cpu.memory.X[span.start : span.start + len(levels)] = levels


def reff(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """REFF n: the input filter of X0-X17 becomes n ms (0-60, D8020), and these inputs are read at once (FX.md 1.4)."""
    time_ms = reader(cpu, operands[0], wide)

    def run() -> None:
        cpu.memory.D[INPUT_FILTER] = within(time_ms(), 0, 60)
        _read_terminals(cpu, slice(0, _FILTERED_INPUTS))

    return run


def alt(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Action:
    """ALT d: d inverted, in every scan in which it is driven (FX.md 1.2)."""
    get: BitReader = bit_reader(cpu, operands[0])
    put = bit_writer(cpu, operands[0])
    return lambda: put(not get())


def segd(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """SEGD s d: the low 8 bits of d := segments that show the low digit of s; the high 8 bits stay."""
    get, row = reader(cpu, operands[0], wide), words(cpu, operands[1], wide)

    def run() -> None:
        place = row.places().start
        row.put(place, row.get(place) & ~0xFF | _SEGMENTS[get() & 0xF])

    return run


ACTIONS: Final[dict[str, Maker]] = {
    "ZRST": zrst,
    "DECO": deco,
    "ENCO": enco,
    "BON": bon,
    "ANR": anr,
    "REF": ref,
    "REFF": reff,
    "ALT": alt,
    "SEGD": segd,
}
LEVELS: Final[dict[str, LevelMaker]] = {"ANS": ans}
