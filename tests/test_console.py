"""Orders typed line by line: commands, set-points, alarms; what is no order changes nothing."""

from __future__ import annotations

import pytest
from twin_rig import switched_on

from controller.hmi.alarm_list import AlarmChange, AlarmList, AlarmState
from controller.hmi.console import Console, OrderError
from controller.program.states import Mode, State
from plant_sim.bench.twin import Twin


class Desk:
    """A guarded machine with a console and an alarm list."""

    def __init__(self) -> None:
        self.twin: Twin = switched_on()
        self.changes: list[AlarmChange] = []
        machine = self.twin.machine
        self.alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, self.changes.append)
        self.twin.runtime.observers.append(self.alarms)
        self._console = Console(self.twin.runtime, self.alarms)

    def type(self, line: str) -> None:
        """Type a line and let one scan pass."""
        self._console.take(line + "\n")
        self.twin.scan()

    def memory(self) -> tuple[object, ...]:
        """Return everything the program remembers."""
        return self.twin.plc.kept_image()


def test_a_command_is_given_and_lives_one_scan() -> None:
    desk = Desk()
    desk.type("mode_step")
    assert desk.twin.plc.read(desk.twin.machine.tags.machine.mode) == Mode.STEP
    desk.type("  reset ")
    assert desk.twin.state is State.RESETTING


def test_a_set_point_is_changed() -> None:
    desk = Desk()
    desk.type("set step_sequence=3")
    assert desk.twin.plc.read(desk.twin.machine.tags.sp.step_sequence) == 3


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("dance", "no command 'dance'; known: reset"),
        ("reset now", "no order 'reset now'; give a command of the table"),
        ("set", "no command 'set'"),
        ("set step_sequence", "set step_sequence: give a whole number"),
        ("set step_sequence=4", "set step_sequence=4: give 1 to 3"),
        ("set speed=1", "set speed=1: no set-point 'speed'; known: trays_target"),
        ("acknowledge all", "'all' is no whole number"),
        ("acknowledge 899", "899"),
        ("shelve 900 5", "shelve 900 5: "),
        ("shelve 990", "no order 'shelve 990'"),
        ("unshelve 899", "899"),
    ],
)
def test_what_is_no_order_is_answered_in_one_line_and_changes_nothing(line: str, said: str) -> None:
    desk = Desk()
    before = desk.memory()
    with pytest.raises(OrderError) as refused:
        desk.type(line)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    desk.twin.scan()
    assert (desk.memory(), desk.twin.state) == (before, State.STOPPED)


def test_alarms_are_acknowledged_and_the_horn_with_them() -> None:
    """Given an emergency stop, 'acknowledge' acknowledges the list and silences the horn."""
    desk = Desk()
    desk.twin.plant.box.emergency_stop = True
    desk.twin.run_for(50)
    (row,) = desk.alarms.rows()
    assert row.state is AlarmState.UNACKNOWLEDGED
    horn = desk.twin.machine.tags.machine.horn
    assert desk.twin.plc.read(horn)
    desk.type("acknowledge")
    (row,) = desk.alarms.rows()
    assert row.state is AlarmState.ACKNOWLEDGED
    assert not desk.twin.plc.read(horn)
    assert desk.changes[-1].by == "console"


def test_a_warning_is_shelved_and_taken_back() -> None:
    desk = Desk()
    desk.twin.plant.box.stop = True
    desk.twin.run_for(6_000)
    (row,) = desk.alarms.rows()
    desk.type(f"shelve {row.alarm.bit.number} 10")
    assert desk.alarms.rows()[0].state is AlarmState.SHELVED
    desk.type(f"unshelve {row.alarm.bit.number}")
    assert desk.alarms.rows()[0].state is not AlarmState.SHELVED


def test_every_line_is_a_sign_of_life() -> None:
    """Given a panel limit, an empty line keeps the panel alive, and so does one that is no order."""
    desk = Desk()
    desk.twin.runtime._panel_limit_ms = 1_000
    for line in ("", "dance", "", ""):
        if line:
            with pytest.raises(OrderError):
                desk.type(line)
        else:
            desk.type(line)
        desk.twin.run_for(900)
        assert desk.twin.alarms() == []
    desk.twin.run_for(200)
    assert desk.twin.alarms() == ["hmi_silent"]
