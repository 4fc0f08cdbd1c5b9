"""Confirmation of machine constants with X25 before the first homing of a start, from every bad beginning.

The monitors of the proof run with the program. The monitor of the confirmation is compared with the relay of the
program whenever one of them changes; if it went off too soon, the requirement of the proof would demand nothing.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable
from dataclasses import replace

import pytest

from controller.core.specification import Specification
from controller.events.kinds import AlarmEvent
from controller.hmi.access.tag_list import tags as tag_list
from controller.program.operator.next_press import NextPress
from controller.program.operator.refusals import Refusal
from controller.program.requirements.safety import Safety
from controller.program.states import Mode, State
from plant_sim.machine.parameters import load_machine
from plant_sim.twin.commissioning import program_of
from plant_sim.twin.lock_step import CLEAR_MS, Twin
from plant_sim.twin.monitors import guard
from plant_sim.twin.recovery import clear, press_emergency_stop
from tests.controller.program.interlock_scene import MACHINE
from tests.controller.program.recovery.test_disturbances import pull_the_cable
from tests.controller.program.recovery.test_ways_out import read, refusals
from tests.sampling import one_in
from tests.wiring import wired

WIDE = load_machine().with_values({"layout.arms_may_meet_in_plant": True})
MAY_MEET = {"arms_may_meet": 1}
DEFAULT = {"arms_may_meet": 0}
REFUSED = ("reset", Refusal.CONSTANTS, NextPress.CONFIRM_CONSTANTS)
IO_MAP = wired("reset", "lamp_amber", "air_pressure_ok")
PROGRAM = program_of(IO_MAP)
SAFETY = Safety(PROGRAM)
WATCHED = replace(PROGRAM, program=Specification(PROGRAM.program, SAFETY.monitors, (), (), ()).watched)


def powered_up(set_points: dict[str, int], relation: Callable[[bool, bool], bool] = operator.eq) -> Twin:
    """Return a machine before its first scan, with the monitors of the proof in its program.

    Args:
        set_points: Values of the start.
        relation: Relation between the monitor and the relay of constants that still have to be confirmed, which holds
            after every scan.
    """
    twin = guard(Twin(set_points=set_points, io_map=IO_MAP, parameters=WIDE, machine=WATCHED))
    twin.plant.seedlings.make_typical()

    def check(each: Twin) -> None:
        assert relation(is_unconfirmed(each), is_open(each)), each.situation()

    twin.watch(check, [SAFETY.machine.unconfirmed, PROGRAM.tags.machine.constants_open])
    return twin


def started(set_points: dict[str, int] | None = None) -> Twin:
    """Return a machine in Stopped after power-up, with a constant that differs from its default."""
    twin = powered_up(MAY_MEET if set_points is None else set_points)
    twin.run_for(200)
    return twin


def is_unconfirmed(twin: Twin) -> bool:
    """Return True if the monitor of the proof has not seen X25 pressed and released."""
    return bool(twin.plc.read(SAFETY.machine.unconfirmed))


def is_open(twin: Twin) -> bool:
    """Return True if the constants still have to be confirmed."""
    return bool(twin.plc.read(twin.machine.tags.machine.constants_open))


def press_x0(twin: Twin) -> None:
    """Press X0."""
    twin.press("start")
    twin.run_for(200)


def press_x26(twin: Twin) -> None:
    """Press the reset button."""
    twin.press("reset")
    twin.run_for(300)


def command_reset(twin: Twin) -> None:
    """Give the command."""
    twin.command("reset")
    twin.run_for(50)


@pytest.mark.parametrize(
    ("mode", "home"),
    one_in(2, itertools.product((Mode.CONTINUOUS, Mode.MANUAL), (press_x0, press_x26, command_reset))),
)
def test_homing_is_refused_until_x25_has_been_pressed_and_released(home: Callable[[Twin], None], mode: Mode) -> None:
    """Also in manual mode, since jogging begins with a reset."""
    twin = started()
    twin.command(f"mode_{mode.name.lower()}")
    twin.run_for(50)
    assert read(twin, "next_press") == NextPress.CONFIRM_CONSTANTS
    home(twin)
    assert twin.state is State.STOPPED
    assert refusals(twin) == [REFUSED]
    press_emergency_stop(twin)
    assert is_open(twin)
    assert read(twin, "next_press") == NextPress.RELEASE_EMERGENCY_STOP
    clear(twin)
    assert not is_open(twin)
    assert read(twin, "next_press") == NextPress.HOME
    home(twin)
    assert twin.state is not State.STOPPED


def test_without_a_difference_homing_needs_no_confirmation() -> None:
    twin = started(DEFAULT)
    assert not is_open(twin)
    press_x0(twin)
    assert twin.state is State.RESETTING


@pytest.mark.parametrize(
    "name", [n for n in MACHINE.tags.sp.names() if getattr(MACHINE.tags.sp, n) in MACHINE.tags.sp.constants]
)
def test_each_constant_is_confirmed_and_named(name: str) -> None:
    """On the console, and by a coil for each constant."""
    word = getattr(MACHINE.tags.sp, name)
    default = dict(MACHINE.tags.sp.defaults)[word]
    twin = started({**DEFAULT, name: default + 1})
    assert is_open(twin)
    (warning,) = [event for event in twin.events if isinstance(event, AlarmEvent)]
    assert warning.text.en == f"A machine constant differs from its default: {name} {default + 1} (default {default})"
    coils = {tag.name: tag for tag in tag_list(MACHINE) if tag.name.endswith(".differs")}
    assert len(coils) == len(MACHINE.tags.sp.constants)
    shown = {tag for tag, coil in coils.items() if twin.plc.memory.M[int(coil.device[1:])]}
    assert shown == {f"constant.{name}.differs"}


def test_a_press_that_lasts_since_power_up_does_not_confirm() -> None:
    """At power-up, an input that is not yet read looks like a pressed X25; the monitor ends with its release."""
    twin = powered_up(MAY_MEET, operator.le)
    twin.plant.box.emergency_stop = True
    twin.run_for(500)
    assert is_unconfirmed(twin)
    clear(twin)
    assert is_open(twin)
    twin.confirm_constants()
    assert not is_open(twin)


def test_a_lost_link_is_no_press() -> None:
    """The level that replaces X25 during the loss, and its end, confirm nothing."""
    twin = started()
    pull_the_cable(twin, 500)
    assert twin.state is State.ABORTED
    clear(twin)
    assert is_open(twin)


def test_the_next_press_confirms_before_an_alarm_is_repaired() -> None:
    """The homing that follows a repair is refused until then."""
    twin = started()
    twin.plant.supply.pressure_ok.stuck = False
    twin.run_for(1_000)
    assert twin.state is State.STOPPED
    assert twin.alarms() == ["air_low", "constants"]
    assert read(twin, "next_press") == NextPress.CONFIRM_CONSTANTS
    twin.confirm_constants()
    assert twin.alarms() == ["air_low", "constants"]
    assert read(twin, "next_press") == NextPress.REPAIR_AND_HOME


def test_each_start_is_confirmed_anew() -> None:
    twin = started()
    twin.home()
    twin.power_cycle()
    twin.run_for(200)
    assert is_open(twin)
    press_x0(twin)
    assert twin.state is State.STOPPED


def test_a_later_stop_of_the_same_start_needs_no_confirmation() -> None:
    twin = started()
    twin.home()
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=CLEAR_MS)
    twin.run_for(300)
    press_x0(twin)
    assert twin.state is State.RESETTING
