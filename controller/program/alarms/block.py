"""Block of the alarms: annunciators, fault relays, first-out register and horn."""

from __future__ import annotations

from controller.core.expr import FALSE, Expr, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Mov, Out, Pulse, Rst, Rung, Set
from controller.core.sequence import Sequence
from controller.program.alarms.arm import ArmAlarms, arm_rungs
from controller.program.alarms.cups import cup_rungs
from controller.program.alarms.table import Alarm, Annunciators, machine_rungs
from controller.program.tags import Side, Tags


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
        *(Rst(alarm.bit, when=machine.alarm_reset & ~_lasting(alarm)) for alarm in alarms if alarm.wired),
        *machine_rungs(tags, alarms),
        *cup_rungs(tags, alarms),
    ]
    for sequence in sequences:
        rungs += sequence.limits()
    for side, arm_alarms in arms.items():
        rungs += [
            *arm_rungs(tags, tags.arms[side], arm_alarms),
            Out(tags.arms[side].fault, when=any_of(*alarms.of_side(side))),
        ]
    stopping = [alarm.bit for alarm in alarms.by_severity() if alarm.stops_work and alarm.wired]
    cups = {alarms.cups_fast, alarms.cups_implausible, alarms.cups_ground}
    counts = [arm_alarms.cup_counts for arm_alarms in arms.values()]
    of_yield = [alarm for arm_alarms in arms.values() for alarm in arm_alarms.of_yield]
    of_machine = [alarm.bit for alarm in alarms if alarm.side is None and alarm.bit in {*stopping} - cups]
    rungs += [
        Out(tray.fault, when=alarms.tray_jam | alarms.tray_lost),
        Out(machine.cup_fault, when=any_of(alarms.cups_fast, alarms.cups_implausible, alarms.cups_ground, *counts)),
        Out(
            machine.fault,
            when=any_of(machine.cup_fault, *(arm.fault for arm in tags.arms.values()), *of_yield, *of_machine),
        ),
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
