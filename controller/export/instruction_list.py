"""Export of a program as an FX2N instruction list, block by block, with the same devices in the same order.

Sequences become STL steps, requests remain relays, each Y is written once, in the last block, and annunciators are
set by timers. Conditions that are used repeatedly are evaluated once, into auxiliary relays (`sharing`). A separate
block contains the functions that the soft PLC performs outside the program: it resets all states, detects a loss of the
retentive memory, writes the initial set-points and switches M8049 on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from controller.core.devices import PROGRAM_RANGES, RETENTIVE, SIZES, WORD_MAX
from controller.core.expr import And, Bit, Compare, Const, Expr, Not, Or, Word, leaves
from controller.core.program import Block, Program
from controller.core.rungs import (
    Add,
    Annunciate,
    Arithmetic,
    Count,
    Inc,
    Mov,
    OnDelay,
    Out,
    Pulse,
    PulseFalling,
    Rst,
    Rung,
    Scale,
    Set,
    Subtract,
    ZoneReset,
    read_devices,
    written_devices,
)
from controller.core.sequence import Sequence, Step
from controller.export.dividing import divided
from controller.export.scan_supervision import COUNTER, MORE_THAN_A_SECOND, SCAN_FAULT, scan_supervision
from controller.export.sharing import RELAYS, item_writes, shared
from controller.fx.language.editor_blocks import MOST_LINES, condition_lines
from controller.fx.language.instruction import Constant, DeviceOperand, Instruction, Ladder, LadderError, Operand

ALWAYS, NEVER, FIRST_SCAN, BATTERY_LOW, ANNUNCIATORS_ENABLED = 8000, 8001, 8002, 8005, 8049
FIXED_LATCH: Final = 1024
"""First relay of the fixed latched range, which PLC parameters cannot change."""

POWER_UP: Final = "power-up"
"""Title of the block that the export adds to the program."""

MEMORY_LOST: Final = "memory lost"
"""Name of the relay of lost memory in the program."""

SUPERVISION: Final = "scan supervision"
"""Title of the block that supervises the scan time."""

SCRATCH: Final = range(180, 189)
"""Data registers that the program must not use: those of `Scale` (product, divisor, quotient and remainder, 32 bits
each) and the counter of the scan supervision."""

_RELATIONS: Final = {"==": "=", "!=": "<>", "<": "<", "<=": "<=", ">": ">", ">=": ">="}
_OPPOSITES: Final = {"==": "!=", "!=": "==", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
_BREAK: Final = {"LD": "LDI", "AND": "ANI", "OR": "ORI"}


@dataclass(frozen=True, slots=True)
class PulseTrain:
    """Output to which the PLC writes a pulse train (PLSY) instead of a level.

    Attributes:
        output: The Y device; PLSY requires a transistor output, Y0 or Y1.
        frequency_hz: Pulses per second.
    """

    output: Bit
    frequency_hz: int


def export(program: Program, pulses: PulseTrain | None = None) -> Ladder:
    """Return a program as an instruction list.

    Args:
        program: The program.
        pulses: Output that becomes a pulse train; None = all outputs are levels.
    """
    short = shared(program)
    used = {device.number for device in short.devices() if device.kind == "M"}
    free = (number for number in RELAYS if number not in used)
    return _ListWriter(divided(short, free, _lines, MOST_LINES), pulses).ladder(DeviceOperand("M", next(free)))


def program_ladder(program: Program) -> Ladder:
    """Return the rungs and steps of a program as the soft PLC executes them, with its devices and those of `SCRATCH`.

    There are no auxiliary relays, no initial values and no scan supervision. The list need not fit an FX2N.
    """
    return _ListWriter(program, None).rungs()


def _lines(condition: Expr) -> int:
    return condition_lines(list(contacts(condition)))


def acting(program: Program) -> Program:
    """Return the part of a program that influences its outputs, excluding registers used only for information.

    A sequence is either included completely or omitted.
    """
    needed = {(word.kind, word.number) for word in program.output_words}
    selected: set[int] = set()
    grown = True
    while grown:
        grown = False
        for block in program.blocks:
            for item in block.items:
                if id(item) not in selected and any(
                    d.kind == "Y" or (d.kind, d.number) in needed for d in item_writes(item)
                ):
                    selected.add(id(item))
                    needed |= {(device.kind, device.number) for device in _read(item)}
                    grown = True
    blocks = (Block(block.title, tuple(i for i in block.items if id(i) in selected)) for block in program.blocks)
    set_points = tuple((word, value) for word, value in program.set_points if (word.kind, word.number) in needed)
    return replace(program, blocks=tuple(block for block in blocks if block.items), set_points=set_points)


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
        condition: Condition to translate.
        join: Connection to the preceding contacts: LD, AND or OR.

    Examples:
        >>> x, m = Bit("X", 0), Bit("M", 5)
        >>> [str(i) for i in contacts(x & ~m | m & Word("D", 3).equals(2))]
        ['LD X0', 'ANI M5', 'LD M5', 'AND= D3 K2', 'ORB']
    """
    match condition:
        case Not(operand):
            yield from _inverted(operand, join)
        case Bit(kind, number):
            yield Instruction(join, (DeviceOperand(kind, number),))
        case Const(value):
            yield Instruction(join, (DeviceOperand("M", ALWAYS if value else NEVER),))
        case Compare(relation, left, right):
            yield Instruction(f"{join}{_RELATIONS[relation]}", (_word(left), _word(right)))
        case And(operands) | Or(operands):
            operation = "AND" if isinstance(condition, And) else "OR"
            if join not in ("LD", operation):
                yield from contacts(condition)
                yield Instruction("ANB" if join == "AND" else "ORB")
                return
            # blocks first: a contact after a block needs no block instruction
            for n, operand in enumerate(sorted(operands, key=_is_contact)):
                yield from contacts(operand, operation if n else join)
        case _:
            raise TypeError(f"not a condition: {condition!r}")


def _inverted(operand: Expr, join: str) -> Iterator[Instruction]:
    match operand:
        case Bit(kind, number):
            yield Instruction(_BREAK[join], (DeviceOperand(kind, number),))
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
    return Constant(operand) if isinstance(operand, int) else DeviceOperand(operand.kind, operand.number)


class _ListWriter:
    def __init__(self, program: Program, pulses: PulseTrain | None) -> None:
        self._program = program
        self._pulses = pulses
        relays = {each.name: each.number for each in program.devices() if each.kind == "M"}
        self._fault, self._lost = relays.get(SCAN_FAULT), relays.get(MEMORY_LOST)
        self._list: list[Instruction] = []
        self._titles: dict[int, str] = {}

    def ladder(self, tripped: DeviceOperand) -> Ladder:
        used = {(device.kind, device.number) for device in self._program.devices()}
        done = next(n for n in RETENTIVE["M"][0] if n >= FIXED_LATCH and ("M", n) not in used)
        self._first_values(done)
        supervision = self._supervise_scans(tripped)
        ladder = self.rungs()
        comments = {f"M{done}": "initial values have been written"} | supervision | ladder.comments
        return replace(ladder, comments=comments)

    def rungs(self) -> Ladder:
        used = {(device.kind, device.number) for device in self._program.devices()}
        if not used.isdisjoint(("D", number) for number in SCRATCH):
            raise LadderError(f"D{SCRATCH[0]} to D{SCRATCH[-1]} are reserved for the export; use other registers")
        for block in self._program.blocks:
            self._block(block)
        self._list.append(Instruction("END"))
        return Ladder(tuple(self._list), self._titles, self._comments(), self._program.name)

    def _comments(self) -> dict[str, str]:
        return {str(device): device.name for device in self._program.devices() if device.name}

    def _first_values(self, done: int) -> None:
        """Write the power-up initialisation of the soft PLC: reset steps and alarms, and set the initial set-points.

        The reset is required because an FX2N retains S500 to S999 through a loss of power. Faults that persist are
        detected again. The relay `done` is the mark of valid memory: it is missing on a new PLC, and a low battery at
        power-up resets it.
        """
        self._titles[len(self._list)] = POWER_UP
        self._add("LD", DeviceOperand("M", ALWAYS))
        self._add("OUT", DeviceOperand("M", ANNUNCIATORS_ENABLED))
        if self._fault is not None:
            self._add("INC", COUNTER)
        self._add("LD", DeviceOperand("M", FIRST_SCAN))
        self._add("ZRST", DeviceOperand("S", 0), DeviceOperand("S", SIZES["S"] - 1))
        if self._fault is not None:
            self._add("MOV", MORE_THAN_A_SECOND, COUNTER)
        if self._lost is not None:
            self._add("AND", DeviceOperand("M", BATTERY_LOW))
            self._add("RST", DeviceOperand("M", done))
        first = [*self._lost_memory(), *self._moves(constants=False)]
        for n, instruction in enumerate(first):
            if n % (MOST_LINES - 1) == 0:  # SET follows in the last ladder block
                self._add("LD", DeviceOperand("M", FIRST_SCAN))
                self._add("ANI", DeviceOperand("M", done))
            self._list.append(instruction)
        if first:
            self._add("SET", DeviceOperand("M", done))
        for n, instruction in enumerate(self._moves(constants=True)):
            if n % MOST_LINES == 0:
                self._add("LD", DeviceOperand("M", FIRST_SCAN))
            self._list.append(instruction)

    def _moves(self, *, constants: bool) -> Iterator[Instruction]:
        """Yield the instructions that write the machine constants, or the other set-points."""
        for word, value in self._program.set_points:
            if (word in self._program.constants) is constants:
                yield Instruction("MOV", (Constant(value), _word(word)))

    def _lost_memory(self) -> Iterator[Instruction]:
        """Yield the instructions that set the relay of lost memory, and clear what is left of the memory."""
        if self._lost is None:
            return
        yield Instruction("OUT", (DeviceOperand("M", self._lost),))
        for kind in ("M", "D"):
            (latched,) = (span for span, kept in PROGRAM_RANGES[kind] if kept == "retentive")
            used = [d.number for d in self._program.devices() if d.kind == kind and d.number in latched]
            if used:
                yield Instruction("ZRST", (DeviceOperand(kind, min(used)), DeviceOperand(kind, max(used))))

    def _supervise_scans(self, tripped: DeviceOperand) -> dict[str, str]:
        """Write the supervision of the scan time, if the program has a relay for it; return its comments."""
        if self._fault is None:
            return {}
        self._titles[len(self._list)] = SUPERVISION
        self._list += scan_supervision(DeviceOperand("M", self._fault), tripped)
        return {str(tripped): "scans too long", str(COUNTER): "scans in this second"}

    def _block(self, block: Block) -> None:
        self._titles[len(self._list)] = block.title
        before: Expr | None = None
        outputs = 0
        for item in block.items:
            if isinstance(item, Sequence):
                self._sequence(item)
                before = None
            else:
                when = item.driven if isinstance(item, Scale) else item.when
                if when != before or outputs == MOST_LINES:
                    self._list += contacts(when)
                    outputs = 0
                outputs += 1
                if isinstance(item, Scale):
                    self._scale(item)
                else:
                    self._output(item)
                # the next rung may share the contacts unless this one has changed them or the devices that they read
                changed = isinstance(item, Scale | Annunciate) or set(written_devices(item)) & set(leaves(when))
                before = None if changed else when

    def _sequence(self, sequence: Sequence) -> None:
        *earlier, _ = sequence.steps
        for step in earlier:
            if step.dwell is None and not sequence.transfers[step.title]:
                raise LadderError(
                    f"{sequence.name}: step {step.title!r} has no instructions, and STL instructions that follow each "
                    "other join parallel branches; make it the last step of its sequence"
                )
        for bit, step in sequence:
            self._titles.setdefault(len(self._list), step.title)
            self._add("STL", DeviceOperand("S", bit.number))
            self._step(sequence, step)
        self._add("RET")

    def _step(self, sequence: Sequence, step: Step) -> None:
        dwell = sequence.dwell_rung(step)
        if dwell is not None:
            self._list += contacts(dwell.when)
            self._output(dwell)
        for transfer in sequence.transfers[step.title]:
            self._list += contacts(transfer.when)
            self._add("SET", DeviceOperand("S", transfer.target.number))
            if sequence.consumes is not None:
                self._add("RST", DeviceOperand("M", sequence.consumes.number))

    def _output(self, rung: Rung) -> None:
        match rung:
            case Out(target) if self._pulses is not None and target == self._pulses.output:
                self._add("PLSY", Constant(self._pulses.frequency_hz), Constant(0), _device(target))
            case Out(target):
                self._add("OUT", _device(target))
            case Set(target):
                self._add("SET", _device(target))
            case Rst(target):
                self._add(
                    "RST",
                    DeviceOperand(target.kind, target.number)
                    if isinstance(target, Bit | Word)
                    else DeviceOperand(str(target)[0], target.number),
                )
            case ZoneReset(first, last):
                self._add("ZRST", _device(first), _device(last))
            case Pulse(target) | PulseFalling(target):
                self._add("PLS" if isinstance(rung, Pulse) else "PLF", _device(target))
            case OnDelay(timer):
                self._add("OUT", DeviceOperand("T", timer.number), _word(rung.counts))
            case Count(counter, preset):
                self._add("OUT", DeviceOperand("C", counter.number), _word(preset))
            case Mov(source, target):
                self._add("MOV", _word(source), _word(target))
            case Inc() | Add() | Subtract():
                self._arithmetic(rung)
            case Annunciate(timer, preset, target):
                # instead of ANS: one step less, and a much shorter execution time (fx2n_times.csv)
                self._add("OUT", DeviceOperand("T", timer.number), Constant(preset // timer.base_ms))
                self._add("LD", DeviceOperand("T", timer.number))
                self._add("SET", _device(target))

    def _arithmetic(self, rung: Arithmetic) -> None:
        match rung:
            case Inc(target):
                self._add("INC", _word(target))
            case Add(first, second, target):
                self._add("ADD", _word(first), _word(second), _word(target))
            case Subtract(minuend, subtrahend, target):
                self._add("SUB", _word(minuend), _word(subtrahend), _word(target))

    def _scale(self, rung: Scale) -> None:
        """Write the product, the quotient and its limits; the quotient is limited after it has been copied."""
        product, divisor, quotient = (DeviceOperand("D", number) for number in SCRATCH[:6:2])
        target = _word(rung.target)
        self._add("MUL", _word(rung.source), _word(rung.factor), product)
        if isinstance(rung.divisor, Word):
            self._add("MOV", _word(rung.divisor), divisor)
            self._add("MOV", Constant(0), replace(divisor, number=divisor.number + 1))
            self._add("DDIV", product, divisor, quotient)
        else:
            self._add("DDIV", product, Constant(rung.divisor), quotient)
        self._add("MOV", quotient, target)
        self._add("MPS")
        self._add("ANDD>", quotient, Constant(WORD_MAX))
        self._add("MOV", Constant(WORD_MAX), target)
        self._add("MPP")
        self._add("ANDD<", quotient, Constant(0))
        self._add("MOV", Constant(0), target)

    def _add(self, name: str, *operands: Operand) -> None:
        self._list.append(Instruction(name, operands))


def _device(bit: Bit) -> DeviceOperand:
    return DeviceOperand(bit.kind, bit.number)
