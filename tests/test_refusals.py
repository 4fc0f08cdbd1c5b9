"""Every obstacle of every command: alone it refuses the command, changes nothing, and tells why in both languages.

A situation in which one obstacle stands and no other is looked for by trial, in what the obstacles themselves read.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import fields
from random import Random

import pytest
from interlock_scene import MACHINE, TAGS

from controller.core.devices import Memory
from controller.core.expr import Bit, Expr, Word, any_of, evaluate, leaves
from controller.core.scan import Plc
from controller.program.commands import Command
from controller.program.refusals import Refusal, refusal_text
from controller.program.states import MOVING, RUNNING, Mode, State
from controller.program.tags import FULL, IN_DOUBT
from controller.program.texts import CANNOT, ORDERS, REFUSALS

CONTROL = TAGS.machine
PLC = Plc(MACHINE.program, input_filter_ms=0)
NEW = copy.deepcopy(PLC.memory)
LEVELS = [False] * MACHINE.io_map.input_count
for point in MACHINE.io_map.inputs:
    LEVELS[point.number] = point.level(False)
"""No switch on, no button pressed."""


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
"""What the scan before has made of state, mode and rows."""
BEGINNING = {CONTROL.home_requested: TAGS.commands.reset}
"""What this scan makes of an order given with the other one."""
NOT_LOOKED_FOR = {CONTROL.start_requested, CONTROL.unhold_requested, *FOLLOWS}
TOLD = (CONTROL.refused, CONTROL.refusal, CONTROL.refusals)
CASES = [
    pytest.param(command, index, id=f"{command.name}-{obstacle.reason.name}-{index}")
    for command in TAGS.commands
    for index, obstacle in enumerate(MACHINE.orders.obstacles(command.bit))
]


def values_of(device: Bit | Word) -> list[int]:
    """Return what a device may hold."""
    if isinstance(device, Bit):
        return [0, 1]
    return [int(state) for state in State] if device == CONTROL.state else sorted({*Mode, *range(4)} - {0, 2})


def settle(memory: Memory) -> None:
    """Let what follows from state and mode follow."""
    for bit, follows in FOLLOWS.items():
        memory.M[bit.number] = evaluate(follows, memory)


def look_for(memory: Memory, wanted: list[tuple[Expr, bool]], seed: int) -> None:
    """Change what the conditions read until every one of them is as wanted.

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
    raise AssertionError("no situation in which it stands alone")


def situation(command: Command, index: int, seed: int) -> Memory:
    """Return a memory in which one obstacle of a command stands, and no other of it."""
    memory = copy.deepcopy(NEW)
    for number, level in enumerate(LEVELS):
        memory.X[number] = level
    memory.set_word("D", CONTROL.mode.number, Mode.CONTINUOUS)
    for arm in TAGS.arms.values():
        memory.set_word("D", arm.rows[3].number, FULL)
    wanted = [(each.stands, n == index) for n, each in enumerate(MACHINE.orders.obstacles(command.bit))]
    for bit, order in BEGINNING.items():
        if any(bit in leaves(condition) for condition, stands in wanted if stands):
            wanted += [(order, True), (MACHINE.orders.free(order), True)]
    look_for(memory, wanted, seed)
    return memory


def after(memory: Memory, *presses: Bit) -> Memory:
    """Return the memory after one scan from this one on, with these orders given."""
    for kind in fields(Memory):
        getattr(PLC.memory, kind.name)[:] = getattr(memory, kind.name)
    PLC.memory.E[:] = [False] * len(PLC.memory.E)
    PLC.scans = 1
    for bit in presses:
        PLC.press(bit)
    PLC.scan(10_000, memory.X[: len(LEVELS)])
    return copy.deepcopy(PLC.memory)


def differing(one: Memory, other: Memory) -> set[str]:
    """Return the devices that differ, but for edges, timers and what tells of a refusal."""
    apart = {"M": {CONTROL.ordered.number}, "D": {word.number for word in TOLD}}
    return {
        f"{kind}{number}"
        for kind in ("X", "Y", "M", "S", "C", "D", "CV")
        for number, (a, b) in enumerate(zip(getattr(one, kind), getattr(other, kind), strict=True))
        if a != b and number not in apart.get(kind, ())
    }


@pytest.mark.parametrize(("command", "index"), CASES)
def test_an_obstacle_refuses_changes_nothing_and_is_told(command: Command, index: int) -> None:
    """Given one obstacle alone, the order leaves the memory as no order would, but for what tells of the refusal."""
    obstacle = MACHINE.orders.obstacles(command.bit)[index]
    for seed in range(3):
        before = situation(command, index, seed)
        without, refused = after(before), after(before, command.bit)
        assert differing(without, refused) == set()
        assert refused.word("D", CONTROL.refusals.number) == 1 + without.word("D", CONTROL.refusals.number)
        assert refused.word("D", CONTROL.refused.number) == command.number
        assert refused.word("D", CONTROL.refusal.number) == obstacle.reason


@pytest.mark.parametrize("command", [c for c in TAGS.commands if MACHINE.orders.obstacles(c.bit)], ids=lambda c: c.name)
def test_without_an_obstacle_nothing_is_refused(command: Command) -> None:
    """Given no obstacle, the order is heard: no refusal is told, and something is different from no order."""
    before = situation(command, -1, seed=1)
    without, heard = after(before), after(before, command.bit)
    assert heard.word("D", CONTROL.refusals.number) == 0
    same_mode = command.group == "mode" and differing(without, heard) == set()
    assert differing(without, heard) or same_mode


def test_of_several_obstacles_the_first_of_the_table_is_told() -> None:
    """Given everything in the way of a start in Idle, the reason told is the first that stands."""
    obstacles = MACHINE.orders.obstacles(TAGS.commands.start)
    for first in range(1, len(obstacles)):
        before = situation(next(c for c in TAGS.commands if c.name == "start"), first, seed=2)
        assert refusal_after(before) == obstacles[first].reason
        before.X[MACHINE.io_map["stop"].number] = MACHINE.io_map["stop"].level(True)
        assert refusal_after(before) == Refusal.STOP_PRESSED


def refusal_after(memory: Memory) -> int:
    return after(memory, TAGS.commands.start).word("D", CONTROL.refusal.number)


# texts


def test_a_refusal_reads_like_this() -> None:
    start = next(command for command in TAGS.commands if command.name == "start")
    assert refusal_text(start, Refusal.LEFT_NOT_DOWN, "en") == "cannot start: left lift not down"
    assert refusal_text(start, Refusal.LEFT_NOT_DOWN, "zh") == "无法启动:左升降缸不在下限位"


@pytest.mark.parametrize("command", list(TAGS.commands), ids=lambda c: c.name)
def test_every_refusal_of_a_command_says_what_cannot_be_and_why(command: Command) -> None:
    """Given each of its reasons, the text in either language has the order, then the reason, and both are there."""
    told: set[tuple[Refusal, str]] = set()
    for obstacle in MACHINE.orders.obstacles(command.bit):
        english, chinese = (refusal_text(command, obstacle.reason, language) for language in ("en", "zh"))
        order, why = ORDERS[command.group], REFUSALS[obstacle.reason.name]
        assert english == CANNOT.en.format(order=order.en, reason=why.en)
        assert chinese == CANNOT.zh.format(order=order.zh, reason=why.zh)
        assert english.isascii()
        assert not any(letter.isascii() and letter.isalpha() for letter in why.zh)
        told.add((obstacle.reason, english))
    assert len({text for _, text in told}) == len(told)


def test_every_reason_is_a_reason_of_some_command() -> None:
    told = {obstacle.reason for c in TAGS.commands for obstacle in MACHINE.orders.obstacles(c.bit)}
    assert told == {*Refusal}
