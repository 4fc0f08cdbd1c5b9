"""Translation of a program to LLVM IR: one function per block, and one for the complete scan.

The translation has the semantics of `controller.core.compile`. Device memory is one region (`MemoryLayout`); bits are
bytes of 0 or 1, words are 64-bit integers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from controller.core.devices import (
    ANNUNCIATOR_ON,
    ANNUNCIATORS,
    CLOCK_1_S,
    INITIAL_PULSE,
    LOWEST_ANNUNCIATOR,
    MS_10,
    MS_100,
    RUN_MONITOR,
    WORD_MAX,
    WORD_MIN,
    is_32_bit_counter,
)
from controller.core.expr import And, Bit, Compare, CompiledCondition, Const, Counter, Expr, Not, Or, Timer, Word
from controller.core.llvm_function import FunctionBody, function, module, name_of
from controller.core.memory_layout import MemoryLayout
from controller.core.program import Block, Program
from controller.core.rungs import (
    Add,
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
    Scale,
    Set,
    Subtract,
    ZoneReset,
)
from controller.core.sequence import Sequence, Transfer

_FIRST_RETENTIVE_TIMER: Final = 246
_WORD_ROWS: Final = {"D": "D", "T": "TV", "C": "CV"}
_PARAMETERS: Final = "ptr %m, i64 %tick_100, i64 %tick_10, i64 %tick_1"


@dataclass(frozen=True, slots=True)
class LlvmProgram:
    """Program in LLVM IR.

    Attributes:
        modules: One module for each distinct block, and one for the scan. Each can be compiled separately.
        entry: Name of the scan function. Its arguments are the memory region, the time in ms, and a flag that is 1 in
            the first scan and 0 in all others.
    """

    modules: tuple[str, ...]
    entry: str


def translate(program: Program, layout: MemoryLayout) -> LlvmProgram:
    """Translate a program.

    The name of a function is derived from its text, so that identical blocks have identical modules.
    """
    edges = iter(range(layout.bits["E"].length))
    blocks = [_block(block, layout, edges) for block in program.blocks]
    names = [name_of(body) for body in blocks]
    modules = [module([_function(name, _PARAMETERS, body)]) for name, body in zip(names, blocks, strict=True)]
    body = _scan(program, layout, names)
    entry = name_of(body)
    declarations = [f"declare void @{name}({_PARAMETERS})" for name in dict.fromkeys(names)]
    modules.append(module([_function(entry, "ptr %m, i64 %now_ms, i64 %first", body)], declarations))
    return LlvmProgram(tuple(dict.fromkeys(modules)), entry)


def translate_condition(expr: Expr, layout: MemoryLayout) -> LlvmProgram:
    """Translate a condition to a function that returns 1 if the condition is true, else 0.

    Its arguments are the addresses of the memory region, and of two regions for a `CompiledCondition`: outside data,
    and cells that it may change.
    """
    code = _ProgramBody(layout, iter(()))
    result = code.value(f"zext i1 {code.condition(expr)} to i64")
    code.add(f"ret i64 {result}")
    entry = name_of(code.text())
    return LlvmProgram((module([function("i64", entry, "ptr %m, ptr %s, ptr %c", code.text())]),), entry)


def _function(name: str, parameters: str, body: str) -> str:
    return function("void", name, parameters, f"{body}\n  ret void")


def _block(block: Block, layout: MemoryLayout, edges: Iterator[int]) -> str:
    code = _ProgramBody(layout, edges)
    for item in block.items:
        if isinstance(item, Sequence):
            code.sequence(item)
        else:
            code.rung(item)
    return code.text()


def _scan(program: Program, layout: MemoryLayout, blocks: Iterable[str]) -> str:
    code = _ProgramBody(layout, iter(()))
    code.set_bit("M", RUN_MONITOR, "true")
    code.set_bit("M", INITIAL_PULSE, code.value("icmp ne i64 %first, 0"))
    code.set_bit("M", CLOCK_1_S, code.value(f"icmp slt i64 {code.value('srem i64 %now_ms, 1000')}, 500"))
    tick_100, tick_10 = (code.value(f"sdiv i64 %now_ms, {base}") for base in (MS_100, MS_10))
    for name in blocks:
        code.add(f"call void @{name}(ptr %m, i64 {tick_100}, i64 {tick_10}, i64 %now_ms)")
    # a step that was left goes off at END and was on during this scan (docs/sources/fx2n.md 1.7 rule 4)
    for state in sorted({t.source.number for t in _transfers(program)}):
        stays = code.value(f"xor i1 {code.bit('L', state)}, true")
        code.set_bit("S", state, code.all_of((code.bit("S", state), stays)))
        code.set_bit("L", state, "false")
    code.annunciators()
    return code.text()


def _transfers(program: Program) -> Iterator[Transfer]:
    for sequence in program.sequences():
        for transfers in sequence.transfers.values():
            yield from transfers


class _ProgramBody(FunctionBody):
    """Builder of the body of a block function or of the scan function."""

    def __init__(self, layout: MemoryLayout, edges: Iterator[int]) -> None:
        super().__init__(layout)
        self._edges = edges

    def operand(self, operand: Word | int) -> str:
        return str(operand) if isinstance(operand, int) else self.word(_WORD_ROWS[operand.kind], operand.number)

    # conditions

    def condition(self, expr: Expr) -> str:
        match expr:
            case Bit(kind, number):
                return self.bit(kind, number)
            case Not(operand):
                return self.inverse(self.condition(operand))
            case And(operands):
                return self.all_of(map(self.condition, operands))
            case Or(operands):
                return self.any_of(map(self.condition, operands))
            case Const(value):
                return "true" if value else "false"
            case Compare(relation, left, right):
                return self.compare(relation, self.operand(left), self.operand(right))
            case CompiledCondition():
                return expr.emit(self)
        raise TypeError(f"not a condition: {expr!r}")

    # rungs

    def rung(self, rung: Rung) -> None:
        """Add a rung."""
        when = self.condition(rung.when)
        match rung:
            case Out(target):
                self.set_bit(target.kind, target.number, when)
            case Pulse(target) | PulseFalling(target):
                edge = next(self._edges)
                before = self.bit("E", edge)
                pair = (when, self.inverse(before)) if isinstance(rung, Pulse) else (self.inverse(when), before)
                self.set_bit(target.kind, target.number, self.all_of(pair))
                self.set_bit("E", edge, when)
            case OnDelay(timer):
                self._timer(timer, rung.counts, when)
            case Annunciate(timer, preset, target):
                self._timer(timer, preset // MS_100, when)
                with self.on(self.all_of((when, self.bit("T", timer.number)))):
                    self.set_bit(target.kind, target.number, "true")
            case Count():
                self._counter(rung, when)
            case Scale(source, factor, divisor, target):
                with self.on(self.condition(rung.driven)):
                    # the product of two words does not overflow 64 bits
                    product = self.value(f"mul i64 {self.operand(source)}, {self.operand(factor)}")
                    quotient = self.value(f"sdiv i64 {product}, {self.operand(divisor)}")
                    limited = self.choice(self.compare("<", quotient, WORD_MAX), quotient, WORD_MAX)
                    limited = self.choice(self.compare("<", limited, 0), 0, limited)
                    self.set_word(_WORD_ROWS[target.kind], target.number, limited)
            case _:
                with self.on(when):
                    self._latch(rung)

    def _latch(self, rung: Set | Rst | ZoneReset | Mov | Inc | Add | Subtract) -> None:
        """Add the effect of a rung that writes nothing unless it is driven."""
        match rung:
            case Set(target):
                self.set_bit(target.kind, target.number, "true")
            case Rst(target):
                self._reset(target)
            case ZoneReset(first, last):
                self.clear_bits(first.kind, first.number, last.number)
            case Mov(source, target):
                self.set_word(_WORD_ROWS[target.kind], target.number, self.operand(source))
            case Add(one, two, target):
                self._sum("add", one, two, target)
            case Subtract(one, two, target):
                self._sum("sub", one, two, target)
            case Inc(target):
                row = _WORD_ROWS[target.kind]
                before = self.word(row, target.number)
                after = self.choice(self.compare("<", before, WORD_MAX), self.sum(before, 1), WORD_MIN)
                self.set_word(row, target.number, after)

    def _sum(self, operation: str, one: Word | int, two: Word | int, target: Word) -> None:
        """Add a sum or difference, of which the lower 16 bits are stored with their sign."""
        total = self.value(f"{operation} i64 {self.operand(one)}, {self.operand(two)}")
        word = self.value(f"trunc i64 {total} to i16")
        self.set_word(_WORD_ROWS[target.kind], target.number, self.value(f"sext i16 {word} to i64"))

    def _reset(self, target: Bit | Word | Timer | Counter) -> None:
        match target:
            case Bit(kind, number):
                self.set_bit(kind, number, "false")
            case Word(kind, number):
                self.set_word(_WORD_ROWS[kind], number, 0)
            case Timer(number):
                self._stop_timer(number)
            case Counter(number):
                self.set_word("CV", number, 0)
                self.set_bit("C", number, "false")

    def _stop_timer(self, number: int) -> None:
        self.set_word("TV", number, 0)
        self.set_word("TS", number, -1)
        self.set_bit("T", number, "false")

    def _timer(self, timer: Timer, counts: int | Word, when: str) -> None:
        number = timer.number
        tick = {MS_100: "%tick_100", MS_10: "%tick_10"}.get(timer.base_ms, "%tick_1")
        if number >= _FIRST_RETENTIVE_TIMER:
            self._retentive_timer(number, counts, when, tick)
            return
        with self.on(when):
            start = self.word("TS", number)
            start = self.choice(self.compare("<", start, 0), tick, start)
            self.set_word("TS", number, start)
            # in ticks of the time base, as the FX2N counts; a difference in ms would end up to one tick earlier or
            # later
            elapsed = self.value(f"sub i64 {tick}, {start}")
            preset = self.operand(counts)
            done = self.compare(">=", elapsed, preset)
            self.set_bit("T", number, done)
            self.set_word("TV", number, self.choice(done, preset, elapsed))
        self._stop_running_timer(number, self.inverse(when))

    def _stop_running_timer(self, number: int, unless_driven: str) -> None:
        with self.on(self.all_of((unless_driven, self.compare(">=", self.word("TS", number), 0)))):
            self._stop_timer(number)

    def _retentive_timer(self, number: int, counts: int | Word, when: str, tick: str) -> None:
        with self.on(when):
            start = self.word("TS", number)
            with self.on(self.compare(">=", start, 0)):
                total = self.sum(self.word("TV", number), self.value(f"sub i64 {tick}, {start}"))
                self.set_word("TV", number, self.choice(self.compare("<", total, WORD_MAX), total, WORD_MAX))
            self.set_word("TS", number, tick)
            with self.on(self.compare(">=", self.word("TV", number), self.operand(counts))):
                self.set_bit("T", number, "true")
        with self.on(self.inverse(when)):
            self.set_word("TS", number, -1)

    def _counter(self, rung: Count, when: str) -> None:
        number = rung.counter.number
        with self.on(self.all_of((when, self.inverse(self.bit("CE", number))))):
            before, preset = self.word("CV", number), self.operand(rung.preset)
            if is_32_bit_counter(number):
                self._count_both_ways(number, before, preset)
            else:
                counting = self.compare("<", before, preset)
                after = self.choice(counting, self.sum(before, 1), before)
                self.set_word("CV", number, after)
                with self.on(self.compare(">=", after, preset)):
                    self.set_bit("C", number, "true")
        self.set_bit("CE", number, when)

    def _count_both_ways(self, number: int, before: str, preset: str) -> None:
        down = self.bit("M", 8000 + number)
        after = self.sum(before, self.choice(down, -1, 1))
        self.set_word("CV", number, after)
        below = self.sum(preset, -1)
        # the contact changes only when the count passes the preset, not while it is above or below it
        reached = self.all_of((self.compare("==", before, below), self.compare("==", after, preset)))
        left = self.all_of((self.compare("==", before, preset), self.compare("==", after, below)))
        with self.on(reached):
            self.set_bit("C", number, "true")
        with self.on(left):
            self.set_bit("C", number, "false")

    # sequences

    def sequence(self, sequence: Sequence) -> None:
        """Add the steps of a sequence; the first transfer whose condition is true is taken."""
        for bit, step in sequence:
            dwell, transfers = sequence.dwell_rung(step), sequence.transfers[step.title]
            if dwell is None and not transfers:
                continue
            active = self.condition(bit)
            with self.on(active):
                if dwell is not None:
                    self.rung(dwell)
                pending = "true"
                for transfer in transfers:
                    condition = self.condition(transfer.when)
                    taken = self.all_of((pending, condition))
                    pending = self.all_of((pending, self.inverse(condition)))
                    with self.on(taken):
                        self._transfer(transfer, sequence.consumes)
            # the coil of a step that was left is executed as false (docs/sources/fx2n.md 1.7 rule 5)
            if dwell is not None:
                self._stop_running_timer(dwell.timer.number, self.inverse(active))

    def _transfer(self, transfer: Transfer, consumes: Bit | None) -> None:
        source, target = transfer.source.number, transfer.target.number
        self.set_bit("S", target, "true")
        # a step that was left in this scan and is entered again stays on
        self.set_bit("L", target, "false")
        if source != target:
            self.set_bit("L", source, "true")
        if consumes is not None:
            self.set_bit(consumes.kind, consumes.number, "false")

    def annunciators(self) -> None:
        """Update the special devices of the annunciators."""
        lowest = "0"
        for number in reversed(ANNUNCIATORS):
            lowest = self.choice(self.bit("S", number), number, lowest)
        active = self.compare("!=", lowest, 0)
        with self.on(self.value(f"or i1 {active}, {self.bit('M', ANNUNCIATOR_ON)}")):
            self.set_bit("M", ANNUNCIATOR_ON, active)
            self.set_word("D", LOWEST_ANNUNCIATOR, lowest)
