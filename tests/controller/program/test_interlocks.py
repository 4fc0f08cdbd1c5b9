"""Interlocks: no request turns on a forbidden combination of outputs, and every rule is needed.

The output block runs alone on a bare PLC without a plant, so that any request and any input can be forced. The
complete program is tested in test_interlocks_program.py.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cache

import pytest

from controller.core.expr import And, Bit, Compare, Const, Expr, Not, Or, Word, all_of, leaves
from controller.core.program import Program
from controller.core.rungs import written_devices
from controller.core.scan import Plc
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE, Rule, granted, output_block
from controller.program.machine import OUTPUTS
from controller.program.operator.commands import JOGGED
from controller.program.tags import SIDES, Side
from tests.controller.program.interlock_scene import COILS, MACHINE, TAGS, BlockScene, Device, forbidden, tag_of
from tests.sampling import first_of

RULES = [
    (side, rule, output)
    for side, rules in [*MACHINE.rules.items(), (None, MACHINE.tray_rules)]
    for rule in rules
    for output in rule.outputs
]

RIGHT_LAST = sorted(range(len(COILS)), key=lambda index: COILS[index][0] == "right")
"""Indexes of the coils; those of the right arm, whose program is the same as that of the left arm, are the last."""
LEFT_AND_TRAY = sum(side != "right" for side, _ in COILS)

Stimulus = dict[Device, int]


# satisfying a condition


def known(expr: Expr, stimulus: Stimulus) -> bool | None:
    """Evaluate a condition whose devices may have no value yet; return None if the result is undecided."""
    match expr:
        case Const(value):
            return value
        case Bit():
            return None if expr not in stimulus else bool(stimulus[expr])
        case Compare(relation, left, int(right)):
            assert relation in {"==", "!="}
            return None if left not in stimulus else (stimulus[left] == right) == (relation == "==")
        case Not(operand):
            inner = known(operand, stimulus)
            return None if inner is None else not inner
        case And(operands) | Or(operands):
            decides = isinstance(expr, Or)
            values = [known(operand, stimulus) for operand in operands]
            return decides if decides in values else None if None in values else not decides
    raise TypeError(f"not a condition of the output block: {expr!r}")


def values_of(device: Device, expr: Expr) -> Iterator[int]:
    """Yield both values of a bit, or all numbers with which a word is compared, followed by their maximum plus 1."""
    if isinstance(device, Bit):
        yield from (0, 1)
        return
    numbers = {right for left, right in comparisons(expr) if left == device}
    yield from (*sorted(numbers), max(numbers) + 1)


def comparisons(expr: Expr) -> Iterator[tuple[Word, int]]:
    match expr:
        case Compare(_, left, int(right)):
            yield left, right
        case Not(operand):
            yield from comparisons(operand)
        case And(operands) | Or(operands):
            for operand in operands:
                yield from comparisons(operand)


def example(expr: Expr, stimulus: Stimulus | None = None) -> Stimulus | None:
    """Return device values that make a condition true, or None if an exhaustive search finds none."""
    stimulus = stimulus or {}
    value = known(expr, stimulus)
    if value is not None:
        return stimulus if value else None
    device = next(device for device in leaves(expr) if device not in stimulus)
    for number in values_of(device, expr):
        found = example(expr, stimulus | {device: number})
        if found is not None:
            return found
    return None


# the output block on a bare PLC


def request_of(side: Side | None, output: str) -> Expr:
    if side is not None:
        return TAGS.arms[side].want[output]
    tray = TAGS.tray
    return tray.want_run | (tray.want_creep & ~tray.t_on.done if output == "tray_run" else tray.want_creep)


def rules_of(side: Side | None) -> list[Rule]:
    return MACHINE.tray_rules if side is None else MACHINE.rules[side]


def coil(side: Side | None, output: str) -> Expr:
    """Return the complete condition of a coil."""
    return granted(request_of(side, output), output, rules_of(side))


def outputs_alone(without: Rule | None = None) -> Plc:
    """Return a PLC that runs only the output block, optionally without one of its rules."""
    rules = {side: [rule for rule in MACHINE.rules[side] if rule is not without] for side in SIDES}
    rules_tray = [rule for rule in MACHINE.tray_rules if rule is not without]
    block = output_block(TAGS, MACHINE.io_map, rules, rules_tray, MACHINE.other_rules)
    return Plc(Program("outputs", (block,), outputs=OUTPUTS), input_filter_ms=0)


def outputs_on(plc: Plc, stimulus: Stimulus) -> set[str]:
    """Force devices, scan, and return the tags of the active outputs."""
    for device, value in stimulus.items():
        plc.write(device, value)
    x_levels = plc.memory.X[: MACHINE.io_map.input_count]
    image = plc.scan(0, x_levels)
    return {point.tag for point in MACHINE.io_map.outputs if point.active(image[point.number])}


# the tests


@cache
def allowing() -> list[Stimulus]:
    """Return, for each coil, a stimulus that turns it on and gives a value to every device in its condition."""
    found = []
    for side, output in COILS:
        condition = coil(side, output)
        stimulus = example(condition)
        assert stimulus is not None, f"{tag_of(side, output)} is never on"
        found.append(dict.fromkeys(leaves(condition), 0) | stimulus)
    return found


@pytest.mark.parametrize(("side", "output"), COILS)
def test_every_coil_can_be_on(side: Side | None, output: str) -> None:
    stimulus = allowing()[COILS.index((side, output))]
    assert tag_of(side, output) in outputs_on(outputs_alone(), stimulus)


@pytest.mark.parametrize("index", first_of(RIGHT_LAST, LEFT_AND_TRAY // 4), ids=lambda index: tag_of(*COILS[index]))
def test_no_one_or_two_changes_to_an_allowed_situation_allow_a_forbidden_one(index: int) -> None:
    """In a situation in which a coil is on, changing one or two devices never results in a forbidden combination."""
    plc = outputs_alone()
    base = dict.fromkeys(every_device(), 0) | allowing()[index]
    changes = [(device, value) for device, values in every_device().items() for value in values - {base[device]}]
    for changed in itertools.chain([()], itertools.combinations(changes, 1), itertools.combinations(changes, 2)):
        outputs_on(plc, base | dict(changed))
        assert forbidden(BlockScene(plc)) == [], [f"{device} {device.name}: {value}" for device, value in changed]


@cache
def every_device() -> dict[Device, set[int]]:
    """Return every device that the coils read, with its test values."""
    found: dict[Device, set[int]] = {}
    for condition in (coil(side, output) for side, output in COILS):
        for device in leaves(condition):
            found.setdefault(device, {0}).update(values_of(device, condition))
    return found


@pytest.mark.parametrize(
    ("side", "rule", "output"), RULES, ids=[f"{tag_of(side, output)}: {rule.name}" for side, rule, output in RULES]
)
def test_every_rule_is_needed(side: Side | None, rule: Rule, output: str) -> None:
    """If only this rule is removed, the coil is on in a situation in which the rule forbids it."""
    others = [other.allow for other in rules_of(side) if other is not rule and output in other.outputs]
    stimulus = example(all_of(request_of(side, output), *others, ~rule.allow))
    assert stimulus is not None, "already prevented by the other rules"
    assert tag_of(side, output) not in outputs_on(outputs_alone(), stimulus)
    assert tag_of(side, output) in outputs_on(outputs_alone(without=rule), stimulus)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("one", "two"), [order for pair in (SLIDE, LIFT, BELT, CLAWS) for order in (pair, pair[::-1])])
def test_no_combination_turns_on_a_coil_while_its_opposite_is_requested(side: Side, one: str, two: str) -> None:
    assert example(all_of(coil(side, one), request_of(side, two))) is None


@pytest.mark.parametrize("side", SIDES)
def test_no_combination_opens_claws_with_a_row_at_a_forbidden_position(side: Side) -> None:
    """For all combinations of positions, steps and commands, a loaded arm opens its claws only where permitted."""
    plc, arm, machine = outputs_alone(), TAGS.arms[side], TAGS.machine
    cycle, home = MACHINE.cycles[side], MACHINE.homings[side]
    bits = (
        arm.at_feed,
        arm.down,
        arm.is_spread,
        arm.row_in_progress,
        arm.at_wanted_row,
        arm.discard,
        cycle["open claws"],
        home["put back"],
        home["open at feed"],
    )
    base = allowing()[COILS.index((side, "claws_open"))] | {arm.loaded: 1, machine.motion: 1}
    opened = 0
    for jog, *values in itertools.product((0, 1 + JOGGED.index(f"{side}.claws_open")), *[(0, 1)] * len(bits)):
        opened += f"{side}.claws_open" in outputs_on(
            plc, base | {machine.jog: jog} | dict(zip(bits, values, strict=True))
        )
        assert forbidden(BlockScene(plc)) == [], (jog, values)
    assert opened > 100


def test_only_the_output_block_writes_y_and_every_wire_once() -> None:
    writers: dict[Bit, list[str]] = {}
    for block in MACHINE.program.blocks:
        for rung in block.rungs():
            for device in written_devices(rung):
                if device.kind == "Y":
                    assert isinstance(device, Bit)
                    writers.setdefault(device, []).append(block.title)
    assert {device.number: titles for device, titles in writers.items()} == {
        point.number: [OUTPUTS] for point in MACHINE.io_map.outputs
    }


def test_only_bookkeeping_blocks_follow_the_output_block() -> None:
    assert [block.title for block in MACHINE.program.blocks[-4:]] == [
        OUTPUTS,
        "coil memory",
        "refused requests",
        "commands consumed",
    ]


# rules as a table


def test_every_rule_has_a_reason_and_existing_outputs() -> None:
    for side, rule, output in RULES:
        assert rule.name
        assert rule.reason
        assert (side, output) in COILS, f"{rule.name}: {output}"


@pytest.mark.parametrize(("side", "output"), COILS)
def test_every_output_obeys_the_emergency_stop_and_its_fault(side: Side | None, output: str) -> None:
    names = {rule.name for rule in rules_of(side) if output in rule.outputs}
    assert names >= {"motion allowed", "no arm fault" if side else "no feeder fault"}
