"""Export of a program as IEC 61131-3 Structured Text: one PROGRAM equivalent to the scan of the soft PLC.

Timers are written as statements instead of TON calls, because a TON measures from its call, whereas an FX timer
counts ticks of its time base, and the tick count does not change during a scan. All of them use `now_ms`, the time of
the scan, which the runtime parts of a package advance; without runtime parts, it is an input of the PROGRAM. `now_ms`
is a LINT because a UDINT of milliseconds wraps after 49 days, and the result of an integer overflow is
implementation-defined.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence as Rows
from dataclasses import dataclass
from typing import Final

from controller.core.devices import (
    ANNUNCIATOR_ON,
    CLOCK_1_S,
    INITIAL_PULSE,
    LOWEST_ANNUNCIATOR,
    MS_10,
    MS_100,
    WORD_MAX,
    WORD_MIN,
    is_32_bit_counter,
)
from controller.core.expr import And, Bit, Compare, Const, Counter, Expr, Not, Or, Timer, Word
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
)
from controller.core.sequence import Sequence, Step
from controller.export.runtime_parts.part import RuntimePart
from controller.export.structured_text_variables import INDENT, SPECIAL, Variables, identifier, plain, type_of
from controller.fx.engine.cpu import RETENTIVE_TIMERS

WIDTH: Final = 120
_NO_BREAK: Final = "\0"
"""Placeholder for a space at which lines must not wrap; lines break only before AND and OR."""
_RELATIONS: Final = {"==": "=", "!=": "<>", "<": "<", "<=": "<=", ">": ">", ">=": ">="}
_OPPOSITES: Final = {"==": "!=", "!=": "==", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}


@dataclass(frozen=True, slots=True)
class ProgramText:
    """PROGRAM in Structured Text, plain ASCII.

    Attributes:
        name: Name of the PROGRAM.
        variables: Its variables.
        body: Its statements.
    """

    name: str
    variables: Variables
    body: str

    def __str__(self) -> str:
        sections = (f"PROGRAM {self.name}", *self.variables.sections(), self.body)
        return "\n\n".join(sections) + "\n\nEND_PROGRAM\n"


def structured_text(
    program: Program, *, name: str = "transplanter", parts: Rows[RuntimePart] = (), variables: Variables | None = None
) -> ProgramText:
    """Return a program as one PROGRAM in Structured Text, without vendor extensions.

    Every device of the program becomes a variable; retentive devices are in VAR RETAIN, and set-points have
    their initial values.

    Args:
        program: Program; `controller.export.instruction_list.acting` removes the parts that do not influence Y.
        name: Name of the PROGRAM.
        parts: Runtime parts, in the order of their statements; none = `now_ms` is an input of the PROGRAM.
        variables: Variables of the program; None = every device has an address.
    """
    return _TextWriter(program, variables or Variables(program)).text(identifier(name), parts)


class _TextWriter:
    """Line-by-line writer of the statements."""

    def __init__(self, program: Program, variables: Variables) -> None:
        self._program = program
        self._variables = variables
        self._var = self._variables.device
        self._lines: list[str] = []
        self._depth = 0

    def text(self, name: str, parts: Rows[RuntimePart]) -> ProgramText:
        for part in parts:
            self._add(*part.begin(self._variables))
        before, self._lines = self._lines, []
        for block in self._program.blocks:
            self._block(block)
        body, self._lines = self._lines, []
        self._begin()
        start, self._lines = self._lines, []
        self._end()
        for part in parts:
            self._add(*part.end(self._variables))
        return ProgramText(name, self._variables, "\n".join(before + start + body + self._lines))

    def _begin(self) -> None:
        for base in (MS_100, MS_10):
            self._add(f"{self._tick(base)} := now_ms / {base};")
        clock = Bit("M", CLOCK_1_S)
        if clock in self._program.devices():
            self._add(f"{self._var(clock)} := (now_ms MOD 1000) < 500;")

    def _end(self) -> None:
        """Write the statements that reset the steps that were left and perform the END functions of the soft PLC."""
        self._add("", "(* END *)")
        for sequence in self._program.sequences():
            for bit, _ in sequence:
                leaves = self._leaves(bit)
                self._if(leaves, f"{self._var(bit)} := FALSE;", f"{leaves} := FALSE;")
        used = set(self._program.devices())
        if Bit("M", INITIAL_PULSE) in used:
            self._add(f"{self._var(Bit('M', INITIAL_PULSE))} := FALSE;")
        annunciators = sorted({d.number for d in used if isinstance(d, Bit) and d.kind == "S" and d.number >= 900})
        states = [self._var(Bit("S", number)) for number in annunciators]
        if Bit("M", ANNUNCIATOR_ON) in used:
            self._add(f"{self._var(Bit('M', ANNUNCIATOR_ON))} := {' OR '.join(states) or 'FALSE'};")
        if Word("D", LOWEST_ANNUNCIATOR) in used:
            lowest = self._var(Word("D", LOWEST_ANNUNCIATOR))
            self._add(f"{lowest} := 0;")
            for number, state in reversed(list(zip(annunciators, states, strict=True))):
                self._if(state, f"{lowest} := {number};")

    def _block(self, block: Block) -> None:
        self._add("", f"(* {plain(block.title)} *)")
        for item in block.items:
            if isinstance(item, Sequence):
                for bit, step in item:
                    self._step(item, bit, step)
            else:
                self._rung(item)

    def _step(self, sequence: Sequence, bit: Bit, step: Step) -> None:
        dwell = sequence.dwell_rung(step)
        transfers = sequence.transfers[step.title]
        if dwell is None and not transfers:
            return
        self._add(f"IF {self._var(bit)} THEN")
        self._depth += 1
        if dwell is not None:
            self._rung(dwell)
        for n, transfer in enumerate(transfers):
            self._add(f"{'ELSIF' if n else 'IF'} {self._condition(transfer.when)} THEN")
            self._depth += 1
            self._add(f"{self._var(transfer.target)} := TRUE;", f"{self._leaves(transfer.target)} := FALSE;")
            if transfer.source != transfer.target:
                self._add(f"{self._leaves(transfer.source)} := TRUE;")
            if sequence.consumes is not None:
                self._add(f"{self._var(sequence.consumes)} := FALSE;")
            self._depth -= 1
        if transfers:
            self._add("END_IF;")
        self._depth -= 1
        if dwell is not None:
            self._add("ELSE", *(f"{INDENT}{line}" for line in self._stopped(dwell.timer)))
        self._add("END_IF;")

    def _rung(self, rung: Rung) -> None:
        when = self._condition(rung.when)
        match rung:
            case Out(target):
                self._add(f"{self._var(target)} := {when};")
            case Set(target):
                self._if(when, f"{self._var(target)} := TRUE;")
            case Rst(target):
                self._if(when, *self._reset(target))
            case ZoneReset(first, last):
                zone = (Bit(first.kind, number) for number in range(first.number, last.number + 1))
                self._if(when, *(f"{self._var(bit)} := FALSE;" for bit in zone))
            case Pulse(target) | PulseFalling(target):
                self._pulse(target, when, rising=isinstance(rung, Pulse))
            case OnDelay(timer, _):
                self._timer(timer, rung.counts, when)
            case Annunciate(timer, preset, target):
                self._timer(timer, preset // MS_100, when, then=f"{self._var(target)} := TRUE;")
            case Count():
                self._count(rung, when)
            case Mov(source, target):
                self._if(when, f"{self._var(target)} := {self._number(source, 'INT')};")
            case Scale():
                self._scale(rung)
            case Inc() | Add() | Subtract():
                self._arithmetic(rung, when)

    def _arithmetic(self, rung: Arithmetic, when: str) -> None:
        """Write a sum or difference that wraps at 16 bits; one correction is sufficient for two words."""
        target = self._var(rung.target)
        match rung:
            case Inc():
                one, sign, two = rung.target, "+", 1
            case Add(one, two):
                sign = "+"
            case Subtract(one, two):
                sign = "-"
        total, span = self._variables.helper("total", "LINT"), WORD_MAX - WORD_MIN + 1
        self._if(
            when,
            f"{total} := {self._number(one, 'LINT')} {sign} {self._number(two, 'LINT')};",
            f"IF {total} > {WORD_MAX} THEN {total} := {total} - {span}; END_IF;",
            f"IF {total} < {WORD_MIN} THEN {total} := {total} + {span}; END_IF;",
            f"{target} := LINT_TO_INT({total});",
        )

    def _scale(self, rung: Scale) -> None:
        scaled = self._variables.helper("scaled", "LINT")
        operands = (rung.source, rung.factor, rung.divisor)
        source, factor, divisor = (self._number(operand, "LINT") for operand in operands)
        self._if(
            self._condition(rung.driven),
            f"{scaled} := {source} * {factor} / {divisor};",
            f"IF {scaled} > {WORD_MAX} THEN {scaled} := {WORD_MAX}; END_IF;",
            f"IF {scaled} < 0 THEN {scaled} := 0; END_IF;",
            f"{self._var(rung.target)} := LINT_TO_INT({scaled});",
        )

    def _pulse(self, target: Bit, when: str, *, rising: bool) -> None:
        before = self._variables.memory(f"{self._var(target)}_before")
        now = self._variables.helper("driven")
        edge = f"{now} AND NOT {before}" if rising else f"NOT {now} AND {before}"
        self._add(f"{now} := {when};", f"{self._var(target)} := {edge};", f"{before} := {now};")

    def _timer(self, timer: Timer, counts: int | Word, when: str, then: str = "") -> None:
        tick, since, done = self._tick(timer.base_ms), self._since(timer), self._var(timer.done)
        self._add(f"IF {when} THEN")
        self._depth += 1
        if timer.number >= RETENTIVE_TIMERS:
            self._retentive(timer, counts)
        else:
            preset = self._number(counts, "LINT")
            self._add(f"IF {since} < 0 THEN {since} := {tick}; END_IF;", f"{done} := ({tick} - {since}) >= {preset};")
            if self._variables.has_value("T", timer.number):
                value = self._var(Word("T", timer.number))
                self._add(f"IF {done} THEN {value} := {self._number(counts, 'INT')};")
                self._add(f"ELSE {value} := LINT_TO_INT({tick} - {since}); END_IF;")
            if then:
                self._add(f"IF {done} THEN {then} END_IF;")
        self._depth -= 1
        stopped = (f"{since} := -1;",) if timer.number >= RETENTIVE_TIMERS else self._stopped(timer)
        self._add("ELSE", *(f"{INDENT}{line}" for line in stopped), "END_IF;")

    def _retentive(self, timer: Timer, counts: int | Word) -> None:
        tick, since, value = self._tick(timer.base_ms), self._since(timer), self._var(Word("T", timer.number))
        sum_ = f"INT_TO_LINT({value}) + {tick} - {since}"
        self._if(f"{since} >= 0", f"{value} := LINT_TO_INT(MIN({sum_}, LINT#{WORD_MAX}));")
        self._add(f"{since} := {tick};")
        self._if(f"{value} >= {self._number(counts, 'INT')}", f"{self._var(timer.done)} := TRUE;")

    def _stopped(self, timer: Timer) -> tuple[str, ...]:
        value = Word("T", timer.number)
        zero = (f"{self._var(value)} := 0;",) if self._variables.has_value("T", timer.number) else ()
        return (f"{self._since(timer)} := -1;", f"{self._var(timer.done)} := FALSE;", *zero)

    def _count(self, rung: Count, when: str) -> None:
        counter, wide = rung.counter, is_32_bit_counter(rung.counter.number)
        value, done = self._var(counter.value), self._var(counter.done)
        preset = self._number(rung.preset, "DINT" if wide else "INT")
        before, now = self._variables.memory(f"{done}_before"), self._variables.helper("driven")
        self._add(f"{now} := {when};", f"IF {now} AND NOT {before} THEN")
        self._depth += 1
        if wide:
            down = self._var(Bit("M", SPECIAL + counter.number))
            self._add(f"IF {down} THEN {value} := {value} - 1; ELSE {value} := {value} + 1; END_IF;")
            # the contact changes when the value passes the preset
            self._add(f"IF NOT {down} AND ({value} = {preset}) THEN {done} := TRUE;")
            self._add(f"ELSIF {down} AND ({value} = {preset} - 1) THEN {done} := FALSE; END_IF;")
        else:
            self._if(f"{value} < {preset}", f"{value} := {value} + 1;")
            self._if(f"{value} >= {preset}", f"{done} := TRUE;")
        self._depth -= 1
        self._add("END_IF;", f"{before} := {now};")

    def _reset(self, target: Bit | Word | Timer | Counter) -> tuple[str, ...]:
        match target:
            case Bit():
                return (f"{self._var(target)} := FALSE;",)
            case Word():
                return (f"{self._var(target)} := 0;",)
            case Timer():
                return self._stopped(target)
        return (f"{self._var(target.value)} := 0;", f"{self._var(target.done)} := FALSE;")

    def _condition(self, expr: Expr) -> str:
        match expr:
            case Bit():
                return self._var(expr)
            case Not(Compare(relation, left, right)):
                return self._condition(Compare(_OPPOSITES[relation], left, right))
            # STruC++ takes NOT before a parenthesis for the function of that name, and its C++ is then not valid
            case Not(And(operands)):
                return self._condition(Or(tuple(~operand for operand in operands)))
            case Not(Or(operands)):
                return self._condition(And(tuple(~operand for operand in operands)))
            case Not(operand):
                return f"NOT {self._grouped(operand)}"
            case And(operands) | Or(operands):
                return f" {'AND' if isinstance(expr, And) else 'OR'} ".join(map(self._grouped, operands))
            case Const(value):
                return str(value).upper()
            case Compare(relation, left, right):
                wide = "DINT" in (_word_type(left), _word_type(right))
                type_ = "DINT" if wide else "INT"
                return f"{self._number(left, type_)} {_RELATIONS[relation]} {self._number(right, type_)}"
        raise TypeError(f"not a condition: {expr!r}")

    def _grouped(self, expr: Expr) -> str:
        bare = isinstance(expr, Bit | Const) or (isinstance(expr, Not) and isinstance(expr.operand, Bit))
        return self._condition(expr) if bare else f"({self._condition(expr)})"

    def _number(self, operand: Word | int, type_: str) -> str:
        """Return a number or word as text, converted to the given type; Structured Text has no implicit conversion."""
        if isinstance(operand, int):
            return str(operand)
        word_type = _word_type(operand)
        return self._var(operand) if word_type == type_ else f"{word_type}_TO_{type_}({self._var(operand)})"

    def _tick(self, base_ms: int) -> str:
        return self._variables.helper(f"tick_{base_ms}", "LINT") if base_ms in (MS_10, MS_100) else "now_ms"

    def _since(self, timer: Timer) -> str:
        return self._variables.helper(f"{self._var(timer.done)}_since", "LINT", "-1")

    def _leaves(self, bit: Bit) -> str:
        return self._variables.helper(f"{self._var(bit)}_leaves")

    def _if(self, condition: str, *statements: str) -> None:
        if condition == "TRUE":
            self._add(*statements)
        else:
            self._add(f"IF {condition} THEN", *(f"{INDENT}{statement}" for statement in statements), "END_IF;")

    def _add(self, *lines: str) -> None:
        for line in lines:
            bare = re.sub(r"(?<=\S) (?!(?:AND|OR) )", _NO_BREAK, line.lstrip())
            indent = INDENT * self._depth + line[: len(line) - len(line.lstrip())]
            wrapped = textwrap.wrap(
                bare,
                WIDTH,
                initial_indent=indent,
                subsequent_indent=indent + INDENT * 2,
                break_long_words=False,
                break_on_hyphens=False,
            )
            self._lines += [part.replace(_NO_BREAK, " ") for part in wrapped] or [""]


def _word_type(operand: Word | int) -> str:
    return "INT" if isinstance(operand, int) else type_of(operand.kind, operand.number)
