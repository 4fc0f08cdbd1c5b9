"""The whole program: tags, sequences and blocks put together in the order of a scan."""

from __future__ import annotations

from dataclasses import dataclass

from controller.core.expr import FALSE, any_of
from controller.core.program import Block, Program, requests
from controller.core.rungs import Out
from controller.core.sequence import Sequence
from controller.io_map import IoMap
from controller.program import arm, home, modes, tray
from controller.program.alarms import Annunciators, ArmAlarms, Limits, alarm_block
from controller.program.interlocks import Rule, arm_rules, block_register, output_block, tray_rules
from controller.program.tags import SIDES, Side, Tags

OUTPUTS = "interlocks and outputs"


@dataclass(frozen=True)
class Transplanter:
    """The machine's program with everything a panel, a test or a document asks for by name."""

    io_map: IoMap
    program: Program
    tags: Tags
    alarms: Annunciators
    cycles: dict[Side, Sequence]
    homings: dict[Side, Sequence]
    feeder: Sequence
    states: list[modes.StateChange]
    rules: dict[Side, list[Rule]]
    tray_rules: list[Rule]


def build(io_map: IoMap) -> Transplanter:
    """Put the program together for the wires of an I/O map.

    Args:
        io_map: The wires; optional points are used where they are wired.

    Returns:
        The program and its parts.
    """
    tags = Tags.of(io_map)
    alarms = Annunciators(tags)
    limits = {side: Limits(tags.arms[side], alarms) for side in SIDES}
    cycles = {side: arm.cycle(tags, side, limits[side]) for side in SIDES}
    homings = {side: home.homing(tags, side, limits[side]) for side in SIDES}
    arm_alarms = {side: ArmAlarms(tags.arms[side], alarms, limits[side]) for side in SIDES}
    feeder = tray.feeder(tags, alarms)
    sequences = [*cycles.values(), *homings.values(), feeder]
    states = modes.state_table(tags)
    rules = {side: arm_rules(tags, side, cycles[side], homings[side]) for side in SIDES}
    rules_tray = tray_rules(tags)
    blocks = (
        Block("buttons and commands", tuple(modes.conditioning(tags))),
        modes.mode_block(tags, states),
        *(
            Block(
                f"{side} arm conditions",
                (
                    *arm.conditioning(tags, side, cycles[side], homings[side]),
                    *home.questions(tags, side, homings[side]),
                ),
            )
            for side in SIDES
        ),
        Block("tray conditions", tuple(tray.conditioning(tags, feeder))),
        *(home.supervision(tags, side, cycles[side], homings[side]) for side in SIDES),
        tray.supervision(tags, feeder),
        *(Block(sequence.name, (sequence,)) for sequence in sequences),
        *(arm.bookkeeping(tags, side, cycles[side], homings[side]) for side in SIDES),
        tray.bookkeeping(tags, feeder),
        _requests(tags, sequences),
        alarm_block(tags, alarms, arm_alarms, sequences),
        output_block(tags, io_map, rules, rules_tray),
        block_register(tags, rules, rules_tray),
        Block("commands consumed", (tags.commands.consumed(),)),
    )
    program = Program(
        "transplanter",
        blocks,
        outputs=OUTPUTS,
        system=(*tags.system.bits(), *(command.bit for command in tags.commands)),
        set_points=tuple(tags.sp.defaults),
    )
    return Transplanter(io_map, program, tags, alarms, cycles, homings, feeder, states, rules, rules_tray)


def _requests(tags: Tags, sequences: list[Sequence]) -> Block:
    """Return the block that gathers what steps ask for, and hands in manual mode."""
    jogs = tags.machine.jogs
    by_hand = {arm.want[name]: jogs[f"{side}.{name}"] for side, arm in tags.arms.items() for name in arm.want}
    by_hand[tags.tray.want_run] = jogs["tray_run"]
    steps = requests(sequences)
    wanted = dict.fromkeys((*steps, *by_hand))
    return Block(
        "requests",
        tuple(Out(bit, when=any_of(*steps.get(bit, ()), by_hand.get(bit, FALSE))) for bit in wanted),
    )
