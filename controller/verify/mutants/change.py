"""One-change variants of conditions, rungs, transfers and the order of rungs, each with its description."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum
from itertools import pairwise
from typing import Final, NamedTuple

from controller.core.devices import MS_100, WORD_MAX
from controller.core.expr import And, Bit, Compare, Expr, Not, Or, Word, all_of, any_of
from controller.core.rungs import Annunciate, Count, Mov, OnDelay, Out, Rst, Rung, Set, ZoneReset, written_devices
from controller.core.sequence import Sequence

FACTORS: Final = (2.0, 0.5)
"""Factors of a changed time preset; assumed: a factor of two exceeds every tolerance of a time in this machine."""


class Kind(StrEnum):
    """Kind of change."""

    CONTACT = "contact inverted"
    TERM = "term dropped"
    OUTPUT = "outputs swapped"
    PRIORITY = "order of writes exchanged"
    TARGET = "target changed"
    PRESET = "preset changed"
    LATCH = "set and reset exchanged"


class Change(NamedTuple):
    """One change.

    Attributes:
        kind: Kind of change.
        text: Description.
        items: Items of the block after the change.
    """

    kind: Kind
    text: str
    items: tuple[Rung | Sequence, ...]


def changes_of(items: tuple[Rung | Sequence, ...]) -> Iterator[Change]:
    """Yield every change of the items of a block."""
    for number, item in enumerate(items):
        one = _of_sequence(item) if isinstance(item, Sequence) else _of_rung(item)
        for kind, text, changed in one:
            yield Change(kind, text, (*items[:number], changed, *items[number + 1 :]))
    yield from _of_outputs(items)
    yield from _of_order(items)
    yield from _of_constants(items)


# conditions


def conditions_of(expr: Expr) -> Iterator[tuple[Kind, str, Expr]]:
    """Yield every condition with one contact inverted or one term dropped, with a description."""
    match expr:
        case Bit() | Compare():
            yield Kind.CONTACT, f"{text_of(expr)} inverted", ~expr
        case Not(Bit() | Compare() as contact):
            yield Kind.CONTACT, f"{text_of(expr)} inverted", contact
        case Not(operand):
            yield from ((kind, text, ~changed) for kind, text, changed in conditions_of(operand))
        case And(operands) | Or(operands):
            joined = all_of if isinstance(expr, And) else any_of
            for number, operand in enumerate(operands):
                before, after = operands[:number], operands[number + 1 :]
                yield Kind.TERM, f"{text_of(operand)} dropped", joined(*before, *after)
                for kind, text, changed in conditions_of(operand):
                    yield kind, text, joined(*before, changed, *after)


def text_of(expr: Expr) -> str:
    """Return a condition as text, with tag names in place of device addresses."""
    match expr:
        case Bit():
            return expr.name or str(expr)
        case Compare(relation, left, right):
            other = right if isinstance(right, int) else right.name or str(right)
            return f"{left.name or left} {relation} {other}"
        case Not(operand):
            return f"~{text_of(operand)}" if isinstance(operand, Bit) else f"~({text_of(operand)})"
        case And(operands):
            return " & ".join(f"({text_of(each)})" if isinstance(each, Or) else text_of(each) for each in operands)
        case Or(operands):
            return " | ".join(f"({text_of(each)})" if isinstance(each, And) else text_of(each) for each in operands)
    return str(expr)


# single rungs


def name_of(rung: Rung) -> str:
    """Return the instruction of a rung with the name of its target."""
    names = {Out: "OUT", Set: "SET", Rst: "RST", ZoneReset: "ZRST", OnDelay: "OUT", Count: "OUT", Annunciate: "ANS"}
    instruction = names.get(type(rung), type(rung).__name__.upper())
    return f"{instruction} {_target(rung)}"


def _target(rung: Rung) -> str:
    match rung:
        case ZoneReset(first, last):
            return f"{first.name or first} to {last.name or last}"
        case OnDelay(timer) | Annunciate(timer):
            return timer.name or str(timer)
        case Count(counter):
            return counter.name or str(counter)
        case _:
            return rung.target.name or str(rung.target)


def _of_rung(rung: Rung) -> Iterator[tuple[Kind, str, Rung]]:
    name = name_of(rung)
    for kind, text, when in conditions_of(rung.when):
        yield kind, f"{name}: {text}", replace(rung, when=when)
    match rung:
        case OnDelay(timer, int(preset)):
            for other in _times(preset, timer.base_ms):
                yield Kind.PRESET, f"{name}: {other} ms instead of {preset} ms", replace(rung, preset=other)
        case Annunciate(_, preset):
            for other in _times(preset, MS_100):
                yield Kind.PRESET, f"{name}: {other} ms instead of {preset} ms", replace(rung, preset=other)
        case Count(_, int(preset)):
            for other in (preset + 1, preset - 1):
                if 0 < other <= WORD_MAX:
                    yield Kind.PRESET, f"{name}: {other} instead of {preset}", replace(rung, preset=other)
        case Set(target):
            yield Kind.LATCH, f"{name}: RST instead of SET", Rst(target, rung.when)
        case Rst(Bit() as target):
            yield Kind.LATCH, f"{name}: SET instead of RST", Set(target, rung.when)


def _times(preset_ms: int, base_ms: int) -> Iterator[int]:
    """Yield the changed presets that the timer can measure, ms."""
    for factor in FACTORS:
        counts = int(preset_ms * factor) // base_ms
        if 0 < counts <= WORD_MAX and counts * base_ms != preset_ms:
            yield counts * base_ms


# steps


def _of_sequence(sequence: Sequence) -> Iterator[tuple[Kind, str, Sequence]]:
    conditions = tuple(sequence.conditions())
    names = list(_names_of_conditions(sequence))
    for number, (name, condition) in enumerate(zip(names, conditions, strict=True)):
        for kind, text, changed in conditions_of(condition):
            changed_conditions = (*conditions[:number], changed, *conditions[number + 1 :])
            yield kind, f"{name}: {text}", sequence.with_conditions(changed_conditions)
    yield from _of_dwells(sequence)
    yield from _of_transfers(sequence)


def _names_of_conditions(sequence: Sequence) -> Iterator[str]:
    """Yield the names of the conditions, in the order of `Sequence.conditions`."""
    titles = {bit: step.title for bit, step in sequence}
    for step in sequence.steps:
        if step.dwell is not None:
            yield f"dwell of {step.title!r}"
        yield from (f"{step.title!r} to {titles[each.target]!r}" for each in sequence.transfers[step.title])


def _of_dwells(sequence: Sequence) -> Iterator[tuple[Kind, str, Sequence]]:
    for number, step in enumerate(sequence.steps):
        if step.dwell is None or not isinstance(step.dwell.preset, int):
            continue
        for preset in _times(step.dwell.preset, step.dwell.timer.base_ms):
            changed = replace(step, dwell=replace(step.dwell, preset=preset))
            steps = (*sequence.steps[:number], changed, *sequence.steps[number + 1 :])
            text = f"dwell of {step.title!r}: {preset} ms instead of {step.dwell.preset} ms"
            yield Kind.PRESET, text, sequence.with_steps(steps, sequence.transfers)


def _of_transfers(sequence: Sequence) -> Iterator[tuple[Kind, str, Sequence]]:
    """Yield every transfer with the next or the previous step in place of its target."""
    bits = [bit for bit, _ in sequence]
    titles = {bit: step.title for bit, step in sequence}
    for step in sequence.steps:
        transfers = sequence.transfers[step.title]
        for number, transfer in enumerate(transfers):
            place = bits.index(transfer.target)
            for target in dict.fromkeys((bits[(place + 1) % len(bits)], bits[place - 1])):
                changed = (*transfers[:number], replace(transfer, target=target), *transfers[number + 1 :])
                text = f"{step.title!r} to {titles[target]!r} instead of {titles[transfer.target]!r}"
                others = {**sequence.transfers, step.title: changed}
                yield Kind.TARGET, text, sequence.with_steps(sequence.steps, others)


# several rungs


def _of_outputs(items: tuple[Rung | Sequence, ...]) -> Iterator[Change]:
    """Yield every exchange of the targets of two OUT coils that follow each other."""
    coils = [(number, item) for number, item in enumerate(items) if isinstance(item, Out)]
    for (place, one), (next_place, other) in pairwise(coils):
        swapped = list(items)
        swapped[place], swapped[next_place] = replace(one, target=other.target), replace(other, target=one.target)
        yield Change(Kind.OUTPUT, f"{name_of(one)} and {name_of(other)}: targets swapped", tuple(swapped))


def _of_order(items: tuple[Rung | Sequence, ...]) -> Iterator[Change]:
    """Yield every exchange of two rungs that write the same device one after the other."""
    latest: dict[Bit | Word, int] = {}
    pairs: dict[tuple[int, int], str] = {}
    for number, item in enumerate(items):
        if isinstance(item, Set | Rst | ZoneReset | Mov):
            for device in written_devices(item):
                if device in latest:
                    pairs.setdefault((latest[device], number), device.name or str(device))
                latest[device] = number
    for (first, second), name in pairs.items():
        exchanged = list(items)
        exchanged[first], exchanged[second] = items[second], items[first]
        one, other = _write(items[first]), _write(items[second])
        text = f"{one} and {other}: exchanged ({name})"
        yield Change(Kind.PRIORITY, text, tuple(exchanged))


def _write(item: Rung | Sequence) -> str:
    assert not isinstance(item, Sequence)  # noqa: S101 - narrows the union for the type checker
    return f"MOV {item.source} {_target(item)}" if isinstance(item, Mov) else name_of(item)


def _of_constants(items: tuple[Rung | Sequence, ...]) -> Iterator[Change]:
    """Yield every MOV of a constant with the next constant that is moved to the same register."""
    moved: dict[Word, list[int]] = {}
    moves = [(number, item) for number, item in enumerate(items) if isinstance(item, Mov)]
    for _, move in moves:
        if isinstance(move.source, int) and move.source not in moved.setdefault(move.target, []):
            moved[move.target].append(move.source)
    for number, move in moves:
        if not isinstance(move.source, int) or len(moved[move.target]) < 2:
            continue
        values = moved[move.target]
        value = values[(values.index(move.source) + 1) % len(values)]
        text = f"{_write(move)}: {value} instead of {move.source}"
        changed = (*items[:number], replace(move, source=value), *items[number + 1 :])
        yield Change(Kind.TARGET, text, changed)
