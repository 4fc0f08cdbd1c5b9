"""Executable parts of an instruction list: main program, subroutines, steps, loops."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from controller.fx.language.instruction import DeviceOperand, Instruction, Ladder, LadderError, Pointer
from controller.fx.language.instruction_set import steps

END_POINTER = 63
"""Label of END: CJ P63 jumps to END (docs/sources/fx2n.md 1.1, no page found)."""


@dataclass(frozen=True, slots=True)
class LadderStep:
    """Instructions between STL and the next STL or RET.

    Attributes:
        number: Index of the step in the list of previously active steps.
        states: States of the step; if there are several (a join), all of them must be on.
        body: Indexes of the instructions.
        heads: Indexes of the STL instructions.
    """

    number: int
    states: tuple[int, ...]
    body: tuple[int, ...]
    heads: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Loop:
    """Instructions between FOR and NEXT.

    Attributes:
        at: Index of the FOR instruction.
        body: Repeated parts.
    """

    at: int
    body: tuple[Part, ...]


Part = int | LadderStep | Loop
"""Part of a program: an instruction (its index), a step or a loop."""


@dataclass(frozen=True, slots=True)
class Parts:
    """Parts of a program.

    Attributes:
        main: Main program, excluding its END. An FEND followed by code that a jump can reach ends the scan.
        subroutines: Parts that a CALL executes, by label, excluding their SRET.
        step_count: Number of steps.
        interrupts: Bodies of the interrupt routines by number, excluding their IRET.
    """

    main: tuple[Part, ...]
    subroutines: dict[int, tuple[Part, ...]]
    step_count: int
    interrupts: dict[int, tuple[Part, ...]]

    @property
    def bodies(self) -> tuple[tuple[Part, ...], ...]:
        """Main program, subroutines and interrupt routines."""
        return (self.main, *self.subroutines.values(), *self.interrupts.values())


def parts_of(ladder: Ladder) -> Parts:
    """Return the parts of a program.

    Raises:
        LadderError: A label, loop or jump is at a position that this engine does not support; the message has one line
            for each fault.
    """
    return _PartReader(ladder).parts()


def number_of(instruction: Instruction) -> int:
    """Return the number of the first operand: a label, a state or a level."""
    operand = instruction.operands[0]
    return operand.number if isinstance(operand, Pointer | DeviceOperand) else int(getattr(operand, "number", 0))


def steps_of(instructions: tuple[Instruction, ...], body: tuple[Part, ...]) -> int:
    """Return the number of program steps of a body, including the instruction at its end."""
    total = 0
    for part in body:
        match part:
            case LadderStep(body=indexes):
                total += sum(steps(instructions[i]) for i in indexes)
            case Loop(_, inner):
                total += steps_of(instructions, inner)
            case _:
                total += steps(instructions[part])
    return total + 1


class _PartReader:
    def __init__(self, ladder: Ladder) -> None:
        self._ladder = ladder
        self._list = ladder.instructions
        self._steps = 0
        self._faults: list[str] = []

    def parts(self) -> Parts:
        after_main = next(i for i, x in enumerate(self._list) if x.name in ("FEND", "END"))
        labels = {number_of(x): i for i, x in enumerate(self._list) if x.name == "P"}
        jumps = (number_of(x) for x in self._list[:after_main] if x.name in ("CJ", "CJP"))
        code_after_main = any(labels.get(label, -1) > after_main for label in jumps)
        main, _ = self._body(0, len(self._list) - 1 if code_after_main else after_main)
        self._check_jumps(main, to_end=True)
        called = dict.fromkeys(number_of(x) for x in self._list if x.name in ("CALL", "CALLP"))
        subroutines: dict[int, tuple[Part, ...]] = {}
        for label in called:
            start = labels.get(label, -1)
            end = next((i for i in range(max(start, 0), len(self._list)) if self._list[i].name == "SRET"), None)
            if start < after_main or end is None:
                self._fault(max(start, 0), f"P{label} is called; put it after FEND, with SRET at its end")
                continue
            subroutines[label], _ = self._body(start, end)
            self._check_jumps(subroutines[label], to_end=False)
        interrupts = dict(self._interrupts())
        if self._faults:
            raise LadderError("\n".join(dict.fromkeys(self._faults)))
        return Parts(main, subroutines, self._steps, interrupts)

    def _interrupts(self) -> Iterator[tuple[int, tuple[Part, ...]]]:
        """Yield the number and the body of each interrupt routine."""
        for start, instruction in enumerate(self._list):
            if instruction.name != "I":
                continue
            end = next((i for i in range(start, len(self._list)) if self._list[i].name == "IRET"), None)
            if end is None:
                self._fault(start, "the interrupt routine has no end; write IRET at its end")
                continue
            body, _ = self._body(start + 1, end)
            self._check_jumps(body, to_end=False)
            yield number_of(instruction), body

    def _body(self, start: int, end: int) -> tuple[tuple[Part, ...], int]:
        """Return the parts from `start` up to `end` or to the closing NEXT, and the index at which they end."""
        parts: list[Part] = []
        i = start
        while i < end:
            name = self._list[i].name
            if name == "STL":
                step, i = self._step(i, end)
                parts.append(step)
            elif name == "FOR":
                body, close = self._body(i + 1, end)
                for inside in body:
                    if isinstance(inside, int) and self._list[inside].name == "SRET":
                        self._fault(inside, "not allowed between FOR and NEXT; put it after NEXT")
                parts.append(Loop(i, body))
                i = close + 1
            elif name == "NEXT":
                return tuple(parts), i
            else:
                if name not in ("NOP", "I"):  # a routine may have several labels
                    parts.append(i)
                i += 1
        return tuple(parts), i

    def _step(self, start: int, end: int) -> tuple[LadderStep, int]:
        i = start
        heads: list[int] = []
        while i < end and self._list[i].name in ("STL", "NOP"):
            if self._list[i].name == "STL":
                heads.append(i)
            i += 1
        body: list[int] = []
        while i < end and self._list[i].name not in ("STL", "RET", "NEXT"):
            if self._list[i].name in ("P", "I", "FOR", "MC", "MCR"):
                self._fault(i, "not allowed inside a step; put it outside STL and RET")
            if self._list[i].name != "NOP":
                body.append(i)
            i += 1
        self._steps += 1
        states = tuple(number_of(self._list[head]) for head in heads)
        return LadderStep(self._steps - 1, states, tuple(body), tuple(heads)), i

    def _check_jumps(self, body: tuple[Part, ...], *, to_end: bool) -> None:
        here = {number_of(self._list[i]) for i in body if isinstance(i, int) and self._list[i].name == "P"}
        for i in _instructions_outside_loops(body):
            instruction = self._list[i]
            if instruction.name not in ("CJ", "CJP"):
                continue
            target = number_of(instruction)
            if target not in here and not (target == END_POINTER and to_end):
                self._fault(i, f"jumps into or out of a loop or subroutine; put P{target} in the part with the jump")
        for part in body:
            if isinstance(part, Loop):
                self._check_jumps(part.body, to_end=to_end)

    def _fault(self, index: int, message: str) -> None:
        instruction = self._list[index]
        self._faults.append(f"{self._ladder.source}:{instruction.line}:1: {instruction}: {message}")


def _instructions_outside_loops(body: tuple[Part, ...]) -> Iterator[int]:
    """Yield the instructions of a body, including its steps but not its loops."""
    for part in body:
        if isinstance(part, int):
            yield part
        elif isinstance(part, LadderStep):
            yield from part.body
