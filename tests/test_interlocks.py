"""Interlocks: what must never be on together is never on, whatever is requested, and every rule is needed.

The output block alone runs on a bare PLC without a plant, so that any request and any input can be forced.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cache
from random import Random

import pytest

from controller.core.devices import ANNUNCIATORS
from controller.core.expr import And, Bit, Compare, Const, Expr, Not, Or, Word, all_of, leaves
from controller.core.program import Program
from controller.core.rungs import written_devices
from controller.core.scan import Plc
from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE, Rule, granted, output_block
from controller.program.machine import OUTPUTS, build
from controller.program.modes import MOVING, State
from controller.program.tags import ARM_OUTPUTS, IN_PLACE, ROWS, SIDES, Side

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
TAGS = MACHINE.tags
TRAY_OUTPUTS = ("tray_run", "tray_forward")
COILS = [*((side, output) for side in SIDES for output in ARM_OUTPUTS), *((None, output) for output in TRAY_OUTPUTS)]
RULES = [
    (side, rule, output)
    for side, rules in [*MACHINE.rules.items(), (None, MACHINE.tray_rules)]
    for rule in rules
    for output in rule.outputs
]

Device = Bit | Word
Stimulus = dict[Device, int]


# any condition, made true


def known(expr: Expr, stimulus: Stimulus) -> bool | None:
    """Evaluate a condition as far as its devices are decided; None = still open."""
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
    """Yield what a device may be: a bit both, a word every number it is compared with, and another."""
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
    """Return devices for which a condition is true, or None if there are none: all combinations are tried."""
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
    """Return the whole condition of a coil."""
    return granted(request_of(side, output), output, rules_of(side))


def outputs_alone(without: Rule | None = None) -> Plc:
    """Return a PLC that runs nothing but the output block, if wanted without one of its rules."""
    rules = {side: [rule for rule in MACHINE.rules[side] if rule is not without] for side in SIDES}
    rules_tray = [rule for rule in MACHINE.tray_rules if rule is not without]
    block = output_block(TAGS, MACHINE.io_map, rules, rules_tray)
    return Plc(Program("outputs", (block,), outputs=OUTPUTS), input_filter_ms=0)


def outputs_on(plc: Plc, stimulus: Stimulus) -> set[str]:
    """Force devices, scan, and return the tags of the outputs that are on."""
    for device, value in stimulus.items():
        plc.write(device, value)
    x_levels = plc.memory.X[: MACHINE.io_map.input_count]
    image = plc.scan(0, x_levels)
    return {point.tag for point in MACHINE.io_map.outputs if point.active(image[point.number])}


def tag_of(side: Side | None, output: str) -> str:
    return f"{side}.{output}" if side else output


# what must never be, in words of the machine and not of the rules


class Scene:
    """Memory after a scan, asked in plain words."""

    def __init__(self, plc: Plc) -> None:
        self._plc = plc
        memory, io_map = plc.memory, MACHINE.io_map
        self.on = {point.tag for point in io_map.outputs if point.active(memory.Y[point.number])}
        self.sensed = {point.tag for point in io_map.inputs if point.active(memory.X[point.number])}

    def has(self, device: Device) -> int:
        return self._plc.read(device)


def forbidden(scene: Scene) -> list[str]:
    """Return what is on and must not be."""
    found = [f"{side}: {text}" for side in SIDES for text, wrong in arm_forbidden(scene, side) if wrong]
    return found + [f"tray: {text}" for text, wrong in tray_forbidden(scene) if wrong]


def arm_forbidden(scene: Scene, side: Side) -> list[tuple[str, bool]]:
    arm, other = TAGS.arms[side], TAGS.other(side)
    on = {output for output in ARM_OUTPUTS if f"{side}.{output}" in scene.on}
    sensed = {tag.partition(".")[2] for tag in scene.sensed if tag.startswith(f"{side}.")}
    loaded, closed, clamped = (bool(scene.has(bit)) for bit in (arm.loaded, arm.claws_closed, arm.clamped))
    at_row, for_row_3 = scene.has(arm.at_wanted_row), scene.has(arm.row_is[3])
    putting_back = scene.has(MACHINE.homings[side]["put back"])
    down, up, feed = ("lift_down" in sensed), ("lift_up" in sensed), ("slide_at_feed" in sensed)
    stands = scene.has(TAGS.tray.phase) == IN_PLACE and "tray_front_edge" in scene.sensed
    centre_taken = for_row_3 and scene.has(other.in_centre) and not scene.has(TAGS.sp.arms_may_meet)
    return [
        *((f"{one} against {two}", {one, two} <= on) for one, two in (SLIDE, LIFT, BELT, CLAWS)),
        ("in emergency stop", bool(on) and "emergency_stop" in scene.sensed),
        ("without leave to move", bool(on) and not scene.has(TAGS.machine.motion)),
        ("with a fault of the arm", bool(on) and bool(scene.has(arm.fault))),
        ("the arm moves with the belt", bool(on & {*SLIDE, *LIFT}) and bool(on & {*BELT})),
        ("inward, not down", "slide_inward" in on and not down),
        ("inward, closed or loaded", "slide_inward" in on and (closed or loaded)),
        ("inward, not converged", "slide_inward" in on and "claws_converged" not in sensed),
        ("inward without a tray", "slide_inward" in on and not stands),
        ("inward over a tray about to move", "slide_inward" in on and tray_is_wanted(scene)),
        ("inward past the row", "slide_inward" in on and bool(at_row)),
        ("inward into the other arm", "slide_inward" in on and bool(centre_taken)),
        ("outward in between", "slide_outward" in on and not up and not down),
        ("outward low, closed or loaded", "slide_outward" in on and not up and (closed or loaded)),
        ("up half closed", "lift_retract" in on and not feed and closed and not clamped),
        ("down away from feed", "lift_extend" in on and not feed),
        ("spread away from feed or not up", "spread" in on and not (up and feed)),
        ("converge away from feed or loaded", "converge" in on and (loaded or not feed)),
        ("close nowhere", "claws_close" in on and not feed and not (at_row and down)),
        ("drop the load from above", "claws_open" in on and loaded and not down),
        ("drop the load beside the cups", "claws_open" in on and loaded and feed and "claws_spread" not in sensed),
        ("drop the load on the way", "claws_open" in on and loaded and not feed and not putting_back),
    ]  # fmt: skip


def tray_forbidden(scene: Scene) -> list[tuple[str, bool]]:
    on = bool(scene.on & {*TRAY_OUTPUTS})
    at_feed = all(f"{side}.slide_at_feed" in scene.sensed for side in SIDES)
    entering = any(scene.has(arm.want["slide_inward"]) for arm in TAGS.arms.values())
    return [
        ("in emergency stop", on and "emergency_stop" in scene.sensed),
        ("without leave to move", on and not scene.has(TAGS.machine.motion)),
        ("with an arm away from feed", on and not at_feed),
        ("with an arm about to go in", on and entering),
        ("with a fault of the feeder", on and bool(scene.has(TAGS.tray.fault))),
        ("run without its direction", "tray_run" in scene.on and "tray_forward" not in scene.on),
    ]


def tray_is_wanted(scene: Scene) -> bool:
    return bool(scene.has(TAGS.tray.want_run) or scene.has(TAGS.tray.want_creep))


# the tests


@cache
def allowing() -> list[Stimulus]:
    """Return for every coil a stimulus that turns it on, with every other device it reads decided."""
    found = []
    for side, output in COILS:
        condition = coil(side, output)
        stimulus = example(condition)
        assert stimulus is not None, f"{tag_of(side, output)} can never be on"
        found.append(dict.fromkeys(leaves(condition), 0) | stimulus)
    return found


@pytest.mark.parametrize(("side", "output"), COILS)
def test_every_coil_can_be_on(side: Side | None, output: str) -> None:
    stimulus = allowing()[COILS.index((side, output))]
    assert tag_of(side, output) in outputs_on(outputs_alone(), stimulus)


@pytest.mark.parametrize("index", range(len(COILS)), ids=[tag_of(*name) for name in COILS])
def test_no_two_changes_of_what_turns_a_coil_on_make_anything_forbidden(index: int) -> None:
    """Every single device and every pair of devices is changed, in everything that any coil depends on."""
    plc = outputs_alone()
    base = every_device() | allowing()[index]
    devices = list(every_device())
    for changed in itertools.chain([()], itertools.combinations(devices, 1), itertools.combinations(devices, 2)):
        stimulus = base | {device: changed_value(device, base[device]) for device in changed}
        outputs_on(plc, stimulus)
        assert forbidden(Scene(plc)) == [], [f"{device} {device.name}" for device in changed]


@cache
def every_device() -> Stimulus:
    """Return every device that the coils read, off."""
    return {device: 0 for side, output in COILS for device in leaves(coil(side, output))}


def changed_value(device: Device, value: int) -> int:
    if isinstance(device, Bit):
        return 1 - value
    return 0 if value else 1


@pytest.mark.parametrize(
    ("side", "rule", "output"), RULES, ids=[f"{tag_of(side, output)}: {rule.name}" for side, rule, output in RULES]
)
def test_every_rule_is_needed(side: Side | None, rule: Rule, output: str) -> None:
    """Without it, and with all others, there is something that turns the coil on and must not."""
    others = [other.allow for other in rules_of(side) if other is not rule and output in other.outputs]
    stimulus = example(all_of(request_of(side, output), *others, ~rule.allow))
    assert stimulus is not None, "the other rules already see to it"
    assert tag_of(side, output) not in outputs_on(outputs_alone(), stimulus)
    assert tag_of(side, output) in outputs_on(outputs_alone(without=rule), stimulus)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("one", "two"), [order for pair in (SLIDE, LIFT, BELT, CLAWS) for order in (pair, pair[::-1])])
def test_no_combination_at_all_turns_on_a_coil_while_its_opposite_is_wanted(side: Side, one: str, two: str) -> None:
    assert example(all_of(coil(side, one), request_of(side, two))) is None


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


def test_nothing_comes_after_the_output_block_but_the_end_of_the_presses() -> None:
    assert [block.title for block in MACHINE.program.blocks[-2:]] == [OUTPUTS, "commands consumed"]


# the whole program, from any state whatever


def anything(random: Random, plc: Plc) -> None:
    """Force steps, retained memory and state at random; half the time with empty arms over a tray that stands."""
    ordinary = random.random() < 0.5
    for sequence in MACHINE.program.sequences():
        bits = [bit for bit, _ in sequence]
        on = random.sample(bits, 0 if ordinary and sequence is MACHINE.feeder else random.choice((0, 1, 1, 1, 2)))
        for bit in bits:
            plc.write(bit, bit in on)
    for side in SIDES:
        arm = TAGS.arms[side]
        for bit in (arm.loaded, arm.claws_closed, arm.clamped, arm.in_centre, arm.discard, arm.retried):
            plc.write(bit, not ordinary and random.random() < 0.5)
        for row in ROWS:
            plc.write(arm.rows[row], random.choice((0, 0, 1, 2, 3)))
    plc.write(TAGS.tray.phase, IN_PLACE if ordinary else random.randrange(4))
    plc.write(TAGS.sp.arms_may_meet, random.random() < 0.2)
    plc.write(TAGS.machine.state, random.choice((*MOVING, *MOVING, *State)))
    for number in ANNUNCIATORS:
        plc.memory.S[number] = random.random() < 0.003


def any_inputs(random: Random) -> list[bool]:
    """Return terminal levels at random, the two stops mostly not pressed."""
    levels = MACHINE.io_map.safe_inputs()
    for point in MACHINE.io_map.inputs:
        share = 0.05 if point.tag in {"stop", "emergency_stop"} else 0.6
        levels[point.number] = point.level(random.random() < share)
    return levels


def knows_its_row(scene: Scene, side: Side) -> bool:
    """Tell whether one row at most is wanted, and the arm is at it when its switch says so."""
    arm = TAGS.arms[side]
    wanted = [row for row in ROWS if scene.has(arm.row_is[row])]
    at_row = [row for row in wanted if f"{side}.slide_at_pick_{row}" in scene.sensed]
    return len(wanted) <= 1 and bool(scene.has(arm.at_wanted_row)) == bool(at_row)


def test_nothing_forbidden_is_on_from_any_state_of_the_whole_program() -> None:
    """Twelve thousand situations, most of which cannot be; every coil is on in some of them."""
    random, plc, now_ms = Random(1), Plc(MACHINE.program, input_filter_ms=0), 0
    plc.scan(now_ms, MACHINE.io_map.safe_inputs())
    times_on = dict.fromkeys((tag_of(side, output) for side, output in COILS), 0)
    for _ in range(12_000):
        now_ms += random.choice((10, 100, 3_000))
        anything(random, plc)
        plc.scan(now_ms, any_inputs(random))
        scene = Scene(plc)
        assert forbidden(scene) == []
        assert all(knows_its_row(scene, side) for side in SIDES)
        for tag in scene.on:
            times_on[tag] += 1
    assert min(times_on.values()) >= 10, times_on


# rules as a table


def test_every_rule_says_why_and_governs_outputs_that_exist() -> None:
    for side, rule, output in RULES:
        assert rule.name
        assert rule.reason
        assert (side, output) in COILS, f"{rule.name}: {output}"


@pytest.mark.parametrize(("side", "output"), COILS)
def test_every_output_obeys_the_emergency_stop_and_its_fault(side: Side | None, output: str) -> None:
    names = {rule.name for rule in rules_of(side) if output in rule.outputs}
    assert names >= {"motion allowed", "no fault of the arm" if side else "no fault of the feeder"}
