"""Data and refresh instructions: ZRST DECO ENCO BON ANS ANR REF REFF MTR ALT SEGD (FNC 40-52, 66, 73).

Details are from memory unless a docstring states otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from controller.core.devices import ANNUNCIATORS
from controller.fx.engine.access import (
    Action,
    ActionFactory,
    BitReader,
    Level,
    LevelFactory,
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
from controller.fx.engine.cpu import COMPLETE, Cpu, OperationError
from controller.fx.language.instruction import DeviceOperand, Operand
from controller.fx.language.operand_rules import MATRIX_SPACING

INPUT_FILTER: Final = 8020
"""Data register of the input filter time of X0-X17, ms."""
_FILTERED_INPUTS: Final = 16
MATRIX_MS: Final = 20
"""Time of each row of MTR, ms (from memory)."""
_SEGMENTS: Final = (
    0x3F,
    0x06,
    0x5B,
    0x4F,
    0x66,
    0x6D,
    0x7D,
    0x27,
    0x7F,
    0x6F,
    0x77,
    0x7C,
    0x39,
    0x5E,
    0x79,
    0x71,
)
"""Segments a (bit 0) to g (bit 6) for each hexadecimal digit."""


def zrst(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """ZRST d1 d2: reset all devices of one kind from d1 to d2 (docs/sources/fx2n.md 1.2); only d1 if d2 is below d1.

    The contacts and current values of timers and counters are reset. C200 and up cannot be mixed with lower counters.
    """
    first, last = operands
    if not (isinstance(first, DeviceOperand) and isinstance(last, DeviceOperand) and first.kind == last.kind):
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
        if kind in "DR":
            memory.D[row] = [0] * size
            return
        memory.bits(kind)[row] = [False] * size
        if kind == "T":
            memory.TV[row], memory.TS[row] = [0] * size, [-1] * size
        elif kind == "C":
            memory.CV[row] = [0] * size

    return run


def _single(cpu: Cpu, device: DeviceOperand, wide: bool) -> Callable[[], int]:
    """Return a function that resolves the number of one device."""
    if device.kind in "DRTC":
        row = words(cpu, device, wide)
        return lambda: row.find(1)
    _, span = bits(cpu, device)
    return lambda: int(span(1).start)


def deco(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """DECO s d n: among the 2**n bits from d, set the bit whose number is in the low n bits of s; reset the rest.

    If s is a bit device, the n bits from s are used. n is 1-8, or 1-4 for a word; n = 0 has no effect. Source of the
    one-hot rule: docs/sources/fx2n.md 1.2.
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
    """Return a function that reads the given number of low bits of a word, or of bits from a bit device onwards."""
    if not is_bit(operand):
        get = reader(cpu, operand, wide)
        return lambda count: get() & ((1 << count) - 1)
    cells, row = bits(cpu, operand)
    return lambda count: sum(bit << place for place, bit in enumerate(cells[row(count)]))


def enco(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """ENCO s d n: d := number of the highest bit that is on among the 2**n bits from s; 0 and an error if all are off.

    n is 1-8, or 1-4 for a word; n = 0 has no effect (verified, docs/sources/fx2n.md 1.2).
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
            put(max(found.bit_length() - 1, 0))
            if not found:
                raise OperationError

    return run


def bon(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """BON s d n: d := bit n of s; n is 0-15, or 0-31 in the 32-bit form."""
    get, put, count = reader(cpu, operands[0], wide), bit_writer(cpu, operands[1]), reader(cpu, operands[2], wide)
    highest = width_of(wide) - 1

    def run() -> None:
        n = within(count(), 0, highest)
        put(bool(get() >> n & 1))

    return run


def ans(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """ANS T n S: set the annunciator S after the drive input has been on for n times 100 ms; T is the timer.

    With the drive input off, T is reset and S is unchanged. END updates M8048 and D8049.
    """
    timer = operands[0]
    if not isinstance(timer, DeviceOperand):
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
    """ANR: reset the lowest annunciator that is on."""
    states = cpu.memory.S

    def run() -> None:
        lowest = next((number for number in ANNUNCIATORS if states[number]), None)
        if lowest is not None:
            states[lowest] = False

    return run


def ref(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """REF d n: read (X) or write (Y) n terminals from d at once; d ends in 0 and n is a multiple of 8 (fx2n.md 1.4).

    Outputs outside the range retain their terminal levels.
    """
    device, count = operands[0], reader(cpu, operands[1], wide)
    if not isinstance(device, DeviceOperand):
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
    """Copy the raw levels of inputs into the input image; inputs without a terminal are unchanged."""
    levels = cpu.terminals[span]
    cpu.memory.X[span.start : span.start + len(levels)] = levels


def reff(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """REFF n: set the input filter of X0-X17 to n ms (0-60, D8020), and read these inputs immediately (fx2n.md 1.4)."""
    time_ms = reader(cpu, operands[0], wide)

    def run() -> None:
        cpu.memory.D[INPUT_FILTER] = within(time_ms(), 0, 60)
        _read_terminals(cpu, slice(0, _FILTERED_INPUTS))

    return run


def mtr(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Level:
    """MTR s d1 d2 n: read n rows (2-8) of 8 inputs from s, each while its output of the n outputs from d1 is on.

    An output is on for 20 ms, or for one scan if the scan is longer; then the raw levels of the inputs are stored. Row
    i begins at d2 + 10 i, or at d2 + 8 i if d2 is an output. M8029 is on in the scan that stores the last row, until
    the next row.
    """
    _, inputs = bits(cpu, operands[0])
    outputs, output_row = bits(cpu, operands[1])
    table, table_row = bits(cpu, operands[2])
    target, count, special = operands[2], reader(cpu, operands[3], wide=False), cpu.memory.M
    spacing = 8 if isinstance(target, DeviceOperand) and target.kind == "Y" else MATRIX_SPACING
    row, since_ms = 0, 0
    was = False

    def run(on: bool) -> None:
        nonlocal row, since_ms, was
        n = within(count(), 2, 8)
        span = output_row(n)
        if not on or not was:
            if was:
                outputs[span], special[COMPLETE] = [False] * n, False
            row, since_ms, was = 0, cpu.now_ms, on
            if on:
                outputs[span] = [place == 0 for place in range(n)]
            return
        if cpu.now_ms - since_ms < MATRIX_MS:
            return
        levels = cpu.terminals[inputs(8)]
        first = table_row(spacing * (n - 1) + 8).start + spacing * row
        table[first : first + 8] = [*levels, *[False] * (8 - len(levels))]
        special[COMPLETE] = row == n - 1
        row, since_ms = (row + 1) % n, cpu.now_ms
        outputs[span] = [place == row for place in range(n)]

    return run


def alt(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Action:
    """ALT d: invert d in every scan in which the instruction is driven (docs/sources/fx2n.md 1.2)."""
    get: BitReader = bit_reader(cpu, operands[0])
    put = bit_writer(cpu, operands[0])
    return lambda: put(not get())


def segd(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """SEGD s d: low 8 bits of d := 7-segment code of the low hexadecimal digit of s; the high 8 bits are unchanged."""
    get, row = reader(cpu, operands[0], wide), words(cpu, operands[1], wide)

    def run() -> None:
        place = row.places().start
        row.put(place, row.get(place) & ~0xFF | _SEGMENTS[get() & 0xF])

    return run


ACTIONS: Final[dict[str, ActionFactory]] = {
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
LEVELS: Final[dict[str, LevelFactory]] = {"ANS": ans, "MTR": mtr}
