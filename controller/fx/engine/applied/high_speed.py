"""High-speed instructions: EI DI (FNC 4, 5), HSCS HSCR HSZ (FNC 53-55), SPD (FNC 56).

HSCS, HSCR and HSZ read their comparison values in every scan in which they are driven, and act when a pulse changes the
counter, not when the program does. Details are from memory.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from controller.core.devices import WORD_MAX
from controller.fx.engine.access import Action, ActionFactory, Level, LevelFactory, bits, reader, within, words
from controller.fx.engine.cpu import Cpu, OperationError
from controller.fx.language.high_speed_inputs import COUNTER_INPUTS
from controller.fx.language.instruction import DeviceOperand, Operand, Pointer

_FAST_INPUTS: Final = 6


def ei(cpu: Cpu, _operands: tuple[Operand, ...], _wide: bool) -> Action:
    """EI: enable interrupts."""

    def run() -> None:
        cpu.interrupts_enabled = True

    return run


def di(cpu: Cpu, _operands: tuple[Operand, ...], _wide: bool) -> Action:
    """DI: disable interrupts; requests are stored until EI."""

    def run() -> None:
        cpu.interrupts_enabled = False

    return run


def hscs(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Level:
    """HSCS s C d: set d at once, or request the interrupt d, when a pulse changes the counter C to s."""
    target = operands[2]
    if isinstance(target, Pointer):
        return _comparison(cpu, operands, lambda: cpu.request_interrupt(target.number))
    return _comparison(cpu, operands, _switch(cpu, target, on=True))


def hscr(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Level:
    """HSCR s C d: reset d at once when a pulse changes the counter C to s; d may be C itself."""
    target = operands[2]
    if not isinstance(target, DeviceOperand) or target.kind != "C":
        return _comparison(cpu, operands, _switch(cpu, target, on=False))
    number = _counter(operands[1])

    def clear() -> None:
        cpu.memory.CV[number], cpu.memory.C[number] = 0, False

    return _comparison(cpu, operands, clear)


def _counter(operand: Operand) -> int:
    """Return the number of a high-speed counter.

    Raises:
        OperationError: The counter is not one of C235 to C255.
    """
    if not isinstance(operand, DeviceOperand) or operand.number not in COUNTER_INPUTS or operand.index:
        raise OperationError
    return operand.number


def _switch(cpu: Cpu, target: Operand, *, on: bool) -> Action:
    """Return a function that writes a bit; Y also changes at its terminal."""
    cells, row = bits(cpu, target)
    is_output = isinstance(target, DeviceOperand) and target.kind == "Y"

    def write() -> None:
        number = row(1).start
        cells[number] = on
        if is_output and not cpu.memory.M[8034]:
            cpu.latches[number] = on

    return write


def _comparison(cpu: Cpu, operands: tuple[Operand, ...], act: Action) -> Level:
    """Return the level of an instruction that acts when the counter becomes equal to a value."""
    value = reader(cpu, operands[0], wide=True)
    current = 0

    def compare() -> None:
        if cpu.memory.CV[_counter(operands[1])] == current:
            act()

    def read() -> None:
        nonlocal current
        current = value()

    return _watching(cpu, operands[1], compare, read)


def _watching(cpu: Cpu, counter: Operand, compare: Action, read: Action) -> Level:
    """Return a level that reads its values while it is driven and compares after each count."""

    def run(on: bool) -> None:
        watches = cpu.after_count.setdefault(_counter(counter), [])
        if on:
            read()
            if compare not in watches:
                watches.append(compare)
        elif compare in watches:
            watches.remove(compare)

    return run


def hsz(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Level:
    """HSZ s1 s2 C d: after each count, d is on if C is below s1, d+1 if it is from s1 to s2, and d+2 if it is above.

    The bits do not change until the first count, and are unchanged when the drive input turns off.
    """
    first, last = reader(cpu, operands[0], wide=True), reader(cpu, operands[1], wide=True)
    target = operands[3]
    cells, row = bits(cpu, target)
    is_output = isinstance(target, DeviceOperand) and target.kind == "Y"
    limits, span = (0, 0), slice(0, 0)

    def compare() -> None:
        value, (low, high) = cpu.memory.CV[_counter(operands[2])], limits
        cells[span] = (value < low, low <= value <= high, value > high)
        if is_output and not cpu.memory.M[8034]:
            cpu.latches[span] = cells[span]

    def read() -> None:
        nonlocal limits, span
        limits, span = (first(), last()), row(3)

    return _watching(cpu, operands[2], compare, read)


def spd(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """SPD X s d: d := rising edges at X (X0 to X5) in each period of s ms; d+1: edges so far; d+2: remaining ms."""
    _, terminal = bits(cpu, operands[0])
    period, row = reader(cpu, operands[1], wide), words(cpu, operands[2], wide)
    edges_ms: list[int] = []
    start_ms: int | None = None
    watched: Callable[[int], None] = edges_ms.append

    def run(on: bool) -> None:
        nonlocal start_ms
        number = within(terminal(1).start, 0, _FAST_INPUTS - 1)
        watches = cpu.after_rise.setdefault(number, [])
        if not on:
            if start_ms is not None:
                watches.remove(watched)
                edges_ms.clear()
            start_ms = None
            return
        result, so_far, left = row.places(3)
        period_ms = within(period(), 1, WORD_MAX)
        if start_ms is None:
            start_ms = cpu.now_ms
            watches.append(watched)
        while cpu.now_ms >= start_ms + period_ms:
            start_ms += period_ms
            complete = [at_ms for at_ms in edges_ms if at_ms < start_ms]
            row.put(result, len(complete))
            del edges_ms[: len(complete)]
        row.put(so_far, len(edges_ms))
        row.put(left, start_ms + period_ms - cpu.now_ms)

    return run


ACTIONS: Final[dict[str, ActionFactory]] = {"EI": ei, "DI": di}
LEVELS: Final[dict[str, LevelFactory]] = {"HSCS": hscs, "HSCR": hscr, "HSZ": hsz, "SPD": spd}
