"""Compiler from program blocks to Python functions that operate on the lists of one Memory.

The source of each function is generated from the declaration; nothing is interpreted during a scan. The functions
take the tick counts of the scan (time divided by 100, 10 and 1 ms), which are latched once per scan.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import groupby
from types import CodeType
from typing import Final, cast

from controller.core.devices import MS_10, MS_100, WORD_MAX, WORD_MIN, Memory, is_32_bit_counter
from controller.core.expr import And, Bit, Compare, Const, Counter, Expr, Not, Or, Timer, Word, all_of
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
    written_devices,
)
from controller.core.sequence import Sequence

BlockFunction = Callable[[int, int, int], None]
Transfers = dict[str, Callable[[], None]]

_Latching = Set | Rst | ZoneReset | Mov | Inc | Add | Subtract
"""Rung types that write nothing while they are not driven."""

_LISTS: Final = ("X", "Y", "M", "S", "T", "C", "D", "TV", "TS", "CV", "CE", "E")
_RETENTIVE_TIMERS: Final = 246
_INDENT: Final = "    "


def expression(expr: Expr) -> str:
    """Return a condition as a Python expression over the device lists.

    Examples:
        >>> expression(Bit("X", 8) & ~Bit("M", 3))
        'X[8] and not M[3]'
    """
    match expr:
        case Bit(kind, number):
            return f"{kind}[{number}]"
        case Not(operand):
            return f"not {_grouped(operand)}"
        case And(operands):
            return " and ".join(_grouped(o) if isinstance(o, Or) else expression(o) for o in operands)
        case Or(operands):
            return " or ".join(expression(o) for o in operands)
        case Const(value):
            return str(value)
        case Compare(relation, left, right):
            return f"{word(left)} {relation} {right if isinstance(right, int) else word(right)}"
    raise TypeError(f"not a condition: {expr!r}")


def word(operand: Word | int) -> str:
    """Return a word or a constant as a Python expression."""
    if isinstance(operand, int):
        return str(operand) if operand >= 0 else f"({operand})"
    return f"{ {'D': 'D', 'T': 'TV', 'C': 'CV'}[operand.kind] }[{operand.number}]"


def _arithmetic(rung: Arithmetic) -> str:
    """Return the result of a rung as a Python expression; it wraps at 16 bits."""
    match rung:
        case Inc(target):
            result = f"{word(target)} + 1"
        case Add(one, two):
            result = f"{word(one)} + {word(two)}"
        case Subtract(one, two):
            result = f"{word(one)} - {word(two)}"
    return f"({result} - {WORD_MIN}) % {WORD_MAX - WORD_MIN + 1} + {WORD_MIN}"


def _grouped(expr: Expr) -> str:
    return expression(expr) if isinstance(expr, Bit | Const) else f"({expression(expr)})"


def _common_contact(item: Rung | Sequence) -> Expr | None:
    """Return the first contact of a rung if the rung writes nothing while that contact is open, otherwise None.

    Consecutive rungs with the same first contact are executed as branches (MPS, MRD, MPP) of that contact. A rung
    that writes the device of the contact is not part of a branch.
    """
    if not isinstance(item, _Latching):
        return None
    first = item.when.operands[0] if isinstance(item.when, And) else item.when
    bit = first.operand if isinstance(first, Not) else first
    return first if isinstance(bit, Bit) and bit not in written_devices(item) else None


class _Source:
    """Line-by-line builder of the source code of one function."""

    def __init__(self, edges: Iterator[int]) -> None:
        self.lines: list[str] = []
        self.edges = edges

    def add(self, depth: int, *lines: str) -> None:
        self.lines.extend(_INDENT * depth + line for line in lines)

    def rung(self, rung: Rung, depth: int = 1) -> None:
        when = expression(rung.when)
        match rung:
            case Out(target):
                self.add(depth, f"{expression(target)} = {when}")
            case Set(target):
                self.add(depth, f"if {when}: {expression(target)} = True")
            case Rst(target):
                self.add(depth, f"if {when}:")
                self.add(depth + 1, *_reset(target))
            case ZoneReset(first, last):
                span = f"{first.number}:{last.number + 1}"
                size = last.number + 1 - first.number
                self.add(depth, f"if {when}: {first.kind}[{span}] = [False] * {size}")
            case Pulse(target) | PulseFalling(target):
                edge = next(self.edges)
                rule = f"now and not E[{edge}]" if isinstance(rung, Pulse) else f"not now and E[{edge}]"
                self.add(depth, f"now = {when}", f"{expression(target)} = {rule}", f"E[{edge}] = now")
            case OnDelay(timer):
                self.timer(timer, rung.counts, when, depth)
            case Annunciate(timer, preset, target):
                self.timer(timer, preset // MS_100, when, depth, done=f"S[{target.number}] = True")
            case Count():
                self.counter(rung, when, depth)
            case Mov(source, target):
                self.add(depth, f"if {when}: {word(target)} = {word(source)}")
            case Inc() | Add() | Subtract():
                self.add(depth, f"if {when}: {word(rung.target)} = {_arithmetic(rung)}")
            case Scale(source, factor, divisor, target):
                quotient = f"{word(source)} * {word(factor)} // {word(divisor)}"
                self.add(depth, f"if {expression(rung.driven)}: {word(target)} = max(0, min({quotient}, {WORD_MAX}))")

    def branch(self, contact: Expr, rungs: Iterator[_Latching]) -> None:
        self.add(1, f"if {expression(contact)}:")
        for rung in rungs:
            rest = rung.when.operands[1:] if isinstance(rung.when, And) else ()
            self.rung(replace(rung, when=all_of(*rest)), 2)

    def timer(self, timer: Timer, counts: int | Word, when: str, depth: int, done: str = "") -> None:
        n = timer.number
        tick = {MS_100: "tick_100", MS_10: "tick_10"}.get(timer.base_ms, "tick_1")
        preset = word(counts)
        if n >= _RETENTIVE_TIMERS:
            self.add(
                depth,
                f"if {when}:",
                f"    if TS[{n}] >= 0: TV[{n}] = min(TV[{n}] + {tick} - TS[{n}], {WORD_MAX})",
                f"    TS[{n}] = {tick}",
                f"    if TV[{n}] >= {preset}: T[{n}] = True",
                f"else: TS[{n}] = -1",
            )
            return
        self.add(
            depth,
            f"if {when}:",
            f"    if TS[{n}] < 0: TS[{n}] = {tick}",
            f"    v = {tick} - TS[{n}]",
            f"    T[{n}] = v >= {preset}",
            f"    TV[{n}] = {preset} if v >= {preset} else v",
            *([f"    if T[{n}]: {done}"] if done else []),
            f"elif TS[{n}] >= 0: TS[{n}] = -1; TV[{n}] = 0; T[{n}] = False",
        )

    def counter(self, rung: Count, when: str, depth: int) -> None:
        n = rung.counter.number
        preset = word(rung.preset)
        self.add(depth, f"now = {when}", f"if now and not CE[{n}]:")
        if is_32_bit_counter(n):
            self.add(
                depth + 1,
                f"v = CV[{n}]",
                f"CV[{n}] = v - 1 if M[{8000 + n}] else v + 1",
                f"if v == {preset} - 1 and CV[{n}] == {preset}: C[{n}] = True",
                f"elif v == {preset} and CV[{n}] == {preset} - 1: C[{n}] = False",
            )
        else:
            self.add(
                depth + 1,
                f"if CV[{n}] < {preset}: CV[{n}] += 1",
                f"if CV[{n}] >= {preset}: C[{n}] = True",
            )
        self.add(depth, f"CE[{n}] = now")

    def sequence(self, sequence: Sequence, index: int) -> None:
        for bit, step in sequence:
            dwell = sequence.dwell_rung(step)
            transfers = sequence.transfers[step.title]
            if dwell is None and not transfers:
                continue
            self.add(1, f"if {expression(bit)}:")
            if dwell is not None:
                self.rung(dwell, 2)
            for n, transfer in enumerate(transfers):
                self.add(2, f"{'el' if n else ''}if {expression(transfer.when)}:", f"    {trigger(index, bit, n)}()")
                if sequence.consumes is not None:
                    self.add(3, f"{expression(sequence.consumes)} = False")
            if dwell is not None:
                n = dwell.timer.number
                self.add(1, f"elif TS[{n}] >= 0: TS[{n}] = -1; TV[{n}] = 0; T[{n}] = False")


def _reset(target: Bit | Word | Timer | Counter) -> tuple[str, ...]:
    match target:
        case Bit():
            return (f"{expression(target)} = False",)
        case Word():
            return (f"{word(target)} = 0",)
        case Timer(n):
            return (f"TV[{n}] = 0; TS[{n}] = -1; T[{n}] = False",)
    n = target.number
    return (f"CV[{n}] = 0; C[{n}] = False",)


def trigger(index: int, source: Bit, n: int) -> str:
    """Return the trigger name of transfer n out of step `source` in sequence number `index`."""
    return f"transfer_{index}_{source.number}_{n}"


def compile_program(program: Program, memory: Memory, transfers: Transfers) -> list[BlockFunction]:
    """Compile every block to a function that operates on the memory.

    Args:
        program: Program to compile.
        memory: Memory whose lists the functions access; E is resized to the number of edges in the program.
        transfers: Function that executes each transfer, keyed by the name returned by `trigger`.

    Returns:
        One function per block, in scan order. Its arguments are the scan time in ticks of 100, 10 and 1 ms.
    """
    memory.E[:] = [False] * _edges(program)
    namespace = {name: getattr(memory, name) for name in _LISTS} | transfers
    functions: list[BlockFunction] = []
    for code in _code(program):
        block_namespace = dict(namespace)
        exec(code, block_namespace)  # noqa: S102 - source generated from checked declarations
        functions.append(block_namespace["block"])
    return functions


def _edges(program: Program) -> int:
    return sum(isinstance(rung, Pulse | PulseFalling) for rung in program.rungs())


@lru_cache(maxsize=16)
def _code(program: Program) -> tuple[CodeType, ...]:
    """Return the code object of each block function; all PLCs with the same program share them."""
    edges, index = iter(range(_edges(program))), iter(range(len(list(program.sequences()))))
    return tuple(_block_code(block, edges, index) for block in program.blocks)


def _block_code(block: Block, edges: Iterator[int], index: Iterator[int]) -> CodeType:
    source = _Source(edges)
    for contact, items in groupby(block.items, _common_contact):
        if contact is None:
            for item in items:
                if isinstance(item, Sequence):
                    source.sequence(item, next(index))
                else:
                    source.rung(item)
        else:
            source.branch(contact, cast(Iterator[_Latching], items))
    body = "\n".join(source.lines) or _INDENT + "pass"
    lists = [name for name in _LISTS if f"{name}[" in body]
    triggers = dict.fromkeys(re.findall(r"\btransfer_\w+(?=\()", body))
    arguments = ", ".join(["tick_100", "tick_10", "tick_1", *(f"{name}={name}" for name in (*lists, *triggers))])
    return _compiled(f"def block({arguments}):\n{body}\n", f"<block {block.title}>")


@lru_cache(maxsize=256)
def _compiled(source: str, name: str) -> CodeType:
    """Return the code object of a source text; programs of similar I/O maps have most blocks in common."""
    return compile(source, name, "exec")
