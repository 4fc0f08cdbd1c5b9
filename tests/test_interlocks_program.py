"""Interlocks in the whole program: nothing forbidden from any state whatever, and every refusal has a number."""

from __future__ import annotations

import itertools
from random import Random

import pytest
from interlock_scene import COILS, MACHINE, PLACES, SWITCHES, TAGS, Scene, forbidden, tag_of
from routes import run_to
from twin_rig import arm_of, switched_on, tags_of, until_picking

from controller.core.devices import ANNUNCIATORS
from controller.core.scan import Plc
from controller.program.commands import JOGGED
from controller.program.states import MOVING, Mode, State
from controller.program.tags import IN_PLACE, ROWS, SIDES, Side

GOING_IN = {"lift_down", "claws_converged"}
"""Places that an arm must be in to go inward."""
OVER_THE_CUPS = {"lift_up", "slide_at_feed"}
"""And to spread."""


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
        plc.write(arm.passed, not ordinary and random.random() < 0.5)
        for bit in (arm.lift_travelled, arm.slide_travelled, arm.belt_travelled):
            plc.write(bit, random.random() < 0.8)
        for row in ROWS:
            plc.write(arm.rows[row], random.choice((0, 0, 1, 2, 3)))
    plc.write(TAGS.tray.phase, IN_PLACE if ordinary else random.randrange(4))
    plc.write(TAGS.tray.ask, random.random() < 0.1)
    plc.write(TAGS.sp.arms_may_meet, random.random() < 0.2)
    plc.write(TAGS.machine.state, random.choice((*MOVING, *MOVING, *State)))
    plc.write(TAGS.machine.mode, random.choice([mode for mode in Mode if mode is not Mode.MANUAL]))
    if random.random() < 0.5:
        hold_by_hand(random, plc)
    for number in ANNUNCIATORS:
        plc.memory.S[number] = random.random() < 0.003


def hold_by_hand(random: Random, plc: Plc) -> None:
    """Put the machine in manual mode with any output held."""
    machine = TAGS.machine
    plc.write(machine.mode, Mode.MANUAL)
    plc.write(machine.state, State.EXECUTE)
    plc.write(machine.jogging, 1)
    plc.write(machine.jog, 1 + random.randrange(len(JOGGED)))


def any_inputs(random: Random) -> list[bool]:
    """Return terminal levels at random, the two stops mostly not pressed, most devices in one place at a time."""
    levels = MACHINE.io_map.safe_inputs()
    for point in MACHINE.io_map.inputs:
        share = 0.05 if point.tag in {"stop", "emergency_stop"} else 0.6
        levels[point.number] = point.level(random.random() < share)
    ordinary = random.choice((set(), GOING_IN, OVER_THE_CUPS))
    for side, switches in itertools.product(SIDES, SWITCHES):
        if ordinary or random.random() < 0.8:
            place = random.choice([name for name in switches if name in ordinary] or switches)
            for name in switches:
                point = MACHINE.io_map[f"{side}.{name}"]
                levels[point.number] = point.level(name == place)
    return levels


def knows_its_place(scene: Scene, side: Side) -> bool:
    """Tell whether the arm is believed in no place whose switch is not on alone, and knows its row by that."""
    arm = TAGS.arms[side]
    sensed = {tag.partition(".")[2] for tag in scene.sensed if tag.startswith(f"{side}.")}
    places = PLACES[side] | {f"slide_at_pick_{row}": place for row, place in arm.at_pick.items()}
    believed = [(switches, name) for switches in SWITCHES for name in switches if scene.has(places[name])]
    wanted = [row for row in ROWS if scene.has(arm.row_is[row])]
    at_row = any(scene.has(arm.at_pick[row]) for row in wanted)
    passed = bool(scene.has(arm.passed)) or not at_row
    alone = all(sensed & {*switches} == {name} for switches, name in believed)
    return alone and len(wanted) <= 1 and bool(scene.has(arm.at_wanted_row)) == at_row and passed


def test_nothing_forbidden_is_on_from_any_state_of_the_whole_program() -> None:
    """Sixteen thousand situations, most of which cannot be; every coil is on in some of them, by step and by hand."""
    random, plc, now_ms = Random(1), Plc(MACHINE.program, input_filter_ms=0), 0
    plc.scan(now_ms, MACHINE.io_map.safe_inputs())
    times_on = {(tag_of(side, output), by_hand): 0 for side, output in COILS for by_hand in (False, True)}
    for _ in range(16_000):
        now_ms += random.choice((10, 100, 3_000))
        anything(random, plc)
        plc.scan(now_ms, any_inputs(random))
        scene = Scene(plc)
        assert forbidden(scene) == []
        assert all(knows_its_place(scene, side) for side in SIDES)
        for tag in scene.on:
            times_on[tag, bool(scene.has(TAGS.machine.jogging))] += 1
    assert min(times_on.values()) >= 3, times_on


# what is refused, by number


def number_of(name: str) -> int:
    """Return the number of a rule about an arm."""
    return next(rule.number for rule in MACHINE.rules["left"] if rule.name == name)


def test_rules_are_numbered_in_the_order_of_their_table_alike_for_both_arms() -> None:
    numbers = {side: {rule.name: rule.number for rule in rules} for side, rules in MACHINE.rules.items()}
    assert numbers["left"] == numbers["right"]
    assert list(numbers["left"].values()) == list(range(1, 1 + len(MACHINE.rules["left"])))
    assert [rule.number for rule in MACHINE.tray_rules] == list(range(1, 1 + len(MACHINE.tray_rules)))


@pytest.mark.parametrize("side", SIDES)
def test_a_refused_output_names_its_rule_while_it_is_wanted(side: Side) -> None:
    """Given an arm that wants to go inward, when the tray's edge goes, the register says so until it is back."""
    twin = switched_on({"trays_target": 1})
    run_to("approach row")(twin, side)
    blocked_by = tags_of(twin, side).blocked_by
    assert f"{side}.slide_inward" in twin.outputs()
    assert twin.plc.read(blocked_by) == 0
    beam = twin.plant.conveyor.beam
    beam.stuck = False
    twin.run_for(100)
    assert f"{side}.slide_inward" not in twin.outputs()
    assert twin.plc.read(blocked_by) == number_of("tray in place")
    lift_down = arm_of(twin, side).sensors["lift_down"]
    lift_down.stuck = False
    twin.run_for(50)
    assert twin.plc.read(blocked_by) == number_of("inward ready"), "of two the first of the table"
    lift_down.stuck = beam.stuck = None
    twin.run_for(100)
    assert f"{side}.slide_inward" in twin.outputs()
    assert twin.plc.read(blocked_by) == 0


def test_the_tray_has_numbers_of_its_own() -> None:
    """Given the tray running between the arms, an arm that is not seen at feed any more stops it."""
    twin = switched_on({"trays_target": 2}, trays=2)
    twin.home()
    twin.start()
    until_picking(twin, "left", 3)
    twin.run_until(lambda: "tray_run" in twin.outputs(), within_ms=60_000, what="the tray leaves")
    tray = twin.machine.tags.tray
    assert twin.plc.read(tray.blocked_by) == 0
    arm_of(twin, "left").sensors["slide_at_feed"].stuck = False
    twin.run_for(50)
    assert "tray_run" not in twin.outputs()
    at_feed = next(rule.number for rule in MACHINE.tray_rules if rule.name == "arms at feed")
    assert twin.plc.read(tray.blocked_by) == at_feed
