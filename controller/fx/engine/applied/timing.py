"""Drums, ramps, timers and the clock: ABSD INCD TTMR STMR RAMP (FNC 62-67), TCMP TZCP TRD (FNC 160-166).

Details are from memory unless a docstring states otherwise. Instructions executed in every scan store their drive state
between scans and are reset when the CPU changes to RUN.
"""

from __future__ import annotations

from typing import Final

from controller.core.devices import WORD_MAX
from controller.fx.engine.access import Action, ActionFactory, Level, LevelFactory, bits, reader, within, words
from controller.fx.engine.cpu import COMPLETE, Cpu
from controller.fx.language.instruction import DeviceOperand, Operand

RAMP_HOLDS: Final = 8026
"""Special relay: RAMP remains at its end value instead of restarting."""
CLOCK: Final = (8018, 8017, 8016, 8015, 8014, 8013, 8019)
"""Data registers of the clock in the order of TRD: year, month, day, hour, minute, second, weekday (fx2n.md 1.6)."""


def absd(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """ABSD s1 C d n: bit i of n (1-64) from d is on while the counter is within the i-th pair of words from s1.

    A pair contains the count that turns the bit on and the count that turns it off (2 n words, fx2n.md 1.2); if the
    second is lower, the bit is on outside this range. With the drive input off, the bits are unchanged.
    """
    table, counter, count = (
        words(cpu, operands[0], wide),
        reader(cpu, operands[1], wide),
        reader(cpu, operands[3], wide),
    )
    cells, row = bits(cpu, operands[2])

    def run(on: bool) -> None:
        if not on:
            return
        n = within(count(), 1, 64)
        span, limits, value = row(n), table.read(2 * n), counter()
        cells[span] = [_between(value, first, last) for first, last in zip(limits[::2], limits[1::2], strict=True)]

    return run


def _between(value: int, on: int, off: int) -> bool:
    return on <= value < off if on <= off else value >= on or value < off


def incd(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """INCD s1 C d n: one of n bits (1-64) from d is on; the next bit follows when C reaches the limit of this bit.

    The table at s1 contains one limit for each bit. C is reset when the next bit turns on; C+1 contains the number of
    the bit that is on. After the last bit, M8029 is on for one scan, and the first bit follows. When the drive input
    turns off, both counters and the bits are cleared.
    """
    table, counters = words(cpu, operands[0], wide), words(cpu, operands[1], wide)
    cells, row = bits(cpu, operands[2])
    count, memory, was = reader(cpu, operands[3], wide), cpu.memory, False

    def run(on: bool) -> None:
        nonlocal was
        if not on and not was:
            return
        n = within(count(), 1, 64)
        span, limits, (counter, drum) = row(n), table.read(n), counters.places(2)
        was = on
        step = memory.CV[drum] if on and 0 <= memory.CV[drum] < n else 0
        reached = on and memory.CV[counter] >= limits[step]
        if reached or not on:
            memory.CV[counter], memory.C[counter] = 0, False
        step += reached
        memory.M[COMPLETE] = step == n
        memory.CV[drum] = step % n
        cells[span] = [on and place == step % n for place in range(n)]

    return run


def ttmr(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """TTMR d n: store the on time of the drive input in d, in units of 1 s, 100 ms or 10 ms for n = 0, 1 or 2.

    d+1 contains the time in units of 100 ms. When the drive input turns off, d retains the last time and d+1 becomes 0.
    Both stop at 32,767.
    """
    row, unit, since = words(cpu, operands[0], wide), reader(cpu, operands[1], wide), None

    def run(on: bool) -> None:
        nonlocal since
        if on:
            unit_ms = 1000 // 10 ** within(unit(), 0, 2)
            first, second = row.places(2)
            since = cpu.now_ms if since is None else since
            driven_ms = cpu.now_ms - since
            row.put(first, min(driven_ms // unit_ms, WORD_MAX))
            row.put(second, min(driven_ms // 100, WORD_MAX))
        elif since is not None:
            row.put(row.places(2)[1], 0)
            since = None

    return run


def stmr(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """STMR T n d: four bits from d, driven by one timer of n times 100 ms that starts when the drive input changes.

    d: the drive input with an off-delay of n. d+1: on for n after the drive input turns off. d+2: on for n after it
    turns on. d+3: the drive input, delayed by n.
    """
    timer = operands[0]
    if not isinstance(timer, DeviceOperand):
        raise TypeError(f"not a timer: {timer}")
    number, memory, preset = timer.number, cpu.memory, reader(cpu, operands[1], wide)
    cells, row = bits(cpu, operands[2])
    was = False

    def run(on: bool) -> None:
        nonlocal was
        counts, span, now = within(preset(), 1, WORD_MAX), row(4), cpu.ticks(number)
        if on != was:
            memory.TS[number], was = now, on
        running = memory.TS[number] >= 0
        elapsed = now - memory.TS[number] if running else counts
        done = elapsed >= counts
        cells[span] = (on or not done, not on and not done, on and not done, on if done else cells[span.start + 3])
        memory.T[number], memory.TV[number] = done and on, min(elapsed, counts) if on or not done else 0
        if done and not on:
            memory.TS[number] = -1

    return run


def ramp(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """RAMP s1 s2 d n: d changes from s1 to s2 in n scans, counted in d+1. M8029 is on when d has reached s2.

    In the next scan d restarts from s1, or remains at s2 if M8026 is on. In the first scan in which the instruction is
    driven, d is s1. When the drive input turns off, d is unchanged and d+1 is cleared.
    """
    first, last, count = (reader(cpu, operands[place], wide) for place in (0, 1, 3))
    target, special, was = words(cpu, operands[2], wide), cpu.memory.M, False

    def run(on: bool) -> None:
        nonlocal was
        if not on and not was:
            return
        value_place, scan_place = target.places(2)
        if not on:
            was, special[COMPLETE] = False, False
            target.put(scan_place, 0)
            return
        n, start, end = within(count(), 1, WORD_MAX), first(), last()
        scans = target.get(scan_place) + 1 if was else 0
        if not 0 <= scans <= n:
            scans = n if special[RAMP_HOLDS] else 0
        was, special[COMPLETE] = True, scans == n
        target.put(scan_place, scans)
        target.put(value_place, start + int((end - start) * scans / n))

    return run


def tcmp(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """TCMP s1 s2 s3 s d: compare the time s1:s2:s3 with the time in the three words (h, min, s) from s.

    Bit d is on if the first time is later, d+1 if the times are equal, and d+2 if the first time is earlier. An invalid
    time is an error.
    """
    hour, minute, second = (reader(cpu, operand, wide) for operand in operands[:3])
    clock = words(cpu, operands[3], wide)
    cells, row = bits(cpu, operands[4])

    def run() -> None:
        reference, actual = _seconds([hour(), minute(), second()]), _seconds(clock.read(3))
        cells[row(3)] = (reference > actual, reference == actual, reference < actual)

    return run


def tzcp(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """TZCP s1 s2 s d: compare the time in s with the times in s1 and s2; each time is three words (h, min, s).

    Bit d is on if s is before s1, d+1 if it is from s1 to s2, and d+2 if it is after s2. An invalid time is an error.
    """
    low, high, clock = (words(cpu, operand, wide) for operand in operands[:3])
    cells, row = bits(cpu, operands[3])

    def run() -> None:
        a, b, actual = (_seconds(times.read(3)) for times in (low, high, clock))
        cells[row(3)] = (actual < a, a <= actual <= b, actual > b)

    return run


def _seconds(time: list[int]) -> int:
    hour, minute, second = time
    return (within(hour, 0, 23) * 60 + within(minute, 0, 59)) * 60 + within(second, 0, 59)


def trd(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """TRD d: seven words from d := year, month, day, hour, minute, second, weekday of the clock."""
    target, data = words(cpu, operands[0], wide), cpu.memory.D
    return lambda: target.write([data[number] for number in CLOCK])


ACTIONS: Final[dict[str, ActionFactory]] = {"TCMP": tcmp, "TZCP": tzcp, "TRD": trd}
LEVELS: Final[dict[str, LevelFactory]] = {"ABSD": absd, "INCD": incd, "TTMR": ttmr, "STMR": stmr, "RAMP": ramp}
