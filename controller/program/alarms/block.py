"""Rungs that set and reset the alarms of the machine, the first-out register and the horn."""

from __future__ import annotations

from typing import Final

from controller.core.devices import MS_100
from controller.core.expr import FALSE, Expr, Timer, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Annunciate, Mov, Out, Pulse, Rst, Rung, Set
from controller.core.sequence import Sequence
from controller.program.alarms.arm import ArmAlarms, arm_rungs
from controller.program.alarms.cups import cup_rungs
from controller.program.alarms.table import Alarm, Annunciators
from controller.program.operator.buttons import stuck_rungs
from controller.program.tags import FIRST_SCAN, IN_PLACE, Side, Tags

TRAY_LOST_MS: Final = 500
"""Delay of the alarm for a tray at rest that is no longer detected by the front edge sensor, ms; longer than sensor
bounce."""


def alarm_block(
    tags: Tags,
    alarms: Annunciators,
    arms: dict[Side, ArmAlarms],
    sequences: list[Sequence],
) -> Block:
    """Return the block that sets and resets the annunciators and the fault relays of the arms and the tray feeder."""
    machine, tray = tags.machine, tags.tray
    rungs: list[Rung] = [
        Out(machine.alarm_reset, when=machine.entered_resetting | machine.clear_requested),
        *(Rst(alarm.bit, when=machine.alarm_reset & ~_lasting(alarm)) for alarm in alarms),
        *_machine_rungs(tags, alarms),
        *cup_rungs(tags, alarms),
    ]
    for sequence in sequences:
        rungs += sequence.limits()
    for side, arm_alarms in arms.items():
        rungs += [
            *arm_rungs(tags, tags.arms[side], arm_alarms),
            Out(tags.arms[side].fault, when=any_of(*alarms.of_side(side))),
        ]
    stopping = [alarm.bit for alarm in alarms.by_severity() if alarm.stops_work]
    cups = {alarms.cups_fast, alarms.cups_implausible, alarms.cups_ground}
    counts = [arm_alarms.cup_counts for arm_alarms in arms.values()]
    of_machine = [alarm.bit for alarm in alarms if alarm.stops_work and alarm.side is None and alarm.bit not in cups]
    rungs += [
        Out(tray.fault, when=alarms.tray_jam | alarms.tray_lost),
        Out(machine.cup_fault, when=any_of(alarms.cups_fast, alarms.cups_implausible, alarms.cups_ground, *counts)),
        Out(machine.fault, when=any_of(machine.cup_fault, *(arm.fault for arm in tags.arms.values()), *of_machine)),
        Mov(0, machine.first_out, when=machine.alarm_reset),
        *(
            Mov(bit.number, machine.first_out, when=all_of(machine.fault, bit, machine.first_out.equals(0)))
            for bit in stopping
        ),
        Mov(0, machine.first_out, when=~machine.fault),
        Pulse(machine.new_alarm, when=machine.fault),
        Set(machine.horn, when=machine.new_alarm),
        Rst(machine.horn, when=tags.commands.acknowledge | ~machine.fault),
    ]
    return Block("alarms", tuple(rungs))


def _lasting(alarm: Alarm) -> Expr:
    return FALSE if alarm.cause is None else alarm.cause


def _machine_rungs(tags: Tags, alarms: Annunciators) -> list[Rung]:
    """Return the rungs of the machine alarms; an optional input is used only if it is wired."""
    x, system, machine, tray = tags.x, tags.system, tags.machine, tags.tray
    rungs: list[Rung] = [
        Set(alarms.emergency_stop, when=x.emergency_stop & ~system.link_lost),
        Set(alarms.link_lost, when=system.link_lost),
        Set(alarms.scan_fault, when=system.scan_fault),
        Set(alarms.store_fault, when=system.store_fault),
        Set(alarms.outputs_taken, when=system.outputs_taken),
        Set(alarms.outputs_contested, when=system.outputs_contested),
        Rst(alarms.outputs_contested, when=~system.outputs_contested),
        Set(alarms.constants, when=machine.constants_differ),
        Rst(alarms.constants, when=~machine.constants_differ),
        *stuck_rungs(tags, machine.t_start, alarms.start_stuck, x.start),
        *stuck_rungs(tags, machine.t_stop, alarms.stop_stuck, x.stop),
        Set(alarms.panel_silent, when=system.panel_silent),
        Rst(alarms.panel_silent, when=~system.panel_silent),
        Set(alarms.memory_lost, when=FIRST_SCAN & system.memory_lost),
        Set(alarms.tray_jam, when=tray.met | tray.overdue),
        Annunciate(
            tray.t_lost,
            TRAY_LOST_MS,
            alarms.tray_lost,
            when=all_of(machine.running, ~machine.manual, tray.phase.equals(IN_PLACE), ~tray.edge),
        ),
    ]
    if (reset := x.optional("reset")) is not None:
        rungs += stuck_rungs(tags, machine.t_reset, alarms.reset_stuck, reset)
    if (air_low := x.optional_off("air_pressure_ok")) is not None:
        rungs.append(Annunciate(Timer(105, "air low"), 5 * MS_100, alarms.air_low, when=air_low))
    if (magazine := x.optional("magazine_empty")) is not None:
        rungs += [Set(alarms.magazine_empty, when=magazine), Rst(alarms.magazine_empty, when=~magazine)]
    return rungs
