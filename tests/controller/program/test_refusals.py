"""Refusals: each obstacle alone causes its command to be refused and the refusal to be reported, without other effects.

A search over the devices that the obstacles read finds a situation in which exactly one obstacle is active.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from random import Random

import pytest

from controller.core.devices import Memory
from controller.core.expr import Bit, Expr, Word, any_of, evaluate, leaves
from controller.core.scan import Plc
from controller.program.machine import build
from controller.program.operator.commands import Command
from controller.program.operator.refusals import Refusal, refusal_text
from controller.program.states import MOVING, RUNNING, Mode, State
from controller.program.tags import FULL, IN_DOUBT, TAKEN
from controller.program.texts.operator import CANNOT, ORDERS, REFUSALS
from tests.controller.core.core_rig import copied
from tests.controller.program.interlock_scene import MACHINE, TAGS
from tests.sampling import first_of
from tests.wiring import wired

CONTROL = TAGS.machine
PLC = Plc(MACHINE.program, input_filter_ms=0)
NEW = copied(PLC.memory)
LEVELS = [False] * MACHINE.io_map.input_count
for point in MACHINE.io_map.inputs:
    LEVELS[point.number] = point.level(False)
"""Terminal levels with no switch on and no button pressed."""


def state_in(states: Iterable[State]) -> Expr:
    return any_of(*(CONTROL.state.equals(state) for state in states))


MANUAL = CONTROL.mode.equals(Mode.MANUAL)
FOLLOWS = {
    CONTROL.manual: MANUAL,
    CONTROL.motion: state_in(MOVING),
    CONTROL.resetting: state_in([State.RESETTING]),
    CONTROL.running: state_in(RUNNING),
    CONTROL.stepping: CONTROL.mode.equals(Mode.STEP) & ~state_in([State.RESETTING]),
    CONTROL.jogging: MANUAL & state_in([State.EXECUTE]),
    **{arm.ask: arm.rows[1].equals(IN_DOUBT) for arm in TAGS.arms.values()},
    **{arm.hears_answers: ~state_in(MOVING) for arm in TAGS.arms.values()},
}
"""Bits derived by the previous scan from state, mode and rows."""
BEGINNING = {CONTROL.home_requested: TAGS.commands.reset}
"""Bits derived in this scan from another command, which is issued together with the tested command."""
NOT_LOOKED_FOR = {CONTROL.start_requested, CONTROL.unhold_requested, CONTROL.no_armed, CONTROL.yes_armed, *FOLLOWS}
STOP_EDGE = 1
"""Edge memory of X24: the second edge of the program."""
REFUSAL_REGISTERS = (CONTROL.refused, CONTROL.refusal, CONTROL.refusals, CONTROL.next_press)
CASES = [
    pytest.param(command, index, id=f"{command.name}-{obstacle.reason.name}-{index}")
    for command in TAGS.commands
    for index, obstacle in enumerate(MACHINE.orders.obstacles(command.bit))
]


def values_of(device: Bit | Word) -> list[int]:
    """Return the test values of a device."""
    if isinstance(device, Bit):
        return [0, 1]
    return [int(state) for state in State] if device == CONTROL.state else sorted({*Mode, *range(4)} - {0, 2})


def settle(memory: Memory) -> None:
    """Set the bits that are derived from state, mode and rows."""
    for bit, follows in FOLLOWS.items():
        memory.M[bit.number] = evaluate(follows, memory)


def look_for(memory: Memory, wanted: list[tuple[Expr, bool]], seed: int) -> None:
    """Change the devices that the conditions read until every condition has the required value.

    Raises:
        AssertionError: No such memory is found.
    """
    random = Random(seed)
    for _ in range(20_000):
        settle(memory)
        wrong = [condition for condition, value in wanted if evaluate(condition, memory) != value]
        if not wrong:
            return
        read = set(leaves(random.choice(wrong)))
        read |= {device for bit, follows in FOLLOWS.items() if bit in read for device in leaves(follows)}
        device = random.choice(sorted(read - NOT_LOOKED_FOR, key=str))
        value = random.choice(values_of(device))
        if isinstance(device, Bit):
            memory.bits(device.kind)[device.number] = bool(value)
        else:
            memory.set_word(device.kind, device.number, value)
    raise AssertionError("no situation found in which every condition has the required value")


def situation(command: Command, index: int, seed: int) -> Memory:
    """Return a memory in which only one obstacle of a command is active, or none if `index` is -1."""
    memory = copied(NEW)
    for number, level in enumerate(LEVELS):
        memory.X[number] = level
    memory.set_word("D", CONTROL.mode.number, Mode.CONTINUOUS)
    for arm in TAGS.arms.values():
        for row in arm.rows.values():
            memory.set_word("D", row.number, TAKEN if command.name == "rows_full" else FULL)
        memory.M[arm.out_of_service.number] = command.bit in TAGS.commands.in_service.values()
    memory.set_word("D", CONTROL.state.number, State.IDLE if command.name == "stop" and index < 0 else 0)
    wanted = [(each.active, n == index) for n, each in enumerate(MACHINE.orders.obstacles(command.bit))]
    for bit, order in BEGINNING.items():
        if any(bit in leaves(condition) for condition, is_present in wanted if is_present):
            wanted += [(order, True), (MACHINE.orders.free(order), True)]
    look_for(memory, wanted, seed)
    return memory


def after(memory: Memory, *presses: Bit) -> Memory:
    """Return the memory after one scan that starts from the given memory with these commands."""
    for kind in fields(Memory):
        getattr(PLC.memory, kind.name)[:] = getattr(memory, kind.name)
    PLC.memory.E[:] = [False] * len(PLC.memory.E)
    PLC.memory.E[STOP_EDGE] = evaluate(TAGS.x.stop, memory)  # held before, so that X24 itself is not a refused press
    PLC.scans = 1
    for bit in presses:
        PLC.press(bit)
    PLC.scan(10_000, memory.X[: len(LEVELS)])
    return copied(PLC.memory)


def differing(one: Memory, other: Memory) -> set[str]:
    """Return the devices whose values differ, excluding edge memories, timers and the report of refusals."""
    apart = {
        "Y": {MACHINE.io_map["lamp_amber"].number},
        "M": {CONTROL.ordered.number, CONTROL.refused_now.number, CONTROL.refused_shown.number},
        "D": {word.number for word in REFUSAL_REGISTERS},
    }
    return {
        f"{kind}{number}"
        for kind in ("X", "Y", "M", "S", "C", "D", "CV")
        if getattr(one, kind) != getattr(other, kind)
        for number, (a, b) in enumerate(zip(getattr(one, kind), getattr(other, kind), strict=True))
        if a != b and number not in apart.get(kind, ())
    }


@pytest.mark.parametrize("seeds", first_of([1, 3]), ids="{} situations".format)
@pytest.mark.parametrize(("command", "index"), CASES)
def test_an_obstacle_refuses_the_command_and_is_reported_without_any_other_effect(
    command: Command, index: int, seeds: int
) -> None:
    """If one obstacle is active, the command leaves the memory unchanged except for the refusal registers."""
    obstacle = MACHINE.orders.obstacles(command.bit)[index]
    for seed in range(seeds):
        before = situation(command, index, seed)
        without, refused = after(before), after(before, command.bit)
        assert differing(without, refused) == set()
        assert refused.word("D", CONTROL.refusals.number) == 1 + without.word("D", CONTROL.refusals.number)
        assert refused.word("D", CONTROL.refused.number) == command.number
        assert refused.word("D", CONTROL.refusal.number) == obstacle.reason


@pytest.mark.parametrize("command", [c for c in TAGS.commands if MACHINE.orders.obstacles(c.bit)], ids=lambda c: c.name)
def test_a_command_without_an_obstacle_is_accepted(command: Command) -> None:
    """If no obstacle is active, no refusal is reported, and the memory changes unless the mode is already active."""
    before = situation(command, -1, seed=1)
    without, heard = after(before), after(before, command.bit)
    assert heard.word("D", CONTROL.refusals.number) == 0
    same_mode = command.group == "mode" and differing(without, heard) == set()
    assert differing(without, heard) or same_mode


def test_of_several_obstacles_the_first_of_the_table_is_reported() -> None:
    """If X24 is pressed as well, it is reported as the reason for refusing start, because it is first in the table."""
    obstacles = MACHINE.orders.obstacles(TAGS.commands.start)
    for first in range(1, len(obstacles)):
        before = situation(next(c for c in TAGS.commands if c.name == "start"), first, seed=2)
        assert refusal_after(before) == obstacles[first].reason
        before.X[MACHINE.io_map["stop"].number] = MACHINE.io_map["stop"].level(True)
        assert refusal_after(before) == Refusal.STOP_PRESSED


def refusal_after(memory: Memory) -> int:
    return after(memory, TAGS.commands.start).word("D", CONTROL.refusal.number)


# texts


def test_text_of_a_refusal() -> None:
    start = next(command for command in TAGS.commands if command.name == "start")
    text = refusal_text(start, Refusal.LEFT_NOT_DOWN)
    assert text == ("cannot start: left lift not down", "无法启动：左升降缸不在下限位")


@pytest.mark.parametrize("command", list(TAGS.commands), ids=lambda c: c.name)
def test_every_refusal_text_contains_the_command_and_the_reason(command: Command) -> None:
    """For each reason, the text in both languages states the command and then the reason."""
    texts: set[tuple[Refusal, str]] = set()
    for obstacle in MACHINE.orders.obstacles(command.bit):
        english, chinese = refusal_text(command, obstacle.reason)
        order, why = ORDERS[command.group], REFUSALS[obstacle.reason.name]
        assert english == CANNOT.en.format(order=order.en, reason=why.en)
        assert chinese == CANNOT.zh.format(order=order.zh, reason=why.zh)
        assert english.isascii()
        assert not any(letter.isascii() and letter.isalpha() for letter in why.zh)
        texts.add((obstacle.reason, english))
    assert len({text for _, text in texts}) == len(texts)


def test_every_reason_is_used() -> None:
    guarded = build(wired("guard")).orders
    reasons = {obstacle.reason for c in TAGS.commands for obstacle in guarded.obstacles(c.bit)}
    assert reasons | {Refusal.RELEASED_EARLY} == {*Refusal}
