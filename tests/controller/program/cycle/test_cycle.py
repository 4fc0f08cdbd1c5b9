"""One cycle of an arm: order of outputs, duration of each phase, cup count and use of the shared centre.

The bounds are calculated manually from machine.yaml. A stroke takes at least 15 ms for the valve, 4 ms for the tube,
and the travel time at the speed that the throttle permits. The upper bound adds the longest start delay, which is the
time that the air in front of the piston needs to vent through the throttle before the piston moves.
"""

from __future__ import annotations

from functools import cache
from statistics import fmean
from typing import NamedTuple

import pytest

from controller.events.kinds import CycleEvent
from controller.program.states import State
from controller.program.tags import ROWS, SIDES, TAKEN, Side
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.monitors import guard
from tests.plant_sim.twin.twin_rig import MACHINE, Change, ChangeRecorder, arm_of, at_work, tags_of, to_complete
from tests.sampling import first_of

CYLINDER_MS = 15 + 4
SLIDE_MM_S = 149.7  # 0.735e-9 m3/(s Pa) x 1e5 Pa / 490.9 mm2 of the 25 mm bore
UP_MS = CYLINDER_MS + 145 / 0.2088  # 4.1e-9 x 1e5 / 1963.5 mm2; from one end stop to 5 mm before the other
DOWN_MS = CYLINDER_MS + 145 / 0.2122  # 3.5e-9 x 1e5 / 1649.3 mm2
BELT_MS = 184 / 0.2  # from one end to 3 mm before the other
PICK_MM = {1: 192.5, 2: 235.5, 3: 278.5}  # 300 mm minus 107.5, 64.5 and 21.5
BAND_MM = 5.0
OVERSHOOT_MM = 1.0  # minimum, past the centre of a row switch
BUMPER_MM = 2.0  # travel prevented by the bumper at feed
RELEASE_DELAY_MS = 270  # 533 ms from the pulse until the cup is below the claws, less 250 to open and fall
LATE_MS = 45
"""Tolerance of a phase, ms: one scan for reading, one for filtering, and 2 mm more overshoot than the minimum."""
START_IN_MS = 760
"""Tolerance of inward travel, ms: 317 cm3 in front of the piston vent from 6.0 to 5.2 bar (35 N on 491 mm2).

Through 0.735e-9 m3/(s Pa) this takes 0.45 s; the rest is margin.
"""
START_OUT_MS = 350
"""Tolerance of outward travel, ms: the same calculation with 120 to 160 cm3."""
START_UP_MS = 430
"""Tolerance of lifting, ms: 339 cm3 vent from 5.9 to 4 bar (147 N arm weight, 60 N friction), plus the cushion."""
START_DOWN_MS = 100
"""Tolerance of lowering, ms: the weight assists the start; the cushion delays the end."""
BELT_START_MS = 60
"""Tolerance of the belt, ms: the motor runs up in 13 ms; relay and switch are updated once per scan."""


class Phase(NamedTuple):
    """Manually calculated time between two output changes, and its tolerance."""

    start: str
    end: str
    due_ms: float
    late_ms: int = LATE_MS


FIRST_HALF = [
    "+slide_inward",
    "-slide_inward",
    "+claws_close",
    "+lift_retract",
    "-claws_close",
    "+slide_outward",
    "-lift_retract",
    "-slide_outward",
    "+spread",
    "-spread",
    "+lift_extend",
    "-lift_extend",
    "+claws_open",
]
ORDER = {
    0: [*FIRST_HALF, "+converge", "-claws_open", "-converge"],
    1: [
        *FIRST_HALF,
        "+lift_retract",
        "-claws_open",
        "-lift_retract",
        "+converge",
        "-converge",
        "+lift_extend",
        "-lift_extend",
    ],
}


def phases(row: int) -> list[Phase]:
    in_mm = PICK_MM[row] - BAND_MM - BUMPER_MM
    out_mm = PICK_MM[row] + OVERSHOOT_MM - BAND_MM
    return [
        Phase("+slide_inward", "-slide_inward", CYLINDER_MS + in_mm / SLIDE_MM_S * 1000, START_IN_MS),
        Phase("-slide_inward", "+claws_close", 100),
        Phase("+claws_close", "+lift_retract", 200),
        Phase("+lift_retract", "+slide_outward", UP_MS, START_UP_MS),
        Phase("+slide_outward", "+spread", CYLINDER_MS + out_mm / SLIDE_MM_S * 1000 + 500, START_OUT_MS),
        Phase("+spread", "+lift_extend", BELT_MS, BELT_START_MS),
        Phase("+lift_extend", "-lift_extend", DOWN_MS, START_DOWN_MS),
    ]


AFTER_RELEASE = {
    0: [Phase("+claws_open", "+converge", 200), Phase("+converge", "-converge", BELT_MS, BELT_START_MS)],
    1: [
        Phase("+claws_open", "+lift_retract", 200),
        Phase("+lift_retract", "+converge", UP_MS, START_UP_MS),
        Phase("+converge", "+lift_extend", BELT_MS, BELT_START_MS),
        Phase("+lift_extend", "-lift_extend", DOWN_MS, START_DOWN_MS),
    ],
}


class Run(NamedTuple):
    """Recording of a run with one tray."""

    twin: Twin
    outputs: ChangeRecorder
    sensors: ChangeRecorder


def tray_run(
    converge_at: int = 0, descend_at_count: int = 0, cups_per_min: float = 45.0, *, sensed: bool = True
) -> Run:
    """Return a run; its sensors are recorded only if `sensed`, because the twin then runs in Python."""
    return _tray_run(converge_at, descend_at_count, cups_per_min, sensed=sensed)


@cache
def _tray_run(converge_at: int, descend_at_count: int, cups_per_min: float, *, sensed: bool) -> Run:
    parameters = MACHINE.with_values({"cups.planting_frequency_per_min": cups_per_min})
    set_points = {"trays_target": 1, "converge_at": converge_at, "descend_at_count": descend_at_count}
    twin = at_work(set_points, parameters=parameters)
    sensors = ChangeRecorder(
        twin,
        lambda twin: {
            f"{side}.{tag}" for side in SIDES for tag, sensor in arm_of(twin, side).sensors.items() if sensor.read()
        },
        None if sensed else (),
    )
    run = Run(twin, ChangeRecorder.of_outputs(twin), sensors)
    to_complete(twin)
    return run


def cycle_of(twin: Twin, side: Side, row: int) -> CycleEvent:
    return next(cycle for cycle in twin.cycles() if (cycle.side, cycle.row) == (side, row))


def signed(changes: list[Change]) -> dict[str, list[int]]:
    """Return the times of the changes, keyed by '+name' for on and '-name' for off."""
    times: dict[str, list[int]] = {}
    for change in changes:
        times.setdefault(("+" if change.on else "-") + change.name, []).append(change.at_ms)
    return times


def outputs_of(run: Run, side: Side, row: int) -> list[Change]:
    """Return the output changes of an arm in one cycle, excluding those that end the previous cycle."""
    cycle = cycle_of(run.twin, side, row)
    changes = run.outputs.of(f"{side}.", cycle.at_ms - cycle.cycle_ms, cycle.at_ms + 10)
    first = next(index for index, change in enumerate(changes) if change.on)
    return [change for change in changes[first:] if change.at_ms <= cycle.at_ms or not change.on]


def releases_ms(run: Run, side: Side) -> list[int]:
    """Return the times at which the claws released the row assumed at the start and rows 1 to 3 over the cups."""
    return signed(run.outputs.of(f"{side}."))["+claws_open"]


def cups_before(run: Run, side: Side, row: int, until_ms: int) -> list[int]:
    """Return the times of the cup edges from the release of the previous row to `until_ms`."""
    return signed(run.sensors.of(f"{side}.", releases_ms(run, side)[row - 1], until_ms))["+cup_pulse"]


EVERY_CYCLE = [(at, side, row) for at in (0, 1) for side in SIDES for row in ROWS]
every_cycle = pytest.mark.parametrize(("converge_at", "side", "row"), EVERY_CYCLE)
every_sensed_cycle = pytest.mark.parametrize(
    ("converge_at", "side", "row"), first_of(EVERY_CYCLE, len(EVERY_CYCLE) // 2)
)
"""The cycles that converge at the bottom by default; the outputs of the others are checked by default."""


@every_cycle
def test_outputs_switch_on_and_off_in_the_order_of_the_paper(converge_at: int, side: Side, row: int) -> None:
    changes = outputs_of(tray_run(converge_at, sensed=converge_at == 0), side, row)
    assert [("+" if change.on else "-") + change.name for change in changes] == ORDER[converge_at]


@every_cycle
def test_every_phase_is_within_its_bounds(converge_at: int, side: Side, row: int) -> None:
    changes = outputs_of(tray_run(converge_at, sensed=converge_at == 0), side, row)
    release = next(index for index, change in enumerate(changes) if change.name == "claws_open")
    for part, expected in ((changes[:release], phases(row)), (changes[release:], AFTER_RELEASE[converge_at])):
        times = signed(part)
        for phase in expected:
            took_ms = times[phase.end][0] - times[phase.start][0]
            assert phase.due_ms <= took_ms <= phase.due_ms + phase.late_ms, f"{phase}: {took_ms} ms"


@every_sensed_cycle
def test_claws_spread_half_a_second_after_arriving_at_feed(converge_at: int, side: Side, row: int) -> None:
    run = tray_run(converge_at)
    cycle = cycle_of(run.twin, side, row)
    span = (cycle.at_ms - cycle.cycle_ms + 1_000, cycle.at_ms)  # the arm has left feed by then
    arrived_ms = signed(run.sensors.of(f"{side}.", *span))["+slide_at_feed"][0]
    spread_ms = signed(run.outputs.of(f"{side}.", *span))["+spread"][0]
    assert 500 <= spread_ms - arrived_ms <= 520


@every_sensed_cycle
def test_the_claws_open_on_the_twelfth_cup_plus_the_release_delay(converge_at: int, side: Side, row: int) -> None:
    run = tray_run(converge_at)
    released_ms = releases_ms(run, side)[row]
    cups_ms = cups_before(run, side, row, released_ms)
    assert len(cups_ms) == 12
    assert RELEASE_DELAY_MS <= released_ms - cups_ms[-1] <= RELEASE_DELAY_MS + 20


def test_rows_are_taken_from_the_feed_inward_by_both_arms() -> None:
    twin = tray_run(0).twin
    for side in SIDES:
        assert [cycle.row for cycle in twin.cycles() if cycle.side == side] == [1, 2, 3]


# minimum cycle time


@pytest.mark.parametrize(
    ("row_spacing_m", "expected_ms", "mean_ms"),
    [(0.600, {1: 8_300, 2: 8_800, 3: 9_400}, 9_000), (0.800, {1: 9_700, 2: 10_200, 3: 10_800}, 10_400)],
)
def test_cycle_time_without_waiting_for_cups(row_spacing_m: float, expected_ms: dict[int, int], mean_ms: int) -> None:
    """Each cycle time is within 0.1 s of the expected time; the mean at 600 mm row spacing is at most 9 s.

    At a row spacing of 800 mm, each slide stroke is 100 mm longer, which adds 668 ms. For row 1 the slide starts from
    its end stop, where homing has filled the cylinder, and the air in front of the piston takes 0.3 s to vent.
    """
    parameters = MACHINE.with_values({"layout.row_spacing_m": row_spacing_m})
    twin = at_work({"trays_target": 1}, parameters=parameters)
    to_complete(twin)
    assert len(twin.cycles()) == 6
    for cycle in twin.cycles():
        moving_ms = cycle.cycle_ms - cycle.waiting_ms
        assert expected_ms[cycle.row] - 100 <= moving_ms <= expected_ms[cycle.row] + 100, cycle
    assert fmean(cycle.cycle_ms - cycle.waiting_ms for cycle in twin.cycles()) <= mean_ms


# cups


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("descend_at_count", first_of([12, 9, 11, 20]))
def test_the_arm_goes_down_at_the_set_cup_and_not_before(side: Side, descend_at_count: int) -> None:
    """The claws are spread at about cup 6; the raised arm is lowered at the set cup, but no later than at cup 12."""
    run = tray_run(descend_at_count=descend_at_count)
    lowered_ms = signed(outputs_of(run, side, 1))["+lift_extend"][0]
    cups_ms = cups_before(run, side, 1, lowered_ms)
    assert len(cups_ms) == min(descend_at_count, 12)
    assert 10 <= lowered_ms - cups_ms[-1] <= 20


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("descend_at_count", "released_at"), first_of([(12, 13), (9, 12), (11, 12), (20, 13)]))
def test_going_down_late_can_cost_a_cup(side: Side, descend_at_count: int, released_at: int) -> None:
    """Lowering takes 0.8 s of the 1.33 s cup interval, so an arm lowered at cup 12 releases its row at cup 13."""
    run = tray_run(descend_at_count=descend_at_count)
    assert len(cups_before(run, side, 1, releases_ms(run, side)[1])) == released_at
    missed = {cycle.row: cycle.missed_cups for cycle in run.twin.cycles() if cycle.side == side}
    assert missed == {row: row * (released_at - 12) for row in ROWS}


@pytest.mark.parametrize("side", SIDES)
def test_cups_too_fast_for_the_arm_are_counted_as_missed(side: Side) -> None:
    """Each row is released at the first cup after the arm is lowered, and the cups after the twelfth count as missed.

    Twelve cups at 90/min take 8 s, which is less than the cycle time. A flag takes 133 ms, less than the release lead,
    so half of the gap of 533 ms times the release.
    """
    run = tray_run(cups_per_min=90.0)
    missed = 0
    for row in ROWS:
        released_ms = releases_ms(run, side)[row]
        cups_ms = cups_before(run, side, row, released_ms)
        assert len(cups_ms) >= 13
        assert 10 <= released_ms - cups_ms[-1] <= 40
        down_ms = next(
            change.at_ms for change in outputs_of(run, side, row) if change.name == "lift_extend" and not change.on
        )
        assert all(not down_ms < cup_ms < cups_ms[-1] - 20 for cup_ms in cups_ms), "an earlier cup could have been used"
        missed += len(cups_ms) - 12
        assert cycle_of(run.twin, side, row).missed_cups == missed


def test_an_arm_that_has_finished_stays_at_home_and_misses_no_cups() -> None:
    """If the right arm has only one row to take, it finishes early; later cups are not counted as missed."""
    twin = at_work({"trays_target": 1})
    arm = tags_of(twin, "right")
    for row in (2, 3):
        twin.plc.write(arm.rows[row], TAKEN)
    twin.run_until(arm.cycles.equals(1), within_ms=200_000)
    outputs = ChangeRecorder.of_outputs(twin)
    twin.run_until(twin.machine.tags.machine.trays_done.equals(1), within_ms=60_000)
    missed = twin.plc.read(arm.missed_cups)
    twin.plant.planting_frequency_per_min = 25.0
    assert twin.run_until_state(State.COMPLETE, within_ms=100_000) > 12 * 60_000 / 45, "more than twelve cups"
    twin.run_for(60_000)
    assert twin.plc.read(arm.missed_cups) == missed
    assert outputs.of("right.slide_inward") == []


# the centre


def in_step_cups(*, may_meet: bool) -> Twin:
    """Return a machine whose two rows of cups are synchronous, so that the arms move together."""
    parameters = MACHINE.with_values({"layout.arms_may_meet_in_plant": may_meet, "cups.pulse_jitter": 0.0})
    twin = Twin(parameters=parameters, trays=1, set_points={"trays_target": 1, "arms_may_meet": int(may_meet)})
    if not may_meet:
        guard(twin)
    left, right = twin.plant.left.cups, twin.plant.right.cups
    for cups in (left, right):
        cups.place(0.030)
    twin.home()
    twin.start()
    return twin


def leaves_feed_ms(record: ChangeRecorder, side: Side) -> list[int]:
    """Return the times at which an arm left feed for rows 1, 2 and 3."""
    return signed(record.of(f"{side}."))["+slide_inward"]


def test_the_left_arm_goes_first_to_row_3_and_the_right_one_once_it_has_left_the_centre() -> None:
    twin = in_step_cups(may_meet=False)
    outputs = ChangeRecorder.of_outputs(twin)
    switch = twin.plant.left.slide.at_pick[1]
    passes = ChangeRecorder(twin, lambda _: {"pick 2"} if switch.read() else set())
    to_complete(twin)
    left_ms, right_ms = leaves_feed_ms(outputs, "left"), leaves_feed_ms(outputs, "right")
    assert left_ms[:2] == right_ms[:2]
    leaving_ms = signed(passes.of("", left_ms[2]))["+pick 2"][-1]
    assert leaving_ms > left_ms[2] + 3_000
    assert 10 <= right_ms[2] - leaving_ms <= 30


def test_arms_that_may_meet_go_to_row_3_together() -> None:
    twin = in_step_cups(may_meet=True)
    outputs = ChangeRecorder.of_outputs(twin)
    to_complete(twin)
    assert leaves_feed_ms(outputs, "left") == leaves_feed_ms(outputs, "right")
    assert twin.plant.events == []


def test_the_priority_of_the_left_arm_does_not_interrupt_the_right_arm_in_the_centre() -> None:
    """If the right arm moves in to row 3 first, the left arm waits until the right arm has left the centre."""
    run = tray_run()
    left_ms, right_ms = leaves_feed_ms(run.outputs, "left")[2], leaves_feed_ms(run.outputs, "right")[2]
    passes_ms = signed(run.sensors.of("right.", right_ms, left_ms))["+slide_at_pick_2"]
    assert right_ms < left_ms
    assert len(passes_ms) == 2, "on the way in and on the way out"
    assert 10 <= left_ms - passes_ms[-1] <= 30
