"""Translation of output instructions: coils, transfers and applied instructions, with and without power."""

from __future__ import annotations

from typing import Final

from controller.core.devices import ANNUNCIATORS, WORD_MAX
from controller.fx.engine.applied.table import LEVELS
from controller.fx.engine.code import (
    DEPTH,
    GATES,
    TRANSFERRED,
    Arithmetic,
    Branch,
    Comparison,
    Condition,
    Conjunction,
    Disjunction,
    Inverse,
    Jump,
    Leave,
    Let,
    RowElement,
    RunSubroutine,
    Spend,
    Statement,
    StopTooDeep,
    Store,
    any_of,
)
from controller.fx.engine.coils import (
    NOW,
    annunciator,
    contact,
    counter,
    drive,
    driven_off,
    set_to,
    timer,
    timer_off,
)
from controller.fx.engine.conditions import Numbering, edge_pulse
from controller.fx.engine.cpu import CALL_DEPTH
from controller.fx.engine.parts import END_POINTER, LadderStep, Parts, number_of, steps_of
from controller.fx.engine.plain_actions import plain_action
from controller.fx.language.instruction import Constant, DeviceOperand, Instruction, Operand
from controller.fx.language.instruction_set import FORMS, Form, steps
from controller.fx.language.operand_rules import FIRST_HIGH_SPEED

TRANSFER_DISABLE: Final = 8040
MOST_DRIVERS: Final = 8
"""Number of steps that drive the same coil above which they share the condition that one of them is active."""
_EVERY_SCAN: Final = ("ANS", "STMR")
"""Instructions executed in every scan: without drive, their timer can still run or be started by another coil."""


class Outputs:
    """Translator of output instructions."""

    def __init__(self, instructions: tuple[Instruction, ...], parts: Parts, numbering: Numbering) -> None:
        self._list = instructions
        self._parts = parts
        self._numbering = numbering
        self._drivers = _drivers(instructions, parts)

    def with_power(self, i: int, power: Condition, step: LadderStep | None) -> tuple[Statement, ...]:
        """Return the statements for an output instruction, outside steps or in an active step."""
        instruction = self._list[i]
        name, operands, form = instruction.name, instruction.operands, FORMS.get(instruction.name)
        match name:
            case "OUT":
                return self._out(operands, power, step)
            case "SET" | "RST":
                if name == "SET" and step is not None and _is_step(operands[0]):
                    return self._transfer(number_of(instruction), power, step)
                return (Branch(power, set_to(operands[0], on=name == "SET")),)
            case "PLS" | "PLF":
                edge = self._numbering.edge(i)
                pulse = edge_pulse(edge, falling=name == "PLF")
                return Let(NOW, power), drive(operands[0], pulse), Store(edge, NOW)
            case "MC":
                relay = contact(operands[1])
                return drive(operands[1], power), Store(RowElement(GATES, number_of(instruction)), relay)
        return () if form is None else self._applied(i, form, power)

    def left(self, i: int, step: LadderStep) -> tuple[Statement, ...]:
        """Return the statements for an instruction after its step has turned off."""
        instruction = self._list[i]
        name, operands, form = instruction.name, instruction.operands, FORMS.get(instruction.name)
        device = operands[0] if operands else None
        if name == "OUT" and device is not None and not _is_step(device):
            driven = self._driven_by_others(device, step)
            return driven_off(device) if driven is None else (Branch(Inverse(driven), driven_off(device)),)
        if name in ("PLS", "PLF") and device is not None:
            return drive(device, power=False), Store(self._numbering.edge(i), value=False)
        if form is not None and form.kind.name in LEVELS:
            return self._level(i, form, power=False)
        if form is not None and form.pulsed:
            return (Store(self._numbering.edge(i), value=False),)
        return ()

    def _driven_by_others(self, coil: Operand, step: LadderStep) -> Condition | None:
        """Return the condition that another step that drives a coil is active; None if there is no other step.

        If there are many, the condition is the same for all of them, because the step itself is not active.
        """
        drivers = self._drivers[coil]
        if len(drivers) > MOST_DRIVERS:
            return self._numbering.shared_condition(any_of([active(each) for each in drivers]))
        others = [active(each) for each in drivers if each is not step]
        return any_of(others) if others else None

    def _out(self, operands: tuple[Operand, ...], power: Condition, step: LadderStep | None) -> tuple[Statement, ...]:
        match operands[0]:
            case DeviceOperand("T", number):
                return (timer(number, operands[1], power),)
            case DeviceOperand("C", number) if number >= FIRST_HIGH_SPEED:
                return (Store(RowElement("CE", number), power),)  # the terminals are counted between the scans
            case DeviceOperand("C", number):
                return counter(number, operands[1], power)
            case DeviceOperand("S", number) as state if step is not None and _is_step(state):
                return self._transfer(number, power, step)
        return (drive(operands[0], power),)

    def _transfer(self, target: int, power: Condition, step: LadderStep) -> tuple[Statement, ...]:
        """Return the statements that set the target state immediately; the source states are reset at END."""
        self._numbering.sources |= set(step.states)
        transfer = (
            Store(RowElement("S", target), value=True),
            *(Store(RowElement("L", source), value=True) for source in step.states),
            Store(RowElement("L", target), value=False),
            Store(RowElement("W", TRANSFERRED), 1),
        )
        return (Branch(Conjunction(power, Inverse(RowElement("M", TRANSFER_DISABLE))), transfer),)

    # applied instructions

    def _applied(self, i: int, form: Form, power: Condition) -> tuple[Statement, ...]:
        if form.kind.name in LEVELS:
            return self._level(i, form, power)
        action = self._action(i, form)
        if not form.pulsed:
            return (Branch(power, action),)
        edge = self._numbering.edge(i)
        off = Branch(Inverse(NOW), (Store(edge, value=False),))
        rising = Branch(edge_pulse(edge, falling=False), (Store(edge, value=True), *action), (off,))
        return Let(NOW, power), rising

    def _level(self, i: int, form: Form, power: Condition) -> tuple[Statement, ...]:
        """Return the statements for an instruction that also acts when its drive input turns off."""
        match form.kind.name, self._list[i].operands:
            case "ANS", (
                DeviceOperand("T", n, ""),
                Constant(preset, _, "") as constant,
                DeviceOperand("S", _, "") as s,
            ) if 0 <= preset <= WORD_MAX:
                return (timer_off(n),) if power is False else annunciator(n, constant, s, power)
        if form.kind.name in _EVERY_SCAN:
            return (self._numbering.operation(i, power),)
        level = self._numbering.level(i)
        execution = Store(level, self._numbering.operation(i, NOW))
        return Let(NOW, power), Branch(Disjunction(NOW, level), (execution,))

    def _action(self, i: int, form: Form) -> tuple[Statement, ...]:
        """Return the statements for an applied instruction that acts while it is driven."""
        match form.kind.name:
            case "CJ":
                return self._jump(i, number_of(self._list[i]))
            case "CALL":
                return self._call(number_of(self._list[i]))
        statements = plain_action(form, self._list[i].operands)
        return (self._numbering.operation(i),) if statements is None else statements

    def _jump(self, i: int, label: int) -> tuple[Statement, ...]:
        """Return the statements of CJ; a jump backwards uses watchdog time."""
        if label == END_POINTER:
            return (Leave(),)
        at = next(k for k, x in enumerate(self._list) if x.name == "P" and number_of(x) == label)
        if at >= i:
            return (Jump(label),)
        return Spend(sum(map(steps, self._list[at : i + 1]))), Jump(label)

    def _call(self, label: int) -> tuple[Statement, ...]:
        depth = RowElement("W", DEPTH)
        return (
            Spend(steps_of(self._list, self._parts.subroutines[label])),
            Branch(Comparison("==", depth, CALL_DEPTH), (StopTooDeep(),)),
            Store(depth, Arithmetic("+", depth, 1)),
            RunSubroutine(label),
            Store(depth, Arithmetic("-", depth, 1)),
        )


def active(step: LadderStep) -> Condition:
    """Return the condition that all states of a step are on."""
    first, *others = step.states
    condition: Condition = RowElement("S", first)
    for state in others:
        condition = Conjunction(condition, RowElement("S", state))
    return condition


def _is_step(operand: Operand) -> bool:
    return isinstance(operand, DeviceOperand) and operand.kind == "S" and operand.number not in ANNUNCIATORS


def _drivers(instructions: tuple[Instruction, ...], parts: Parts) -> dict[Operand, list[LadderStep]]:
    """Return, for each coil, the steps that drive it."""
    drivers: dict[Operand, list[LadderStep]] = {}
    for body in parts.bodies:
        for step in body:
            if isinstance(step, LadderStep):
                for i in step.body:
                    if instructions[i].name == "OUT":
                        drivers.setdefault(instructions[i].operands[0], []).append(step)
    return drivers
