"""Commands of the debugger and their answers in plain text."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.debug.comparison import (
    ValueDifference,
    branch,
    differences_at,
    first_difference,
    outcomes,
    parse_change,
)
from controller.debug.condition import Condition, SignalContact, parse_condition
from controller.debug.machine import DebugSignal, RunPosition, Value
from controller.debug.search import Find, condition_changes, device_changes, first_met, following, last
from controller.debug.stepping import RUNG, Stepper, StepUnit, last_of
from controller.debug.timeline import RunTimeline
from controller.debug.why.proof import answer, device_asked
from controller.program.texts.operator import Language

_MOST_ROWS: Final = 40
"""Longest table of differences, lines."""


@dataclass(frozen=True, slots=True)
class _Command:
    """Command.

    Attributes:
        usage: Command with its arguments.
        meaning: Description for the user.
    """

    usage: str
    meaning: str


class Debugger:
    """Recorded run, its present position, and the latest branch.

    Attributes:
        recorded: Recorded run.
        branched: Latest branch; None = none.
        line: The run that is shown: the recorded one or the branch.
        position: Present position.
    """

    def __init__(self, recorded: RunTimeline) -> None:
        """Begin at the end of a recorded run."""
        self.recorded = self.line = recorded
        self.branched: RunTimeline | None = None
        self.position = RunPosition(recorded.last)
        self._found: tuple[str, int] | None = None
        """Latest search and the scan that it has found."""

    @property
    def scan(self) -> int:
        """Number of scans that have been executed at the present position."""
        return self.position.scan

    @property
    def names(self) -> Collection[str]:
        """Names of the commands."""
        return _COMMANDS.keys()

    @cached_property
    def stepper(self) -> Stepper:
        """Steps within the scans; the program is translated when they are first used."""
        return Stepper(self.recorded.machine.observer)

    def execute(self, text: str) -> Iterator[str]:
        """Execute one command and yield the lines of its answer; an empty line and a comment (#) have none.

        Raises:
            InputError: The command is invalid.
        """
        name, _, rest = text.partition("#")[0].strip().partition(" ")
        if not name:
            return
        if name not in _COMMANDS:
            raise InputError(f"{name}: no such command; {suggestion(name, _COMMANDS)}")
        answer: Callable[[str], Iterator[str]] = getattr(self, f"_{name}")
        yield from answer(rest.strip())

    def _goto(self, text: str) -> Iterator[str]:
        yield self._move(_number(text, "goto SCAN"))

    def _back(self, text: str) -> Iterator[str]:
        yield from self._step(text, "back", -1)

    def _forward(self, text: str) -> Iterator[str]:
        yield from self._step(text, "forward", 1)

    def _step(self, text: str, name: str, direction: int) -> Iterator[str]:
        words = text.split()
        count = _number(words[0], f"{name} N scan") if words else 1
        unit = words[1].rstrip("s") if len(words) > 1 else "scan"
        if len(words) > 2 or unit not in {*StepUnit, "step"}:
            raise InputError(f"{name} {text}: write {name} N scan, step, rung or instruction")
        if unit == "scan":
            yield self._move(max(self.line.first, min(self.line.last, self.scan + direction * count)))
        elif unit == "step":
            yield self._step_of_sequence(text, name, count, direction)
        else:
            yield from self._step_within(StepUnit(unit), count, direction)

    def _step_within(self, unit: StepUnit, count: int, direction: int) -> Iterator[str]:
        step = self.stepper.back if direction < 0 else self.stepper.forward
        position = self.position
        for _ in range(count):
            following = step(self.line, position, unit)
            if following == position:
                break
            position = following
        yield from self._enter(position)

    def _enter(self, position: RunPosition) -> Iterator[str]:
        """Go to a position, which may be within a scan, and show its rung."""
        yield self.go(position)
        for instruction, state in self.stepper.states(self.line, position):
            yield f"  {instruction:32} {state}"

    def _step_of_sequence(self, text: str, name: str, count: int, direction: int) -> str:
        steps = self.line.machine.steps()
        if not steps:
            raise InputError(f"{name} {text}: the program has no steps")
        find, scan = device_changes(self.line, steps), self.scan
        for _ in range(count):
            found = self._search(find, scan, direction)
            if found is None:
                return f"no further change of a step; {self._move(scan)}"
            scan = found
        at = self._move(scan)
        active = [f"{signal.name} {signal.tag}".strip() for signal in steps if signal.read()]
        return f"{at}; steps: {', '.join(active) or 'none'}"

    def _search(self, find: Find, scan: int, direction: int) -> int | None:
        if direction < 0:
            return last(self.line, find, scan)
        return following(self.line, find, scan)

    def _last(self, text: str) -> Iterator[str]:
        find, condition = self._sought(text, "last")
        # a repeated search goes on before the scan that it has found
        before = self.scan if self._found == (text, self.scan) else self.scan + 1
        yield self._report(text, condition, last(self.line, find, before), f"since scan {self.line.first}")

    def _next(self, text: str) -> Iterator[str]:
        find, condition = self._sought(text, "next")
        found = following(self.line, find, self.scan)
        yield self._report(text, condition, found, f"up to scan {self.line.last}")

    def _sought(self, text: str, name: str) -> tuple[Find, Condition]:
        condition = parse_condition(text, self.line.machine.signal) if text else None
        if condition is None:
            raise InputError(f"{name}: write a device or a condition, for example {name} M135")
        if isinstance(condition, SignalContact):
            return device_changes(self.line, [condition.signal]), condition
        self.line.machine.check(condition)
        return condition_changes(self.line, condition), condition

    def _report(self, text: str, condition: Condition, found: int | None, span: str) -> str:
        if found is None:
            return f"{text}: no change {span}"
        read = condition.signal.read if isinstance(condition, SignalContact) else condition.holds
        self.line.seek(found - 1)
        before = read()
        at = self._move(found)
        self._found = (text, found)
        return f"{text}: {shown(before)} -> {shown(read())} in {at}"

    def _until(self, text: str) -> Iterator[str]:
        if (rung := RUNG.fullmatch(text)) is not None:
            found_at = last_of(self.stepper.to_rung(self.line, self.position, int(rung[1])))
            if found_at is None:
                yield f"{text}: not executed up to scan {self.line.last}"
            else:
                yield from self._enter(found_at)
            return
        condition = parse_condition(text, self.line.machine.signal)
        self.line.machine.check(condition)
        found = first_met(self.line, condition, self.scan)
        yield f"{text}: not met up to scan {self.line.last}" if found is None else f"{text}: {self._move(found)}"

    def _show(self, text: str) -> Iterator[str]:
        self.line.seek(self.scan)
        machine = self.line.machine
        if not text:
            yield self._position()
            for name, value in machine.outcome().items():
                yield f"{name}: {shown(value)}"
            return
        for word in _words(text):
            condition: Condition | None = None
            try:
                signal = machine.signal(word)
            except InputError:
                if not set(word) & set(" <>=&|~!()"):
                    raise
                condition = parse_condition(word, machine.signal)
            yield f"{word}: {condition.holds()}" if condition is not None else _shown_signal(signal)

    def _why(self, text: str) -> Iterator[str]:
        name = text.removeprefix("not ").strip()
        language: Language = "en"
        if name.endswith(" zh"):
            name, language = name[:-3].strip(), "zh"
        if not name or " " in name:
            raise InputError(f"why {text}: write a device or tag, for example why Y2, or why not Y2")
        if name.isdecimal():
            name = f"S{name}"  # the number of an alarm
        key, scan = device_asked(name, self.line.machine.signal(name).name), self.scan
        self.line.seek(scan)
        if text.startswith("not ") and self.line.machine.signal(name).read():
            yield f"{name} is on in scan {scan}; go back to a scan in which it is off, or ask why {name}"
            return
        for line in answer(self.line, self.line.machine.explained, key, scan).lines():
            yield line.shown(language)

    def _events(self, text: str) -> Iterator[str]:
        _nothing(text, "events")
        for scan, told in self.line.told_entries():
            yield f"scan {scan}: {told}"
        self.line.seek(self.line.last)
        for event in self.line.machine.events():
            yield f"{event.at_ms / 1000:.2f} s: {event.text.en}"

    def _branch(self, text: str) -> Iterator[str]:
        change = parse_change(text)
        self.branched = branch(self.recorded, change)
        yield f"branch {change}: ran to scan {self.branched.last}"
        yield from self._diff("")

    def _diff(self, text: str) -> Iterator[str]:
        branched = self._branch_run("diff")
        if text:
            scan = _number(text, "diff SCAN")
            yield from _table(f"after scan {scan}", differences_at(self.recorded, branched, scan))
            return
        for kinds, name in (("", "difference"), ("Y", "different output")):
            first = first_difference(self.recorded, branched, kinds)
            if first is None:
                yield f"no {name}"
                break
            yield from _table(f"first {name} in scan {first.scan}", first.devices, most=8)
        yield "end: recorded | branch"
        for row in outcomes(self.recorded, branched):
            mark = "" if row.recorded == row.branched else "  <- differs"
            yield f"  {row.name}: {shown(row.recorded)} | {shown(row.branched)}{mark}"

    def _use(self, text: str) -> Iterator[str]:
        if text not in {"recorded", "branch"}:
            raise InputError(f"use {text}: write use recorded, or use branch")
        self.line = self.recorded if text == "recorded" else self._branch_run("use branch")
        yield f"{text}: {self._move(max(self.line.first, min(self.scan, self.line.last)))}"

    def _help(self, text: str) -> Iterator[str]:
        _nothing(text, "help")
        for command in _COMMANDS.values():
            yield f"{command.usage:32} {command.meaning}"

    def _branch_run(self, command: str) -> RunTimeline:
        if self.branched is None:
            raise InputError(f"{command}: there is no branch; write for example branch X1=on@4101..4110")
        return self.branched

    def _move(self, scan: int) -> str:
        return self.go(RunPosition(scan))

    def go(self, position: RunPosition) -> str:
        """Go to a position of the run that is shown; return its description.

        Raises:
            InputError: The scan is not recorded.
        """
        self.line.seek(position.scan)
        self.position, self._found = position, None
        return self._position()

    def _position(self) -> str:
        scan, at = self.position
        text = f"scan {scan}, {self.line.machine.now_ms / 1000:.2f} s"
        return text if at is None else f"{text}; scan {scan + 1} before {self.stepper.place(at)}"


def _number(text: str, usage: str) -> int:
    if not text.isdecimal() or len(text) > 9:
        raise InputError(f"{text or 'no number'}: write {usage} with a whole number")
    return int(text)


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError:
        raise InputError(f"show {text}: a closing quotation mark is missing") from None


def _nothing(text: str, name: str) -> None:
    if text:
        raise InputError(f"{name} {text}: takes no argument; write {name}")


def shown(value: Value | None) -> str:
    """Return a value as text."""
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value) or "none"


def _shown_signal(signal: DebugSignal) -> str:
    unit = f" {signal.unit}" if signal.unit not in {"", "-"} else ""
    tag = f"  {signal.tag}" if signal.tag else ""
    return f"{signal.name}: {shown(signal.read())}{unit}{tag}"


def _table(
    title: str, rows: list[ValueDifference] | tuple[ValueDifference, ...], most: int = _MOST_ROWS
) -> Iterator[str]:
    yield f"{title}: recorded | branch"
    for row in rows[:most]:
        yield f"  {row.name}: {shown(row.recorded)} | {shown(row.branched)}"
    if len(rows) > most:
        yield f"  and {len(rows) - most} more"
    if not rows:
        yield "  nothing differs"


_COMMANDS: Final = {
    command.usage.partition(" ")[0]: command
    for command in (
        _Command("goto SCAN", "return to a scan, or go on to it"),
        _Command("back N scan|step|rung", "go back by scans, changes of the steps, or rungs"),
        _Command("forward N scan|step|rung", "go on by scans, changes of the steps, or rungs"),
        _Command("last DEVICE|CONDITION", "go back to its last change"),
        _Command("next DEVICE|CONDITION", "go on to its next change"),
        _Command("until CONDITION|rung N", "go on to the first later scan that meets it, or to a rung"),
        _Command('show NAME|"CONDITION" ...', "print devices, tags, values of the plant, conditions"),
        _Command("why [not] DEVICE|ALARM [zh]", "explain why it is on or off, or why an active step has not left"),
        _Command("events", "list what entered the run, and the events of the program"),
        _Command("branch NAME=VALUE@SCAN..SCAN", "run on from a scan with a change"),
        _Command("diff [SCAN]", "compare the branch with the recorded run"),
        _Command("use recorded|branch", "look at the recorded run or at the branch"),
        _Command("help", "list the commands"),
    )
}
"""Commands by name."""
