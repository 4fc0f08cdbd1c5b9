"""Instructions of a program that are executed by Python functions: applied instructions, loop counts, comparisons."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from controller.core.expr import COMPARISONS
from controller.fx.engine.access import reader
from controller.fx.engine.applied.table import ACTIONS, LEVELS
from controller.fx.engine.code import STEPS_LEFT
from controller.fx.engine.cpu import Cpu, OperationError, watchdog_error
from controller.fx.engine.execution import Functions
from controller.fx.language.instruction import Instruction, Ladder
from controller.fx.language.instruction_set import FORMS, JOINS, RELATIONS, step_numbers

STEPS_A_MS: Final = 12_500
"""Execution rate of the FX2N in basic steps per ms, for the watchdog: 0.08 us per step (fx2n.md 1.3, no page found)."""
LONGEST_SCAN_MS: Final = 2_000
"""Time limit of every scan, ms, even if the program uses WDT."""
WATCHDOG_MS: Final = 8000


class Watchdog:
    """Watchdog of the scan; the program subtracts its steps from the remaining time."""

    def __init__(self, cpu: Cpu, registers: list[int]) -> None:
        self._data = cpu.memory.D
        self._registers = registers
        self._used_steps = 0

    def start(self) -> None:
        """Begin a scan."""
        self._used_steps = 0
        self._registers[STEPS_LEFT] = self._data[WATCHDOG_MS] * STEPS_A_MS

    def restart(self) -> None:
        """WDT: restart the watchdog; `LONGEST_SCAN_MS` still applies, so a WDT cannot keep an endless loop running."""
        limit = self._data[WATCHDOG_MS] * STEPS_A_MS
        self._used_steps += limit - self._registers[STEPS_LEFT]
        if self._used_steps > LONGEST_SCAN_MS * STEPS_A_MS:
            raise watchdog_error()
        self._registers[STEPS_LEFT] = limit


class Operations:
    """Factory of the functions for the instructions of one program."""

    def __init__(self, ladder: Ladder, cpu: Cpu, watchdog: Watchdog) -> None:
        self._list = ladder.instructions
        self._cpu = cpu
        self._watchdog = watchdog
        self._places = step_numbers(ladder.instructions)

    def functions(self, indexes: tuple[int, ...]) -> Functions:
        """Return new functions for the instructions at these indexes, without state of earlier scans."""
        return {i: self._function(self._list[i], self._places[i]) for i in indexes}

    def _function(self, instruction: Instruction, at: int) -> Callable[..., int | None]:
        name = FORMS[instruction.name].kind.name
        if name == "WDT":
            return self._watchdog.restart
        if name == "FOR":
            return self._repeats(instruction, at)
        if name[-1] in "=<>":
            return self._comparison(instruction, at)
        return self._level(instruction, at) if name in LEVELS else self._action(instruction, at)

    def _action(self, instruction: Instruction, at: int) -> Callable[[], None]:
        """Return the operation of an applied instruction; it sets M8067 if the operands are currently invalid."""
        form = FORMS[instruction.name]
        action = ACTIONS[form.kind.name](self._cpu, instruction.operands, form.wide)

        def execute() -> None:
            try:
                action()
            except OperationError as error:
                self._report(error, at)

        return execute

    def _level(self, instruction: Instruction, at: int) -> Callable[[bool], bool]:
        """Return the operation of an instruction with a drive state; the result is true if it must be executed again.

        Without drive, an instruction that has ended without an error has no effect until it is driven again.
        """
        form = FORMS[instruction.name]
        level = LEVELS[form.kind.name](self._cpu, instruction.operands, form.wide)

        def execute(power: bool) -> bool:
            try:
                level(power)
            except OperationError as error:
                self._report(error, at)
                return True
            return power

        return execute

    def _repeats(self, instruction: Instruction, at: int) -> Callable[[], int]:
        """Return a function that reads the loop count: 1 if the operand is below 1 or out of range (no page found)."""
        count = reader(self._cpu, instruction.operands[0], wide=False)

        def times() -> int:
            try:
                return max(1, count())
            except OperationError as error:
                self._report(error, at)
                return 1

        return times

    def _comparison(self, instruction: Instruction, at: int) -> Callable[[], bool]:
        form = FORMS[instruction.name]
        left, right = (reader(self._cpu, operand, form.wide) for operand in instruction.operands)
        join = next(join for join in JOINS if form.kind.name.startswith(join))
        compare = COMPARISONS[RELATIONS[form.kind.name.removeprefix(join)]]

        def compare_operands() -> bool:
            try:
                return compare(left(), right())
            except OperationError as error:
                self._report(error, at)
                return False

        return compare_operands

    def _report(self, error: OperationError, at: int) -> None:
        memory = self._cpu.memory
        memory.M[8067], memory.D[8067], memory.D[8069] = True, error.code, at
        memory.M[8004], memory.D[8004] = True, 8067
