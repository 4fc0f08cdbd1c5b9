"""Interlocks in the complete program: no forbidden output from any state, and a rule number for each blocked output."""

from __future__ import annotations

import itertools
from random import Random

import pytest

from controller.core.devices import ANNUNCIATORS
from controller.core.scan import Plc
from controller.program.operator.commands import JOGGED
from controller.program.states import MOVING, Mode, State
from controller.program.tags import IN_PLACE, ROWS, SIDES, Side
from tests.controller.program.interlock_scene import COILS, MACHINE, PLACES, SWITCHES, TAGS, Scene, forbidden, tag_of
from tests.plant_sim.twin.routes import run_to
from tests.plant_sim.twin.twin_rig import arm_of, switched_on, tags_of, until_picking
from tests.sampling import first_of

GOING_IN = {"lift_down", "claws_converged"}
"""Switches that must be on to move inward."""
OVER_THE_CUPS = {"lift_up", "slide_at_feed"}
"""Switches that must be on to spread."""


def anything(random: Random, plc: Plc) -> None:
    """Write random steps, arm data and machine state; in half of the cases with empty arms and a tray in place."""
    ordinary = random.random() < 0.5
    for sequence in MACHINE.program.sequences():
        bits = [bit for bit, _ in sequence]
        on = random.sample(bits, 0 if ordinary and sequence is MACHINE.feeder else random.choice((0, 1, 1, 1, 2)))
        if ordinary and sequence in MACHINE.cycles.values() and random.random() < 0.15:
            on = [sequence["approach row"]]  # permitted in few of the situations
        for bit in bits:
            plc.write(bit, bit in on)
    for side in SIDES:
        arm = TAGS.arms[side]
        for bit in (arm.loaded, arm.claws_closed, arm.clamped, arm.in_centre, arm.discard, arm.retried):
            plc.write(bit, not ordinary and random.random() < 0.5)
        plc.write(arm.passed, not ordinary and random.random() < 0.5)
        for bit in (arm.lift_travelled, arm.slide_travelled, arm.belt_travelled):
            plc.write(bit, random.random() < 0.8)
        for bit in arm.reached.values():
            plc.write(bit, ordinary or random.random() < 0.8)
        for row in ROWS:
            plc.write(arm.rows[row], random.choice((0, 0, 1, 2, 3)))
    plc.write(TAGS.tray.phase, IN_PLACE if ordinary else random.randrange(4))
    plc.write(TAGS.tray.place_known, ordinary or random.random() < 0.5)
    plc.write(TAGS.tray.ask, random.random() < 0.1)
    plc.write(TAGS.sp.arms_may_meet, random.random() < 0.2)
    plc.write(TAGS.machine.state, random.choice((*MOVING, *MOVING, *State)))
    plc.write(TAGS.machine.mode, random.choice([mode for mode in Mode if mode is not Mode.MANUAL]))
    if random.random() < 0.5:
        jog_any(random, plc)
    for number in ANNUNCIATORS:
        plc.memory.S[number] = random.random() < 0.003


def jog_any(random: Random, plc: Plc) -> None:
    """Put the machine in manual mode and jog a randomly chosen output."""
    machine = TAGS.machine
    plc.write(machine.mode, Mode.MANUAL)
    plc.write(machine.state, State.EXECUTE)
    plc.write(machine.jogging, 1)
    plc.write(machine.jog, 1 + random.randrange(len(JOGGED)))


def any_inputs(random: Random) -> list[bool]:
    """Return random terminal levels, usually with both stop buttons released and one switch of each device on."""
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
    """Return True if each confirmed position matches the switches and the row relays match the wanted row."""
    arm = TAGS.arms[side]
    sensed = {tag.partition(".")[2] for tag in scene.sensed if tag.startswith(f"{side}.")}
    places = PLACES[side] | {f"slide_at_pick_{row}": place for row, place in arm.at_pick.items()}
    believed = [(switches, name) for switches in SWITCHES for name in switches if scene.has(places[name])]
    wanted = [row for row in ROWS if scene.has(arm.row_is[row])]
    at_row = any(scene.has(arm.at_pick[row]) for row in wanted)
    passed = bool(scene.has(arm.passed)) or not at_row
    alone = all(sensed & {*switches} == {name} for switches, name in believed)
    return alone and len(wanted) <= 1 and bool(scene.has(arm.at_wanted_row)) == at_row and passed


@pytest.mark.parametrize(("situations", "seed"), first_of([(3_000, 9), (6_000, 9), (16_000, 1)]))
def test_nothing_forbidden_is_on_from_any_state_of_the_complete_program(situations: int, seed: int) -> None:
    """No forbidden output is on in random situations; every coil is turned on by steps and by jogging."""
    random, plc, now_ms = Random(seed), Plc(MACHINE.program, input_filter_ms=0), 0
    plc.scan(now_ms, MACHINE.io_map.safe_inputs())
    times_on = {(tag_of(side, output), is_jogged): 0 for side, output in COILS for is_jogged in (False, True)}
    for _ in range(situations):
        now_ms += random.choice((10, 100, 3_000))
        anything(random, plc)
        plc.scan(now_ms, any_inputs(random))
        scene = Scene(plc)
        assert forbidden(scene) == []
        assert all(knows_its_place(scene, side) for side in SIDES)
        for tag in scene.on & {*TAGS.moving}:
            times_on[tag, bool(scene.has(TAGS.machine.jogging))] += 1
    assert min(times_on.values()) >= 3, times_on


# blocking rules by number


def number_of(name: str) -> int:
    """Return the number of a rule of an arm."""
    return next(rule.number for rule in MACHINE.rules["left"] if rule.name == name)


def test_rules_are_numbered_in_the_order_of_their_table_and_equally_for_both_arms() -> None:
    numbers = {side: {rule.name: rule.number for rule in rules} for side, rules in MACHINE.rules.items()}
    assert numbers["left"] == numbers["right"]
    assert list(numbers["left"].values()) == list(range(1, 1 + len(MACHINE.rules["left"])))
    assert [rule.number for rule in MACHINE.tray_rules] == list(range(1, 1 + len(MACHINE.tray_rules)))


@pytest.mark.parametrize("side", SIDES)
def test_a_blocked_output_reports_its_rule_while_it_is_requested(side: Side) -> None:
    """If the tray edge is lost during inward motion, `blocked_by` contains the number of the blocking rule."""
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
    assert twin.plc.read(blocked_by) == number_of("inward ready"), "the first of the two rules in the table"
    lift_down.stuck = beam.stuck = None
    twin.run_for(100)
    assert f"{side}.slide_inward" in twin.outputs()
    assert twin.plc.read(blocked_by) == 0


def test_the_tray_has_its_own_rule_numbers() -> None:
    """If an arm leaves feed while the tray runs, the tray stops and its `blocked_by` contains the rule number."""
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
