"""Estimated scan time of an FX2N from the execution times of its instructions (fx2n.md 1.3).

The table of times states for each entry how far it can be trusted. No entry has been compared with a manual, so the
estimate only shows the order of magnitude: `TRUST` is the factor by which a real FX2N may differ (assumed).
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final

from controller.core.devices import Memory
from controller.fx.language.instruction import Constant, DeviceOperand, Instruction, Ladder, Operand
from controller.fx.language.instruction_set import FORMS, JOINS, RELATIONS

TRUST: Final = 2.0
"""Factor by which the scan time of a real FX2N may be longer or shorter than the estimate (assumed)."""
_COMPARISONS: Final = {
    f"{join}{wide}{relation}": (relation, bool(wide)) for join in JOINS for wide in ("", "D") for relation in RELATIONS
}
_RELATION: Final = {
    "=": lambda a, b: a == b,
    "<>": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
}


@dataclass(frozen=True, slots=True)
class ExecutionTime:
    """Execution time of an instruction.

    Attributes:
        driven_us: Time if its condition is true, µs.
        not_driven_us: Time if its condition is false, µs.
        mark: Trust in the numbers, as in docs/sources/fx2n.md.
    """

    driven_us: float
    not_driven_us: float
    mark: str


@dataclass(frozen=True, slots=True)
class ScanTimeBounds:
    """Shortest and longest estimated scan time of a program, ms.

    Attributes:
        shortest_ms: No step is active and no instruction is driven.
        longest_ms: All steps are active and every instruction takes its longer time; loops are counted once.
    """

    shortest_ms: float
    longest_ms: float

    def __str__(self) -> str:
        return (
            f"estimated scan time of an FX2N: {self.shortest_ms:.1f} ms with no step active and nothing driven, "
            f"{self.longest_ms:.1f} ms with everything driven; a real FX2N may differ by a factor of {TRUST:g} "
            "(instruction times are general knowledge)"
        )


@cache
def execution_times() -> dict[tuple[str, str], ExecutionTime]:
    """Return the table of execution times, by instruction and kind of device; "" = any device."""
    text = files("controller.fx.timing").joinpath("fx2n_times.csv").read_text(encoding="utf-8")
    return {
        (row["instruction"], row["device"]): ExecutionTime(
            float(row["driven_us"]), float(row["not_driven_us"]), row["mark"]
        )
        for row in csv.DictReader(text.splitlines())
    }


@cache
def execution_time(instruction: Instruction) -> ExecutionTime:
    """Return the execution time of an instruction; an applied instruction that is not in the table has a default."""
    times = execution_times()
    name = instruction.name
    if name in _COMPARISONS:
        return times["contact comparison of 32 bits" if _COMPARISONS[name][1] else "contact comparison", ""]
    first = instruction.operands[0] if instruction.operands else None
    device = first.kind if isinstance(first, DeviceOperand) else ""
    form = FORMS.get(name)
    short = name if form is None else form.kind.name
    for key in ((name, device), (name, ""), (short, "")):
        if key in times:
            return times[key]
    return times["applied", ""]


def scan_time_bounds(ladder: Ladder) -> ScanTimeBounds:
    """Return the shortest and the longest estimated scan time of a program."""
    shortest = longest = 0.0
    in_step = False
    for instruction in ladder.instructions:
        time = execution_time(instruction)
        longest += max(time.driven_us, time.not_driven_us)
        if instruction.name in ("STL", "RET"):
            in_step = instruction.name == "STL"
            shortest += time.not_driven_us
        elif not in_step:
            shortest += time.not_driven_us
    return ScanTimeBounds(shortest / 1_000, longest / 1_000)


def executed_ms(ladder: Ladder, memory: Memory) -> float:
    """Return the estimated duration of a scan that leaves the devices as they are in a memory, ms.

    The contacts of inactive steps are not executed. Conditions are evaluated with the values after the scan, edges and
    indexed or grouped words count as false, and jumps as not taken.
    """
    return sum(_executed_us(ladder, memory)) / 1_000


def _executed_us(ladder: Ladder, memory: Memory) -> Iterator[float]:
    logic = _Logic(memory)
    active = True
    for instruction in ladder.instructions:
        if instruction.name == "STL":
            (state,) = instruction.operands
            active = isinstance(state, DeviceOperand) and memory.S[state.number]
            logic.reset()
        elif instruction.name == "RET":
            active = True
            logic.reset()
        elif not active:
            continue
        driven = logic.process(instruction)
        time = execution_time(instruction)
        yield time.driven_us if driven else time.not_driven_us


class _Logic:
    """Accumulator, block stack and branch stack of an FX2N, with the contacts of a memory."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._blocks: list[bool] = []
        self._branches: list[bool] = []
        self._output = False

    def reset(self) -> None:
        """Begin at the left rail."""
        self._blocks.clear()
        self._branches.clear()
        self._output = False

    def process(self, instruction: Instruction) -> bool:
        """Execute an instruction and return whether its condition is true; contacts return their result."""
        name = instruction.name
        blocks = self._blocks
        join, value = self._contact(instruction)
        if join == "LD":
            if self._output and not self._branches:
                blocks.clear()
            blocks.append(value)
        elif join and blocks:
            blocks[-1] = (blocks[-1] and value) if join == "AND" else (blocks[-1] or value)
        elif name in ("ANB", "ORB") and len(blocks) > 1:
            last = blocks.pop()
            blocks[-1] = (blocks[-1] and last) if name == "ANB" else (blocks[-1] or last)
        elif name == "INV" and blocks:
            blocks[-1] = not blocks[-1]
        elif name == "MPS":
            self._branches.append(bool(blocks) and blocks[-1])
        elif name in ("MRD", "MPP") and self._branches:
            blocks[:] = [self._branches[-1] if name == "MRD" else self._branches.pop()]
        self._output = not (join or name in ("ANB", "ORB", "INV", "MPS", "MRD", "MPP"))
        return blocks[-1] if blocks else True

    def _contact(self, instruction: Instruction) -> tuple[str, bool]:
        """Return how a contact joins the preceding ones, and its value; "" = not a contact."""
        name = instruction.name
        if name in _COMPARISONS:
            relation, wide = _COMPARISONS[name]
            left, right = (self._word(operand, wide=wide) for operand in instruction.operands)
            join = next(join for join in JOINS if name.startswith(join))
            return join, left is not None and right is not None and _RELATION[relation](left, right)
        plain = {"LDI": "LD", "ANI": "AND", "ORI": "OR"}.get(name, name)
        if plain not in JOINS:
            edge = name[:-1] if name[-1:] in ("P", "F") and name[:-1] in JOINS else ""
            return edge, False
        (operand,) = instruction.operands
        on = isinstance(operand, DeviceOperand) and bool(self._memory.bits(operand.kind)[operand.number])
        return plain, on != (plain != name)

    def _word(self, operand: Operand, *, wide: bool) -> int | None:
        match operand:
            case Constant(value):
                return value
            case DeviceOperand("D" | "T" | "C" as kind, number, ""):
                low = self._memory.word(kind, number)
                return low if not wide or kind != "D" else low % 65_536 + 65_536 * self._memory.word(kind, number + 1)
        return None
