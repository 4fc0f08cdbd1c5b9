"""Auxiliary relays for conditions that a program evaluates more than once, so that its export needs fewer steps.

The transformation is value numbering, as in a compiler. Two conditions have the same value if they have the same form
and no rung between them writes a device that they read. Each value for which a relay saves steps is evaluated once,
directly before its first use, and read from the relay afterwards. The relay is written in every scan before it is
read, so neither its previous value nor a power failure has an effect. Contacts that several conditions have in common
form a value of their own (common cube extraction, as in logic synthesis).

Within a sequence, a condition is shared only if the sequence does not write the devices that the condition reads.
The relays are evaluated before the first step of the sequence, because a step is executed only while its state is on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from collections.abc import Sequence as Rows
from dataclasses import dataclass, replace
from heapq import heapify, heappop, heapreplace
from itertools import combinations
from textwrap import shorten
from typing import Final

from controller.core.expr import And, Bit, Compare, Const, Expr, Not, Or, Word, all_of, any_of, readable
from controller.core.program import Block, Program
from controller.core.rungs import Out, Rung, written_devices
from controller.core.sequence import Sequence as Steps
from controller.fx.language.instruction import LadderError

RELAYS: Final = range(500, 1024)
"""Auxiliary relays of the export, which the program must not use. A contact of M1536 or above would take two steps."""

_COMPARISON_STEPS: Final = 5
_PAIR_STEPS: Final = 3
"""Steps of the rung of a relay for two contacts in series. Each use of the relay saves one step."""
_COMPLEMENTS: Final = {"!=": "==", ">=": "<", ">": "<="}


def shared(program: Program) -> Program:
    """Return an equivalent program in which repeated conditions are evaluated once and stored in relays.

    Raises:
        LadderError: The program itself uses relays in the range `RELAYS`.
    """
    if any(device.kind == "M" and device.number in RELAYS for device in program.devices()):
        raise LadderError(f"M{RELAYS[0]} to M{RELAYS[-1]} are reserved for the export; use other relays")
    values = _Values()
    rows = [[(item, values.of_item(item)) for item in block.items] for block in program.blocks]
    values.extract_common_operands()
    writer = _Writer(values)
    blocks = (Block(block.title, tuple(writer.items(row))) for block, row in zip(program.blocks, rows, strict=True))
    return replace(program, blocks=tuple(blocks))


_Pair = tuple[tuple[int, bool], ...]
"""Two operands of a connection, each with its value number and True if it is negated."""


@dataclass(frozen=True, slots=True)
class _Value:
    """Condition and its value number; a condition and its complement have the same number.

    Attributes:
        number: Value number.
        negated: True if the condition is the complement of the numbered value.
        expr: Condition.
        parts: Values of its operands.
    """

    number: int
    negated: bool
    expr: Expr
    parts: tuple[_Value, ...] = ()


class _Size:
    """Uses and steps of each value while values are removed from those that are read from relays.

    Attributes:
        uses: Number of conditions and connections in which each value is written or read.
        steps: Steps of each value, written out.
    """

    def __init__(
        self, operands: Rows[frozenset[tuple[int, bool]]], uses: list[int], steps: list[int], chosen: set[int]
    ) -> None:
        self.uses = uses
        self.steps = steps
        self._chosen = chosen
        self._operands = [[operand for operand, _ in each] for each in operands]
        self._connections: list[list[int]] = [[] for _ in operands]
        for number, each in enumerate(self._operands):
            for operand in each:
                self._connections[operand].append(number)

    def saved(self, number: int) -> int:
        """Return the steps that a relay for a value saves."""
        uses, steps = self.uses[number], self.steps[number]
        return uses * steps - (steps + 1 + uses)

    def write_out(self, number: int) -> None:
        """Remove a value from those that are read from relays."""
        self._chosen.remove(number)
        self._use_operands(number, self.uses[number] - min(self.uses[number], 1))
        self._lengthen_connections(number, self.steps[number] + bool(self._operands[number]) - 1)

    def _use_operands(self, number: int, more: int) -> None:
        for operand in self._operands[number] if more else ():
            self.uses[operand] += more
            if operand not in self._chosen:
                self._use_operands(operand, more)

    def _lengthen_connections(self, number: int, more: int) -> None:
        for connection in self._connections[number] if more else ():
            self.steps[connection] += more
            if connection not in self._chosen:
                self._lengthen_connections(connection, more)


class _Values:
    """Value numbers of conditions, assigned in scan order.

    A parallel connection is numbered as the complement of a series connection of complements.
    """

    def __init__(self) -> None:
        self._numbers: dict[object, int] = {}
        self._operands: list[frozenset[tuple[int, bool]]] = []
        self._steps: list[int] = []
        self._uses: list[int] = []
        self._order: list[int] = []  # operands before their connections
        self._versions: Counter[tuple[str, int]] = Counter()
        self._changing: set[tuple[str, int]] = set()
        self._before: tuple[int, bool] | None = None

    def of_item(self, item: Rung | Steps) -> list[_Value]:
        """Return the values of the conditions of a rung or a sequence, and record the devices that it writes."""
        written = {(device.kind, device.number) for device in item_writes(item)}
        if isinstance(item, Steps):
            self._changing = written
            values = [self._of(condition) for condition in item.conditions()]
            self._changing = set()
        else:
            values = [self._of(item.when)]
        for value in values:
            # consecutive rungs with the same condition share their contacts
            self._uses[value.number] += (value.number, value.negated) != self._before
            self._before = None if isinstance(item, Steps) else (value.number, value.negated)
        self._versions.update(written)
        return values

    def extract_common_operands(self) -> None:
        """Replace pairs of operands that several connections have in common by values of their own."""
        chosen = self.worth_a_relay()
        uses = self._total_uses(chosen)
        times_written = {n: 1 if n in chosen else uses[n] for n, operands in enumerate(self._operands) if operands}
        pairs: Counter[_Pair] = Counter()
        for number, times in times_written.items():
            self._count_pairs(pairs, number, times)
        while (most := max(pairs.values(), default=0)) > _PAIR_STEPS:
            first = next(pair for number in times_written for pair in self._pairs(number) if pairs[pair] == most)
            self._extract(frozenset(first), times_written, pairs)

    def _pairs(self, number: int) -> Iterator[_Pair]:
        return combinations(sorted(self._operands[number]), 2)

    def _count_pairs(self, pairs: Counter[_Pair], number: int, times: int) -> None:
        for pair in self._pairs(number):
            pairs[pair] += times

    def _extract(self, pair: frozenset[tuple[int, bool]], times_written: dict[int, int], pairs: Counter[_Pair]) -> None:
        common = self._number(pair, 0, pair)
        having = [n for n in times_written if n != common and pair <= self._operands[n]]
        for number in having:
            self._count_pairs(pairs, number, -times_written[number])
            self._operands[number] = self._operands[number] - pair | {(common, False)}
            self._count_pairs(pairs, number, times_written[number])
        self._order.remove(common)
        self._order.insert(min(map(self._order.index, having)), common)

    def grouped(self, value: _Value) -> tuple[_Value, ...]:
        """Return the operands of a connection, with extracted operands combined."""
        parallel = isinstance(value.expr, Or)
        single = {(part.number, part.negated != parallel): part for part in value.parts}
        positions = {operand: position for position, operand in enumerate(single)}

        def position(operand: tuple[int, bool]) -> int:
            return positions[operand] if operand in single else min(map(position, self._operands[operand[0]]))

        def combined(operand: tuple[int, bool]) -> _Value:
            if operand in single:
                return single[operand]
            parts = tuple(map(combined, sorted(self._operands[operand[0]], key=position)))
            expr = (any_of if parallel else all_of)(*(part.expr for part in parts))
            return _Value(operand[0], parallel, expr, parts)

        return tuple(map(combined, sorted(self._operands[value.number], key=position)))

    def worth_a_relay(self) -> set[int]:
        """Return the numbers of the values for which a relay saves steps.

        All candidates are chosen first; those used once are removed, then the one that saves least, while it saves
        nothing. A removal makes other values longer or used more often, never the reverse, so that a saving that has
        been calculated before is a lower limit of the present one.
        """
        chosen = {number for number, operands in enumerate(self._operands) if operands or self._steps[number] > 1}
        size = _Size(self._operands, self._total_uses(chosen), self._inline_steps(chosen), chosen)
        for number in [n for n in chosen if size.uses[n] <= 1]:
            size.write_out(number)
        by_saving = [(size.saved(number), number) for number in chosen]
        heapify(by_saving)
        while by_saving:
            before, number = by_saving[0]
            saved = size.saved(number)
            if saved > before:
                heapreplace(by_saving, (saved, number))
            elif saved <= 0:
                heappop(by_saving)
                size.write_out(number)
            else:
                break
        return chosen

    def _total_uses(self, chosen: set[int]) -> list[int]:
        uses = self._uses.copy()
        for number in reversed(self._order):
            for operand, _ in self._operands[number]:
                uses[operand] += min(uses[number], 1) if number in chosen else uses[number]
        return uses

    def _inline_steps(self, chosen: set[int]) -> list[int]:
        """Return the number of steps of each value if the chosen values among its operands are read from relays."""
        steps = self._steps.copy()
        for number in self._order:
            operands = self._operands[number]
            steps[number] += sum(1 if n in chosen else steps[n] + bool(self._operands[n]) for n, _ in operands)
        return steps

    def _of(self, expr: Expr) -> _Value:
        match expr:
            case Not(operand):
                value = self._of(operand)
                return _Value(value.number, not value.negated, expr, (value,))
            case And(operands) | Or(operands):
                parallel = isinstance(expr, Or)
                parts = tuple(self._of(operand) for operand in operands)
                series = frozenset((part.number, part.negated != parallel) for part in parts)
                return _Value(self._number(series, 0, series), parallel, expr, parts)
            case Compare(relation, left, right):
                positive = _COMPLEMENTS.get(relation, relation)
                key = (positive, self._device(left), self._device(right) if isinstance(right, Word) else right)
                return _Value(self._number(key, _COMPARISON_STEPS), positive != relation, expr)
            case Bit():
                return _Value(self._number(self._device(expr), 1), False, expr)
            case Const():
                return _Value(self._number(expr, 1), False, expr)
        raise TypeError(f"not a condition: {expr!r}")

    def _number(self, key: object, steps: int, operands: frozenset[tuple[int, bool]] = frozenset()) -> int:
        if key not in self._numbers:
            self._numbers[key] = len(self._numbers)
            self._order.append(self._numbers[key])
            self._operands.append(operands)
            self._steps.append(steps)
            self._uses.append(0)
        return self._numbers[key]

    def _device(self, device: Bit | Word) -> object:
        """Return a key of a device; two reads have the same key if the device is not written between them."""
        name = (device.kind, device.number)
        return object() if name in self._changing else (*name, isinstance(device, Word), self._versions[name])


class _Writer:
    """Writer of the items of a program, in which the chosen values are replaced by relays."""

    def __init__(self, values: _Values) -> None:
        self._grouped = values.grouped
        self._chosen = values.worth_a_relay()
        self._free = iter(RELAYS)
        self._relays: dict[int, Expr] = {}
        self._pending: list[Rung] = []

    def items(self, rows: list[tuple[Rung | Steps, list[_Value]]]) -> Iterator[Rung | Steps]:
        """Yield the items; the rung of a relay directly precedes the first item that reads it."""
        for item, values in rows:
            conditions = [self._read(value) for value in values]
            yield from self._pending
            self._pending.clear()
            yield item.with_conditions(conditions) if isinstance(item, Steps) else replace(item, when=conditions[0])

    def _read(self, value: _Value) -> Expr:
        if isinstance(value.expr, Not):
            return ~self._read(value.parts[0])
        if value.number not in self._chosen:
            return self._written_out(value)
        if value.number not in self._relays:
            condition = self._written_out(value)
            name = shorten(f"auxiliary: {readable(value.expr)[1:-1]}", 80, placeholder=" ...")
            relay = Bit("M", next(self._free), name)
            self._pending.append(Out(relay, condition))
            self._relays[value.number] = ~relay if value.negated else relay
        relay_contact = self._relays[value.number]
        return ~relay_contact if value.negated else relay_contact

    def _written_out(self, value: _Value) -> Expr:
        match value.expr:
            case And():
                return all_of(*map(self._read, self._grouped(value)))
            case Or():
                return any_of(*map(self._read, self._grouped(value)))
        return value.expr


def item_writes(item: Rung | Steps) -> Iterator[Bit | Word]:
    """Yield every device that a rung or a sequence writes."""
    if not isinstance(item, Steps):
        yield from written_devices(item)
        return
    yield from (bit for bit, _ in item)
    yield from (step.dwell.timer.done for step in item.steps if step.dwell)
    if item.consumes is not None:
        yield item.consumes
