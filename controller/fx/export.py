"""A program as an FX2N instruction list: the same devices, the same order, block by block.

Sequences become STL steps, requests stay relays, Y is written once in the last block, annunciators are ANS. What the
soft PLC does around a program is a block of its own here: first values of set-points, and M8049 for the annunciators.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from controller.core.devices import RETENTIVE, SIZES
from controller.core.expr import And, Bit, Compare, Const, Expr, Not, Or, Word, leaves
from controller.core.program import Block, Program
from controller.core.rungs import (
    Annunciate,
    Count,
    Inc,
    Mov,
    OnDelay,
    Out,
    Pulse,
    PulseFalling,
    Rst,
    Rung,
    Set,
    ZoneReset,
    read_devices,
    written_devices,
)
from controller.core.sequence import Sequence, Step
from controller.fx.instruction import Constant, Device, Instruction, Ladder, Operand

ALWAYS, NEVER, FIRST_SCAN, ANNUNCIATORS_ENABLED = 8000, 8001, 8002, 8049
FIXED_LATCH: Final = 1024
"""From here on relays are latched whatever the parameters of the PLC say."""

_RELATIONS: Final = {"==": "=", "!=": "<>", "<": "<", "<=": "<=", ">": ">", ">=": ">="}
_OPPOSITES: Final = {"==": "!=", "!=": "==", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
_BREAK: Final = {"LD": "LDI", "AND": "ANI", "OR": "ORI"}


@dataclass(frozen=True, slots=True)
class PulseTrain:
    """An output that is to be a train of pulses in the PLC (PLSY) instead of a level.

    Attributes:
        output: The Y; PLSY needs a transistor output, Y0 or Y1.
        frequency_hz: Pulses a second.
    """

    output: Bit
    frequency_hz: int


def export(program: Program, pulses: PulseTrain | None = None) -> Ladder:
    """Return a program as an instruction list.

    Args:
        program: The program.
        pulses: Output that is to be a train of pulses; None = all outputs are levels.
    """
    return _Writing(program, pulses).ladder()


def acting(program: Program) -> Program:
    """Return the part of a program that influences Y: without registers that only tell somebody something.

    Sequences stay whole.
    """
    needed: set[tuple[str, int]] = set()
    kept: set[int] = set()
    grown = True
    while grown:
        grown = False
        for block in program.blocks:
            for item in block.items:
                if id(item) not in kept and any(d.kind == "Y" or (d.kind, d.number) in needed for d in _written(item)):
                    kept.add(id(item))
                    needed |= {(device.kind, device.number) for device in _read(item)}
                    grown = True
    blocks = (Block(block.title, tuple(item for item in block.items if id(item) in kept)) for block in program.blocks)
    set_points = tuple((word, value) for word, value in program.set_points if (word.kind, word.number) in needed)
    return replace(program, blocks=tuple(block for block in blocks if block.items), set_points=set_points)


def _written(item: Rung | Sequence) -> Iterator[Bit | Word]:
    if not isinstance(item, Sequence):
        yield from written_devices(item)
        return
    yield from (bit for bit, _ in item)
    yield from (step.dwell.timer.done for step in item.steps if step.dwell)
    if item.spends is not None:
        yield item.spends


def _read(item: Rung | Sequence) -> Iterator[Bit | Word]:
    if not isinstance(item, Sequence):
        yield from read_devices(item)
        return
    for bit, step in item:
        yield bit
        dwell = item.dwell_rung(step)
        if dwell is not None:
            yield from read_devices(dwell)
        for transfer in item.transfers[step.title]:
            yield from leaves(transfer.when)


def contacts(condition: Expr, join: str = "LD") -> Iterator[Instruction]:
    """Yield the contacts of a condition.

    Args:
        condition: What is to be true.
        join: LD, AND or OR: how it is joined to what stands before it.

    Examples:
        >>> x, m = Bit("X", 0), Bit("M", 5)
        >>> [str(i) for i in contacts(x & ~m | m & Word("D", 3).equals(2))]
        ['LD X0', 'ANI M5', 'LD M5', 'AND= D3 K2', 'ORB']
    """
    match condition:
        case Not(operand):
            yield from _inverted(operand, join)
        case Bit(kind, number):
            yield Instruction(join, (Device(kind, number),))
        case Const(value):
            yield Instruction(join, (Device("M", ALWAYS if value else NEVER),))
        case Compare(relation, left, right):
            yield Instruction(f"{join}{_RELATIONS[relation]}", (_word(left), _word(right)))
        case And(operands) | Or(operands):
            own = "AND" if isinstance(condition, And) else "OR"
            if join not in ("LD", own):
                yield from contacts(condition)
                yield Instruction("ANB" if join == "AND" else "ORB")
                return
            # blocks first: a contact behind a block needs no block instruction of its own
            for n, operand in enumerate(sorted(operands, key=_is_contact)):
                yield from contacts(operand, own if n else join)
        case _:
            raise TypeError(f"not a condition: {condition!r}")


def _inverted(operand: Expr, join: str) -> Iterator[Instruction]:
    match operand:
        case Bit(kind, number):
            yield Instruction(_BREAK[join], (Device(kind, number),))
        case Compare(relation, left, right):
            yield from contacts(Compare(_OPPOSITES[relation], left, right), join)
        case And(operands):
            yield from contacts(Or(tuple(~part for part in operands)), join)
        case Or(operands):
            yield from contacts(And(tuple(~part for part in operands)), join)
        case _:
            yield from contacts(~operand, join)


def _is_contact(condition: Expr) -> bool:
    inner = condition.operand if isinstance(condition, Not) else condition
    return not isinstance(inner, And | Or)


def _word(operand: Word | int) -> Operand:
    return Constant(operand) if isinstance(operand, int) else Device(operand.kind, operand.number)


class _Writing:
    def __init__(self, program: Program, pulses: PulseTrain | None) -> None:
        self._program = program
        self._pulses = pulses
        self._list: list[Instruction] = []
        self._titles: dict[int, str] = {}

    def ladder(self) -> Ladder:
        used = {(device.kind, device.number) for device in self._program.devices()}
        done = next(n for n in RETENTIVE["M"][0] if n >= FIXED_LATCH and ("M", n) not in used)
        self._first_values(done)
        for block in self._program.blocks:
            self._block(block)
        self._list.append(Instruction("END"))
        comments = {f"M{done}": "first values are written"} | self._comments()
        return Ladder(tuple(self._list), self._titles, comments, self._program.name)

    def _comments(self) -> dict[str, str]:
        return {str(device): device.name for device in self._program.devices() if device.name}

    def _first_values(self, done: int) -> None:
        """Write what the soft PLC does before a program: no step and no alarm at power-up, first values of set-points.

        An FX2N keeps S500 to S999 without power; the program looks for what is wrong afresh.
        """
        self._titles[len(self._list)] = "power-up"
        self._add("LD", Device("M", ALWAYS))
        self._add("OUT", Device("M", ANNUNCIATORS_ENABLED))
        self._add("LD", Device("M", FIRST_SCAN))
        self._add("ZRST", Device("S", 0), Device("S", SIZES["S"] - 1))
        if self._program.set_points:
            self._add("LD", Device("M", FIRST_SCAN))
            self._add("ANI", Device("M", done))
            for word, value in self._program.set_points:
                self._add("MOV", Constant(value), _word(word))
            self._add("SET", Device("M", done))

    def _block(self, block: Block) -> None:
        self._titles[len(self._list)] = block.title
        before: Expr | None = None
        for item in block.items:
            if isinstance(item, Sequence):
                self._sequence(item)
                before = None
            else:
                if item.when != before:
                    self._list += contacts(item.when)
                self._output(item)
                # the next rung may share the contacts unless this one has changed what they look at
                before = None if set(written_devices(item)) & set(leaves(item.when)) else item.when

    def _sequence(self, sequence: Sequence) -> None:
        for bit, step in sequence:
            self._titles.setdefault(len(self._list), step.title)
            self._add("STL", Device("S", bit.number))
            self._step(sequence, step)
        self._add("RET")

    def _step(self, sequence: Sequence, step: Step) -> None:
        dwell = sequence.dwell_rung(step)
        if dwell is not None:
            self._list += contacts(dwell.when)
            self._output(dwell)
        for transfer in sequence.transfers[step.title]:
            self._list += contacts(transfer.when)
            self._add("SET", Device("S", transfer.target.number))
            if sequence.spends is not None:
                self._add("RST", Device("M", sequence.spends.number))

    def _output(self, rung: Rung) -> None:
        match rung:
            case Out(target) if self._pulses is not None and target == self._pulses.output:
                self._add("PLSY", Constant(self._pulses.frequency_hz), Constant(0), _device(target))
            case Out(target):
                self._add("OUT", _device(target))
            case Set(target):
                self._add("SET", _device(target))
            case Rst(target):
                self._add("RST", Device(target.kind, target.number) if isinstance(target, Bit | Word)
                          else Device(str(target)[0], target.number))  # fmt: skip
            case ZoneReset(first, last):
                self._add("ZRST", _device(first), _device(last))
            case Pulse(target) | PulseFalling(target):
                self._add("PLS" if isinstance(rung, Pulse) else "PLF", _device(target))
            case OnDelay(timer):
                self._add("OUT", Device("T", timer.number), _word(rung.counts))
            case Count(counter, preset):
                self._add("OUT", Device("C", counter.number), _word(preset))
            case Mov(source, target):
                self._add("MOV", _word(source), _word(target))
            case Inc(target):
                self._add("INC", _word(target))
            case Annunciate(timer, preset, target):
                self._add("ANS", Device("T", timer.number), Constant(preset // timer.base_ms), _device(target))

    def _add(self, name: str, *operands: Operand) -> None:
        self._list.append(Instruction(name, operands))


def _device(bit: Bit) -> Device:
    return Device(bit.kind, bit.number)
