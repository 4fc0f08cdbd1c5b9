"""Scenarios for random tests of the machine program, and the rig that runs them and checks every scan."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from random import Random
from typing import Any, Protocol

from controller.core.compile import expression
from controller.core.devices import Memory
from controller.core.expr import Bit
from controller.core.scan import Plc
from controller.core.specification import Specification
from controller.program.machine import Transplanter
from controller.program.requirements.proof import specification
from controller.program.states import Mode, State
from tests.controller.program.modes.stand_in import StandIn

FLIPPED = 0.15
"""Fraction of the scans in which a terminal changes its level if the switches do not follow the coils."""

Check = Callable[[Memory], str]


def compiled(specification: Specification) -> Check:
    """Return a check that returns the name of the first requirement or invariant violated by a memory, or ''."""
    kinds = ("X", "Y", "M", "S", "T", "C", "D", "TV", "CV")
    lines = [f"    if {expression(each.never)}: return {each.name!r}" for each in specification.requirements]
    lines += [f"    if not ({expression(each.holds)}): return {each.name!r}" for each in specification.invariants]
    text = "\n".join(["def check(m):", *(f"    {kind} = m.{kind}" for kind in kinds), *lines, "    return ''"])
    namespace: dict[str, Any] = {}
    exec(compile(text, "<specification>", "exec"), namespace)  # noqa: S102 - text generated from checked declarations
    check: Check = namespace["check"]
    return check


class Rig:
    """Rig that scans and checks the machine program with its monitors; it is reused for many runs.

    Attributes:
        checked: Number of scans that have been checked.
    """

    def __init__(self, machine: Transplanter) -> None:
        self.machine, self.tags = machine, machine.tags
        self.specification = specification(machine)
        self._situations: set[tuple[int, ...]] = set()
        self.checked = 0
        self._plc = Plc(self.specification.watched, input_filter_ms=0)
        self._new = copy.deepcopy(self._plc.memory)
        self._check = compiled(self.specification)
        self._steps = {bit.number: bit.name for sequence in machine.program.sequences() for bit, _ in sequence}

    @property
    def visited(self) -> set[State | Mode | str]:
        """States, modes and steps that were active after at least one scan of any run."""
        found: set[State | Mode | str] = set()
        for state, mode, *steps in self._situations:
            found |= {State(state), Mode(mode), *(name for number, name in self._steps.items() if steps[number])}
        return found

    def run(self, story: Story) -> None:
        """Power up a new machine and run a scenario.

        Raises:
            AssertionError: A requirement or an invariant is violated.
        """
        self._random, self._now_ms = Random(story.seed), 0
        self._stand_in = StandIn(self.machine.io_map) if story.follows else None
        self._levels = self.machine.io_map.safe_inputs()
        self._image = self.machine.io_map.safe_outputs()
        known = {bit.number: self._random.random() < 0.5 for bit in self.specification.remembered}
        self._switch_on({}, known)
        self.scan(10)
        for act in story.acts:
            act.on(self)

    @property
    def state(self) -> State:
        """PackML state after the last scan."""
        return State(self._plc.memory.D[self.tags.machine.state.number])

    def scan_until(self, ms: int, when: Callable[[], bool], *, at_most: int) -> None:
        """Run scans with a period of `ms` until a condition is true, but not more than `at_most` scans."""
        for _ in range(at_most):
            self.scan(ms)
            if when():
                return

    def read(self, device: Bit) -> int:
        """Read a device after a scan."""
        return self._plc.read(device)

    def write(self, values: Mapping[Any, int]) -> None:
        """Write devices before the next scan."""
        for device, value in values.items():
            self._plc.write(device, value)

    def press(self, name: str) -> None:
        """Issue a command for the next scan."""
        self._plc.press(self.tags.commands[name])

    def terminal(self, number: int, level: bool | None) -> None:
        """Force the sensed state of a terminal; None releases it."""
        if self._stand_in is None:
            self._levels[number] = bool(level)
        elif level is None:
            self._stand_in.stuck.pop(number, None)
        else:
            self._stand_in.stuck[number] = level

    def button(self, tag: str, *, pressed: bool) -> None:
        """Press or release a button."""
        point = self.machine.io_map[tag]
        if self._stand_in is None:
            self._levels[point.number] = point.level(pressed)
        elif pressed:
            self._stand_in.pressed.add(tag)
        else:
            self._stand_in.pressed.discard(tag)

    def repair(self) -> None:
        """Release all switches and buttons, and clear all runtime faults."""
        self.write(dict.fromkeys(self.tags.system.bits(), 0))
        if self._stand_in is not None:
            self._stand_in.stuck.clear()
            self._stand_in.pressed.clear()

    def supply(self, *, cups: bool = True, trays: bool = True) -> None:
        """Start or stop the tractor, and fill or empty the magazine."""
        if self._stand_in is not None:
            self._stand_in.cups_come, self._stand_in.trays_come = cups, trays

    def lose_power(self, *, memory_lost: bool) -> None:
        """Cycle the power; the monitors retain their memory."""
        known = {bit.number: self._plc.memory.M[bit.number] for bit in self.specification.remembered}
        retained = {} if memory_lost else self._plc.retained()
        self._switch_on(retained, known)
        self._plc.write(self.tags.system.memory_lost, memory_lost)
        self._now_ms += 1_000
        self.scan(10)

    def scan(self, ms: int, times: int = 1) -> None:
        """Run `times` scans with a period of `ms`, and check the memory after each scan."""
        memory, steps = self._plc.memory, 1 + max(self._steps)
        state, mode = self.tags.machine.state.number, self.tags.machine.mode.number
        for _ in range(times):
            self._now_ms += ms
            self._image = self._plc.scan(self._now_ms, self._inputs(ms))
            wrong = self._check(memory)
            assert not wrong, wrong
            self._situations.add((memory.D[state], memory.D[mode], *memory.S[:steps]))
        self.checked += times

    def _inputs(self, ms: int) -> list[bool]:
        if self._stand_in is not None:
            return self._stand_in.advance(ms, self._image)
        if self._random.random() < FLIPPED:
            number = self._random.randrange(len(self._levels))
            self._levels[number] = not self._levels[number]
        return self._levels

    def _switch_on(self, retained: Mapping[str, int], known: Mapping[int, bool]) -> None:
        for kind in fields(Memory):
            getattr(self._plc.memory, kind.name)[:] = getattr(self._new, kind.name)
        self._plc.scans = 0
        if retained:
            self._plc.restore_retained(retained)
        for number, on in known.items():
            self._plc.memory.M[number] = on


# actions


@dataclass(frozen=True)
class Wait:
    """Wait for a number of scans."""

    ms: int
    scans: int

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        rig.scan(self.ms, self.scans)


@dataclass(frozen=True)
class Press:
    """One or two commands in the same scan, followed by a wait."""

    commands: tuple[str, ...]
    then: Wait

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        for name in self.commands:
            rig.press(name)
        self.then.on(rig)


@dataclass(frozen=True)
class Renew:
    """Jog command renewed in every scan."""

    output: str
    scans: int

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        for _ in range(self.scans):
            rig.press(self.output)
            rig.scan(50)


@dataclass(frozen=True)
class Button:
    """Button held for a given time."""

    tag: str
    held: Wait

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        rig.button(self.tag, pressed=True)
        self.held.on(rig)
        rig.button(self.tag, pressed=False)
        rig.scan(10)


@dataclass(frozen=True)
class Terminal:
    """Terminal level that is forced during another action."""

    number: int
    level: bool
    then: Act

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        rig.terminal(self.number, self.level)
        self.then.on(rig)
        rig.terminal(self.number, None)


@dataclass(frozen=True)
class SystemBit:
    """Runtime fault that is present for a given time."""

    index: int
    then: Wait

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        bit = rig.tags.system.bits()[self.index]
        rig.write({bit: 1})
        self.then.on(rig)
        rig.write({bit: 0})


@dataclass(frozen=True)
class SetPoint:
    """Change of a set-point to any value that the runtime accepts."""

    name: str
    value: int

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        rig.write({getattr(rig.tags.sp, self.name): self.value})


@dataclass(frozen=True)
class PowerLoss:
    """Loss and return of power, optionally with loss of the retentive memory."""

    memory_lost: bool

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        rig.lose_power(memory_lost=self.memory_lost)


@dataclass(frozen=True)
class Shortage:
    """Lack of cups or trays during another action."""

    cups: bool
    meanwhile: Act

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        rig.supply(cups=not self.cups, trays=self.cups)
        self.meanwhile.on(rig)
        rig.supply()


@dataclass(frozen=True)
class ToAndFro:
    """Two commands with a wait in between; the second cancels the first."""

    orders: tuple[str, str]
    between: Wait
    then: Wait

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        for name, wait in zip(self.orders, (self.between, self.then), strict=True):
            rig.press(name)
            wait.on(rig)


@dataclass(frozen=True)
class GoOn:
    """Operator actions that resume operation in a given mode: repair, stop, clear, answer, home and start."""

    mode: Mode
    answers: tuple[str, ...]
    work: Wait
    stop: str = "stop"

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        rig.repair()
        orders = ((self.stop,), ("clear",), (f"mode_{self.mode.name.lower()}", *self.answers), ("reset",))
        for commands in orders:
            for name in commands:
                rig.press(name)
            rig.scan(10, 3)
        rig.scan_until(50, lambda: rig.state is not State.RESETTING, at_most=300)
        rig.press("start")
        rig.scan(10, 2)
        self.work.on(rig)


@dataclass(frozen=True)
class StepOn:
    """Repeated step commands for one sequence."""

    sequence: int
    presses: int

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        rig.write({rig.tags.sp.step_sequence: self.sequence})
        for _ in range(self.presses):
            rig.press("step")
            rig.scan(50, 16)


@dataclass(frozen=True)
class Await:
    """Wait until a step is on, with a timeout."""

    step: Bit
    scans: int

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        rig.scan_until(50, lambda: bool(rig.read(self.step)), at_most=self.scans)


@dataclass(frozen=True)
class InTurn:
    """Actions performed one after another."""

    acts: tuple[Act, ...]

    def on(self, rig: Rig) -> None:
        """Perform the action on a rig."""
        for act in self.acts:
            act.on(rig)


class Act(Protocol):
    """Action of a scenario."""

    def on(self, rig: Rig, /) -> None:
        """Perform the action on a rig."""


@dataclass(frozen=True)
class Story:
    """Complete scenario for a new machine.

    Attributes:
        follows: True if the switches follow the coils; otherwise they are random.
        seed: Seed of the initial monitor states and of the random terminals.
        acts: Actions in order.
    """

    follows: bool
    seed: int
    acts: list[Act] = field(default_factory=list)
