"""Breakpoints as a client sets them: lines, names of functions, and changes of data."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from controller.common.errors import InputError
from controller.debug.adapter.arguments import Arguments
from controller.debug.adapter.breakpoints import Breakpoint, ChangeBreakpoint, InstructionBreakpoint
from controller.debug.adapter.listed_program import ListedProgram
from controller.debug.commands import Debugger
from controller.debug.condition import Condition, SignalContact, parse_condition
from controller.debug.search import condition_begins, device_changes
from controller.debug.stepping import RUNG

Verdict = dict[str, Any]


class BreakpointTable:
    """Breakpoints of one client; each list replaces the one before it.

    Attributes:
        line_offset: Difference of the lines of the program, from 1, to those of the client.
    """

    def __init__(self, debugger: Debugger, program: ListedProgram) -> None:
        """Begin without breakpoints."""
        self.line_offset = 0
        self._debugger, self._program = debugger, program
        self._lists: dict[str, list[Arguments]] = {}
        self._numbers: dict[str, list[int]] = {}
        self._last = 0

    def breakpoints(self) -> Iterator[Breakpoint]:
        """Yield the valid breakpoints, for the run that is shown."""
        for kind, make in (("lines", self._line), ("functions", self._function), ("data", self._data)):
            for each, number in zip(self._lists.get(kind, ()), self._numbers.get(kind, ()), strict=True):
                try:
                    yield make(each, number)
                except InputError:
                    continue  # the client has been told when it set the breakpoint

    def set_lines(self, arguments: Arguments) -> list[Verdict]:
        """Set the breakpoints of the program."""
        items = arguments.items("breakpoints")
        for each in items:
            each.integer("line")
        if not self._program.is_source(arguments.inner("source")):
            text = f"not the program of the recorded run, {self._program.source['name']}"
            return [{"verified": False, "message": text} for _ in items]
        return self._set("lines", items, self._line)

    def set_functions(self, arguments: Arguments) -> list[Verdict]:
        """Set breakpoints on rungs, changes of devices, and conditions that begin to be met."""
        return self._set("functions", arguments.items("breakpoints"), self._function)

    def set_data(self, arguments: Arguments) -> list[Verdict]:
        """Set breakpoints on changes of devices."""
        return self._set("data", arguments.items("breakpoints"), self._data)

    def data_info(self, arguments: Arguments) -> dict[str, Any]:
        """Return how to set a breakpoint on a variable."""
        name = arguments.text("name").partition(" ")[0]
        try:
            signal = self._debugger.line.machine.signal(name)
            if signal.unit:
                raise InputError(f"{name}: changes in nearly every scan; set a function breakpoint such as {name} < 1")
        except InputError as error:
            return {"dataId": None, "description": str(error)}
        return {"dataId": signal.name, "description": f"changes of {signal.name}", "accessTypes": ["write"]}

    def _set(self, kind: str, items: list[Arguments], make: Callable[[Arguments, int], Breakpoint]) -> list[Verdict]:
        verdicts: list[Verdict] = []
        numbers: list[int] = []
        for each in items:
            self._last += 1
            numbers.append(self._last)
            try:
                made = make(each, self._last)
            except InputError as error:
                verdicts.append({"id": self._last, "verified": False, "message": str(error)})
                continue
            place: Verdict = {}
            if isinstance(made, InstructionBreakpoint):
                line = self._program.line(made.instruction) - self.line_offset
                place = {"line": line, "source": self._program.source}
            verdicts.append({"id": self._last, "verified": True, **place})
        self._lists[kind], self._numbers[kind] = items, numbers
        return verdicts

    def _line(self, item: Arguments, number: int) -> InstructionBreakpoint:
        at = self._program.instruction(item.integer("line") + self.line_offset)
        return InstructionBreakpoint(number, at, self._condition(item))

    def _function(self, item: Arguments, number: int) -> Breakpoint:
        name = item.text("name").strip()
        rung = RUNG.fullmatch(name)
        if rung is not None:
            first, _ = self._debugger.stepper.instructions(int(rung[1]))
            return InstructionBreakpoint(number, first, self._condition(item))
        return self._change(name, item, number, "function breakpoint")

    def _data(self, item: Arguments, number: int) -> Breakpoint:
        return self._change(item.text("dataId"), item, number, "data breakpoint")

    def _change(self, text: str, item: Arguments, number: int, reason: str) -> ChangeBreakpoint:
        line = self._debugger.line
        condition = parse_condition(text, line.machine.signal)
        if isinstance(condition, SignalContact) and not condition.signal.unit:
            find = device_changes(line, [condition.signal])
        else:
            line.machine.check(condition)
            find = condition_begins(line, condition)
        return ChangeBreakpoint(number, find, self._condition(item), reason)

    def _condition(self, item: Arguments) -> Condition | None:
        for key in ("hitCondition", "logMessage"):
            if item.text(key, ""):
                raise InputError(f"{key}: not supported; write a condition, such as CN5 >= 3")
        text = item.text("condition", "").strip()
        return parse_condition(text, self._debugger.line.machine.signal) if text else None
