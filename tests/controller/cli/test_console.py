"""Console orders: commands, set-points and alarm actions. Invalid orders have no effect."""

from __future__ import annotations

import pytest

from controller.events.alarm_list import AlarmChange, AlarmList
from controller.events.alarm_states import AlarmState
from controller.hmi.console import Console, OrderError
from controller.program.states import Mode, State
from plant_sim.twin.lock_step import Twin
from tests.plant_sim.twin.twin_rig import switched_on


class ConsoleRig:
    """Machine with a console and an alarm list."""

    def __init__(self) -> None:
        self.twin: Twin = switched_on()
        self.changes: list[AlarmChange] = []
        machine = self.twin.machine
        self.alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, self.changes.append)
        self.twin.runtime.observers.append(self.alarms)
        self._console = Console(self.twin.runtime, self.alarms)

    def type(self, line: str) -> None:
        """Enter a line and run one scan."""
        self._console.execute(line + "\n")
        self.twin.scan()

    def memory(self) -> object:
        """Return the complete retained state of the program."""
        return self.twin.plc.retentive_image()


def test_a_command_lasts_one_scan() -> None:
    rig = ConsoleRig()
    rig.type("mode_step")
    assert rig.twin.plc.read(rig.twin.machine.tags.machine.mode) == Mode.STEP
    rig.type("  reset ")
    assert rig.twin.state is State.RESETTING


def test_a_set_point_is_changed() -> None:
    rig = ConsoleRig()
    rig.type("set step_sequence=3")
    assert rig.twin.plc.read(rig.twin.machine.tags.sp.step_sequence) == 3


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("dance", "unknown command 'dance'; known: reset"),
        ("reset now", "unknown order 'reset now'; expected a command of the table"),
        ("set", "unknown command 'set'"),
        ("set step_sequence", "set step_sequence: must be an integer"),
        ("set step_sequence=4", "set step_sequence=4: must be 1 to 3"),
        ("set speed=1", "set speed=1: unknown set-point 'speed'; docs/reference/commands.md lists all"),
        ("acknowledge all", "'all' is not a whole number"),
        ("acknowledge 899", "899"),
        ("shelve 900 5", "shelve 900 5: "),
        ("shelve 990", "unknown order 'shelve 990'"),
        ("unshelve 899", "899"),
    ],
)
def test_an_invalid_order_is_reported_in_one_line_and_has_no_effect(line: str, expected: str) -> None:
    rig = ConsoleRig()
    before = rig.memory()
    with pytest.raises(OrderError) as refused:
        rig.type(line)
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)
    rig.twin.scan()
    assert (rig.memory(), rig.twin.state) == (before, State.STOPPED)


def test_acknowledge_also_silences_the_horn() -> None:
    """During an emergency stop, 'acknowledge' acknowledges all alarms and silences the horn."""
    rig = ConsoleRig()
    rig.twin.plant.box.emergency_stop = True
    rig.twin.run_for(50)
    (row,) = rig.alarms.rows()
    assert row.state is AlarmState.UNACKNOWLEDGED
    horn = rig.twin.machine.tags.machine.horn
    assert rig.twin.plc.read(horn)
    rig.type("acknowledge")
    (row,) = rig.alarms.rows()
    assert row.state is AlarmState.ACKNOWLEDGED
    assert not rig.twin.plc.read(horn)
    assert rig.changes[-1].by == "console"


def test_a_warning_is_shelved_and_unshelved() -> None:
    rig = ConsoleRig()
    rig.twin.plant.box.stop = True
    rig.twin.run_for(11_000)
    (row,) = rig.alarms.rows()
    rig.type(f"shelve {row.alarm.bit.number} 10")
    assert rig.alarms.rows()[0].state is AlarmState.SHELVED
    rig.type(f"unshelve {row.alarm.bit.number}")
    assert rig.alarms.rows()[0].state is not AlarmState.SHELVED


def test_every_line_resets_the_panel_watchdog() -> None:
    """If a panel timeout is set, an empty line and an invalid order both reset the watchdog."""
    rig = ConsoleRig()
    rig.twin.runtime.panel.limit_ms = 1_000
    for line in ("", "dance", "", ""):
        if line:
            with pytest.raises(OrderError):
                rig.type(line)
        else:
            rig.type(line)
        rig.twin.run_for(900)
        assert rig.twin.alarms() == []
    rig.twin.run_for(200)
    assert rig.twin.alarms() == ["hmi_silent"]
