"""Complete program: tags, sequences and blocks in scan order."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from controller.common.declarations import DeclarationError
from controller.common.errors import InputError
from controller.common.modbus.io_map import IoMap
from controller.core.devices import WORD_MAX
from controller.core.expr import FALSE, Word, any_of
from controller.core.program import Block, Program, requests
from controller.core.rungs import Out
from controller.core.sequence import Sequence
from controller.program import arm, home, modes, tray
from controller.program.alarms.arm import ArmAlarms
from controller.program.alarms.block import alarm_block
from controller.program.alarms.limits import StepLimits
from controller.program.alarms.table import Annunciators
from controller.program.cups import plausibility
from controller.program.interlocks import (
    Rule,
    arm_rules,
    block_register,
    other_rules,
    output_block,
    tray_rules,
)
from controller.program.operator.commands import ARM_OUTPUTS, JOGGED
from controller.program.operator.next_press import NextPress, next_press_rungs
from controller.program.operator.refusals import Orders, Refusal
from controller.program.planting import planting_block
from controller.program.states import Mode, Reason, State
from controller.program.tags import FORGOTTEN, IN_DOUBT, SIDES, STEPPED, Side, Tags
from controller.program.texts import operator as texts
from controller.program.texts.next_press import NEXT_PRESSES

OUTPUTS = "interlocks and outputs"


@dataclass(frozen=True)
class Transplanter:
    """Program of the machine, with the parts that panels, tests and documentation need."""

    io_map: IoMap
    program: Program
    orders: Orders
    tags: Tags
    alarms: Annunciators
    cycles: dict[Side, Sequence]
    homings: dict[Side, Sequence]
    feeder: Sequence
    states: list[modes.StateChange]
    rules: dict[Side, list[Rule]]
    tray_rules: list[Rule]
    other_rules: list[Rule]

    @property
    def rule_groups(self) -> dict[str, list[Rule]]:
        """All interlock rules that apply to an output of the I/O map, by group."""
        groups: dict[str, list[Rule]] = {side: self.rules[side] for side in SIDES}
        groups |= {"tray": self.tray_rules, "other outputs": self.other_rules}
        return {name: rules for name, rules in groups.items() if any(rule.outputs for rule in rules)}


class RuleError(InputError):
    """Raised for an unknown interlock rule; the message is one line with the known rules."""


def build(io_map: IoMap, *, without: Collection[str] = ()) -> Transplanter:
    """Build the program for an I/O map.

    Args:
        io_map: I/O map; optional points are used if they are wired.
        without: Interlock rules to omit, for example "left: down at feed only", to study their effect. Never use this
            on a real machine.

    Returns:
        Program and its parts.

    Raises:
        RuleError: A rule is unknown.
        DeclarationError: A declaration is missing or contradicts another one.
    """
    tags = Tags.of(io_map)
    _require_texts(tags)
    alarms = Annunciators(tags)
    limits = {side: StepLimits(tags.arms[side], alarms) for side in SIDES}
    cycles = {side: arm.cycle(tags, side, limits[side]) for side in SIDES}
    homings = {side: home.homing(tags, side, limits[side]) for side in SIDES}
    arm_alarms = {side: ArmAlarms(tags.arms[side], alarms, limits[side]) for side in SIDES}
    feeder = tray.feeder(tags, alarms)
    sequences = [*cycles.values(), *homings.values(), feeder]
    _require_owners(sequences)
    states = modes.state_table(tags)
    rules = {side: arm_rules(tags, side, cycles[side], homings[side]) for side in SIDES}
    rules_tray, rules_others = tray_rules(tags), other_rules(tags)
    if without:
        _leave_out([*rules.items(), ("tray", rules_tray), ("other outputs", rules_others)], without)
    orders = Orders(tags)
    blocks = (
        Block("buttons and commands", tuple(modes.conditioning(tags, orders, io_map))),
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
        Block("cup plausibility", tuple(plausibility(tags))),
        Block("tray conditions", tuple(tray.conditioning(tags, feeder))),
        *(home.supervision(tags, side, cycles[side], homings[side]) for side in SIDES),
        tray.supervision(tags, feeder),
        *(Block(sequence.name, (sequence,)) for sequence in sequences),
        *(arm.bookkeeping(tags, side, cycles[side], homings[side]) for side in SIDES),
        tray.bookkeeping(tags, feeder),
        _requests(tags, sequences),
        planting_block(tags, alarms, cycles),
        alarm_block(tags, alarms, arm_alarms, sequences),
        Block("next press", tuple(next_press_rungs(tags, orders))),
        output_block(tags, io_map, rules, rules_tray, rules_others),
        Block("coil memory", tuple(rung for side in SIDES for rung in arm.coils_memory(tags.arms[side]))),
        block_register(tags, rules, rules_tray),
        Block("commands consumed", (tags.commands.consumed(),)),
    )
    program = Program(
        "transplanter",
        blocks,
        outputs=OUTPUTS,
        system=(*tags.system.bits(), *(command.bit for command in tags.commands)),
        set_points=tuple(tags.sp.defaults),
        constants=tuple(tags.sp.constants),
        valid=_valid_values(tags),
        reserved=tuple(alarms.reserved),
        output_words=() if tags.planting.planter_speed is None else (tags.planting.planter_speed,),
    )
    return Transplanter(
        io_map, program, orders, tags, alarms, cycles, homings, feeder, states, rules, rules_tray, rules_others
    )


def _valid_values(tags: Tags) -> dict[Word, Collection[int]]:
    """Return the valid values of the retentive words: set-points within their limits, states, and counts."""
    machine = tags.machine
    counts = [machine.trays_done, machine.rows_left, tags.tray.exit_time]
    counts += [count for arm in tags.arms.values() for count in (arm.missed_cups, arm.cycles)]
    counts += [arm.yields.planted.empty_cups for arm in tags.arms.values() if arm.yields.planted is not None]
    return {
        **{word: range(lowest, highest + 1) for word, (lowest, highest) in tags.sp.limits.items()},
        **{row: range(IN_DOUBT + 1) for arm in tags.arms.values() for row in arm.rows.values()},
        **dict.fromkeys(counts, range(WORD_MAX + 1)),
        machine.mode: {0, *Mode},  # 0 before the first scan
        tags.tray.phase: range(FORGOTTEN + 1),
    }


def _require_texts(tags: Tags) -> None:
    """Raise DeclarationError unless each state, mode, reason, question, press, command and refusal has its texts."""
    texts.STATES.require(State)
    texts.MODES.require(Mode)
    texts.REASONS.require(Reason)
    NEXT_PRESSES.require(NextPress)
    texts.REFUSALS.require(reason.name for reason in Refusal)
    texts.ORDERS.require(command.group for command in tags.commands)


def _require_owners(sequences: list[Sequence]) -> None:
    """Raise DeclarationError unless each sequence to step exists and each output to jog has a request."""
    if stepped := {*STEPPED} - {sequence.name for sequence in sequences}:
        raise DeclarationError(f"STEPPED contains {min(stepped)!r}, which is no sequence; add the sequence to build")
    if jogged := {*JOGGED} - {f"{side}.{name}" for side in SIDES for name in ARM_OUTPUTS} - {"tray_run"}:
        raise DeclarationError(f"JOGGED contains {min(jogged)!r}, which has no request; add it to _requests")


def _leave_out(rules: list[tuple[str, list[Rule]]], without: Collection[str]) -> None:
    known = [f"{group}: {rule.name}" for group, table in rules for rule in table]
    unknown = sorted(set(without) - set(known))
    if unknown:
        raise RuleError(f"unknown interlock rule {unknown[0]!r}; known: {', '.join(known)}")
    for group, table in rules:
        table[:] = [rule for rule in table if f"{group}: {rule.name}" not in without]


def _requests(tags: Tags, sequences: list[Sequence]) -> Block:
    """Return the block that combines the requests of steps and of manual mode."""
    jogs = tags.machine.jogs
    jogged = {arm.want[name]: jogs[f"{side}.{name}"] for side, arm in tags.arms.items() for name in arm.want}
    jogged[tags.tray.want_run] = jogs["tray_run"]
    steps = requests(sequences)
    wanted = dict.fromkeys((*steps, *jogged))
    return Block(
        "requests",
        tuple(Out(bit, when=any_of(*steps.get(bit, ()), jogged.get(bit, FALSE))) for bit in wanted),
    )
