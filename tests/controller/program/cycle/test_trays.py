"""Tray feeder: tray changes, missing trays, jams, and runs that end after a set number of trays."""

from __future__ import annotations

import pytest

from controller.core.retentive_store import MemoryStore
from controller.events.kinds import RefusalEvent, TrayEvent
from controller.program.operator.refusals import Refusal
from controller.program.states import Mode, State
from controller.program.tags import IN_PLACE, NO_TRAY, SIDES, Side
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import begin_homing, home_again, questions
from tests.plant_sim.twin.routes import finish
from tests.plant_sim.twin.twin_rig import (
    ALARM,
    MACHINE,
    TRAY_MS,
    ChangeRecorder,
    arm_of,
    at_initial_state,
    at_work,
    free,
    go_on,
    is_parked_loaded,
    moving_outputs,
    scan_ms,
    switched_on,
    tags_of,
    to_complete,
    undisturbed,
    until_picking,
    until_step,
)
from tests.sampling import first_of

NO_TRAY_MS = 12_000
TRAY_OUT_MS = 3_200
TICK_MS = 100
"""Tick of a limit timer, ms; a limit may expire up to one tick early."""


def why_suspended(twin: Twin) -> set[str]:
    tags = twin.machine.tags
    reasons = {f"{side}: no cups": tags.arms[side].no_cups for side in SIDES} | {"no tray": tags.tray.missing}
    return {reason for reason, bit in reasons.items() if twin.plc.read(bit)}


def trays_done(twin: Twin) -> int:
    return twin.plc.read(twin.machine.tags.machine.trays_done)


# change of trays


@pytest.mark.parametrize(("late", "seed"), [("left", 1), ("right", 0)])
def test_the_tray_leaves_when_both_arms_are_at_feed_with_their_rows(late: Side, seed: int) -> None:
    """If one of the two arms is delayed with its last row, the tray leaves only after this arm has reached feed."""
    twin = at_work(trays=2, seed=seed)
    until_picking(twin, late, 3)
    until_step(twin, f"{late} arm", "slide to feed")
    twin.run_for(1_000)
    slide = arm_of(twin, late).slide
    slide.jammed = True
    twin.run_for(1_500)
    assert twin.in_step("tray feeder", "wait for an empty tray")
    free(slide)
    twin.run_until(slide.at_feed.read, within_ms=3_000)
    arrived_ms = scan_ms(twin)
    assert 10 <= until_step(twin, "tray feeder", "move tray out", within_ms=TRAY_MS) - arrived_ms <= 30
    assert all(arm.slide.at_feed.read() and arm.grip.held for arm in twin.plant.arms.values())


def test_a_tray_is_also_changed_between_empty_arms() -> None:
    """If X24 is pressed while an arm approaches row 3, homing brings in the next tray while both arms are empty."""
    twin = at_work({"trays_target": 2}, trays=2)
    until_picking(twin, "left", 3)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=TRAY_MS)
    assert (trays_done(twin), twin.plant.conveyor.placed_tray) == (1, 0)
    twin.home()
    assert twin.plant.conveyor.placed_tray == 1
    assert all(at_initial_state(twin, side) for side in SIDES)
    twin.start()
    assert to_complete(twin) == undisturbed(trays=2)


def test_the_next_tray_arrives_in_time() -> None:
    """A tray change takes 2.7 s to move 540 mm, 0.1 s to index, at most 0.3 s to creep and 0.2 s to settle."""
    twin = at_work(trays=2)
    steps = ChangeRecorder.of_steps(twin)
    until_step(twin, "tray feeder", "settle", within_ms=2 * TRAY_MS)
    until_step(twin, "tray feeder", "wait for an empty tray", within_ms=1_000)
    times = {change.name: change.at_ms for change in steps.of("tray feeder: ") if change.on}
    assert 2_700 <= times["index"] - times["move tray out"] <= 2_760
    assert times["creep"] - times["index"] == 100
    assert 100 <= times["settle"] - times["creep"] <= 300
    assert times["wait for an empty tray"] - times["settle"] == 200
    assert twin.plant.conveyor.placed_tray == 1
    assert twin.plc.read(twin.machine.tags.tray.phase) == IN_PLACE


def test_a_tray_that_slips_back_while_it_settles_is_advanced_again() -> None:
    """If X15 is off for 50 ms during the 0.2 s of settling, the feeder creeps again and the settling time restarts."""
    twin = switched_on()
    twin.press("start")
    steps = ChangeRecorder.of_steps(twin)
    until_step(twin, "tray feeder", "settle")
    twin.run_for(100)
    beam = twin.plant.conveyor.beam
    beam.stuck = False
    twin.run_for(50)
    beam.stuck = None
    twin.run_until_state(State.IDLE, within_ms=1_000)
    visited = [change for change in steps.of("tray feeder: ") if change.on]
    assert [change.name for change in visited[-4:]] == ["settle", "creep", "settle", "wait for an empty tray"]
    assert visited[-1].at_ms - visited[-2].at_ms == 200
    assert twin.plant.conveyor.placed_tray == 0


def test_a_new_run_takes_the_next_trays() -> None:
    """With a target of one tray, the run ends after the first of two trays; pressing X0 twice starts the second run."""
    twin = at_work({"trays_target": 1}, trays=2)
    counts = to_complete(twin, within_ms=TRAY_MS)
    assert counts.in_tray == 72
    assert all(at_initial_state(twin, side) for side in SIDES)
    twin.run_for(5_000)
    assert (twin.state, twin.outputs(), trays_done(twin)) == (State.COMPLETE, set(), 1)
    go_on(twin)
    assert trays_done(twin) == 0
    assert to_complete(twin, within_ms=TRAY_MS) == undisturbed(trays=2)
    assert [event.trays_done for event in twin.events if isinstance(event, TrayEvent)] == [1, 1]


# missing tray


@pytest.mark.parametrize("trays_target", first_of([3, 0]))
def test_without_a_third_tray_the_machine_is_suspended_until_one_is_inserted_and_x0_is_pressed(
    trays_target: int,
) -> None:
    twin = switched_on({"trays_target": trays_target}, trays=3)
    magazine = twin.plant.conveyor
    magazine.in_magazine -= 1
    twin.home()
    twin.start()
    twin.run_until(twin.machine.tags.machine.trays_done.equals(2), within_ms=3 * TRAY_MS)
    creeping_ms = until_step(twin, "tray feeder", "creep")
    missing_ms = until_step(twin, "tray feeder", "no tray")
    assert NO_TRAY_MS - TICK_MS <= missing_ms - creeping_ms <= NO_TRAY_MS
    assert twin.state == State.EXECUTE
    assert twin.run_until_state(State.SUSPENDED, within_ms=100) <= 40
    assert why_suspended(twin) == {"no tray"}
    assert all(at_initial_state(twin, side) for side in SIDES)
    twin.run_for(20_000)
    magazine.in_magazine += 1
    twin.run_for(5_000)
    assert (twin.state, moving_outputs(twin), twin.alarms()) == (State.SUSPENDED, set(), [])
    twin.press("start")
    twin.run_until_state(State.EXECUTE, within_ms=200)
    twin.run_until(twin.machine.tags.machine.trays_done.equals(3), within_ms=2 * TRAY_MS)
    end = State.COMPLETE if trays_target == 3 else State.SUSPENDED
    twin.run_until_state(end, within_ms=40_000)
    assert twin.plant.counts() == undisturbed(trays=3)


def test_x0_repeats_the_search_for_a_tray() -> None:
    twin = switched_on(trays=0)
    twin.home()
    assert twin.now_ms > NO_TRAY_MS, "homing has searched for a tray"
    twin.start()
    twin.run_until_state(State.SUSPENDED, within_ms=40_000)
    twin.press("start")
    twin.run_until_state(State.EXECUTE, within_ms=200)
    twin.run_until(lambda: "tray_run" in twin.outputs(), within_ms=100, what="a creep pulse")
    again_ms = twin.run_until_state(State.SUSPENDED, within_ms=20_000)
    assert NO_TRAY_MS - TICK_MS <= again_ms <= NO_TRAY_MS + 50
    assert why_suspended(twin) == {"no tray"}


def test_arms_over_the_cups_release_their_rows_while_no_tray_comes() -> None:
    """If no tray arrives, the machine is suspended, but rows held over the cups are still released.

    At 20 cups/min twelve cups take 36 s, so the missing tray is reported before the last rows are released.
    """
    parameters = MACHINE.with_values({"cups.planting_frequency_per_min": 20.0})
    twin = at_work(parameters=parameters)
    until_step(twin, "tray feeder", "no tray", within_ms=4 * TRAY_MS)
    twin.run_until_state(State.SUSPENDED, within_ms=100)
    assert twin.plant.counts().in_claw > 0
    twin.run_for(40_000)
    assert twin.state == State.SUSPENDED
    assert twin.plant.counts() == undisturbed()


def test_a_stop_during_the_search_for_a_tray() -> None:
    twin = at_work()
    until_step(twin, "tray feeder", "creep", within_ms=2 * TRAY_MS)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=30_000)
    assert all(at_initial_state(twin, side) for side in SIDES)
    assert twin.outputs() == set()


# tray that does not leave


def test_a_beam_that_does_not_go_off_is_a_jam_after_its_limit() -> None:
    """If X15 is stuck on as the empty tray leaves, an alarm is raised after 3.2 s and the arms park with their rows."""
    twin = at_work(parameters=MACHINE.with_values({"cups.planting_frequency_per_min": 35.0}))
    moving_ms = until_step(twin, "tray feeder", "move tray out", within_ms=2 * TRAY_MS)
    twin.plant.conveyor.beam.stuck = True
    twin.run_for(TRAY_OUT_MS - TICK_MS - (moving_ms % TICK_MS))
    assert twin.alarms() == []
    twin.run_until(ALARM, within_ms=2 * TICK_MS)
    assert TRAY_OUT_MS - TICK_MS <= scan_ms(twin) - moving_ms <= TRAY_OUT_MS
    assert "tray_run" not in twin.outputs()
    twin.run_until_state(State.HELD, within_ms=5_000)
    assert twin.alarms() == ["tray_jam"]
    assert all(is_parked_loaded(twin, side) for side in SIDES)
    assert twin.plc.read(twin.machine.tags.tray.phase) == NO_TRAY, "the tray under the beam may be this one or the next"


def test_a_jammed_tray_raises_the_question_and_is_conveyed_out_after_homing() -> None:
    twin = at_work({"trays_target": 2}, trays=2)
    until_step(twin, "tray feeder", "move tray out", within_ms=2 * TRAY_MS)
    twin.plant.conveyor.jammed = True
    twin.run_until_state(State.HELD, within_ms=20_000)
    twin.plant.conveyor.jammed = False
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=10_000)
    assert questions(twin) == {"tray"}
    assert trays_done(twin) == 1
    twin.command("tray_none")
    twin.run_for(100)
    go_on(twin)
    assert to_complete(twin) == undisturbed(trays=2)
    assert trays_done(twin) == 2


def test_a_tray_met_at_full_speed_is_a_jam_and_not_in_place() -> None:
    """If X15 turns on during the index step, the belt stops with an alarm; homing after repair brings in a tray."""
    twin = at_work({"trays_target": 2}, trays=2)
    until_step(twin, "tray feeder", "index", within_ms=2 * TRAY_MS)
    twin.plant.conveyor.beam.stuck = True
    met_ms = until_step(twin, "tray feeder", "tray in the gap", within_ms=50)
    twin.scan()
    assert "tray_run" not in twin.outputs()
    twin.run_until(lambda: twin.alarms() == ["tray_jam"], within_ms=300)
    assert 100 <= scan_ms(twin) - met_ms <= 200
    twin.run_until_state(State.HELD, within_ms=10_000)
    twin.plant.conveyor.beam.stuck = None
    assert home_again(twin) == set()
    go_on(twin)
    assert to_complete(twin) == undisturbed(trays=2)
    assert trays_done(twin) == 2


def test_a_beam_that_flickers_during_the_index_step_is_not_a_jam() -> None:
    twin = at_work({"trays_target": 2}, trays=2)
    until_step(twin, "tray feeder", "index", within_ms=2 * TRAY_MS)
    beam = twin.plant.conveyor.beam
    beam.stuck = True
    until_step(twin, "tray feeder", "tray in the gap", within_ms=50)
    beam.stuck = None
    until_step(twin, "tray feeder", "creep", within_ms=50)
    assert to_complete(twin) == undisturbed(trays=2)


def test_a_leaving_tray_is_not_taken_for_a_new_one_if_the_beam_flickers_off() -> None:
    """If X15 is off for 50 ms while a tray leaves, the tray question is asked; then the next tray is brought in."""
    twin = at_work({"trays_target": 2}, trays=2)
    until_step(twin, "tray feeder", "move tray out", within_ms=2 * TRAY_MS)
    twin.run_for(1_000)
    beam = twin.plant.conveyor.beam
    beam.stuck = False
    twin.run_for(50)
    beam.stuck = None
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert twin.alarms() == ["tray_jam"]
    assert home_again(twin) == {"tray"}
    go_on(twin)
    assert to_complete(twin) == undisturbed(trays=2)
    assert trays_done(twin) == 2


def test_a_tray_under_the_beam_after_a_failed_search_raises_the_question() -> None:
    """If X15 fails while a tray creeps past, X0 after repair raises an alarm; homing then asks the tray question."""
    twin = at_work({"trays_target": 2}, trays=2)
    until_step(twin, "tray feeder", "creep", within_ms=2 * TRAY_MS)
    twin.plc.write(twin.machine.tags.sp.no_tray, 15)
    beam = twin.plant.conveyor.beam
    beam.stuck = False
    twin.run_until_state(State.SUSPENDED, within_ms=40_000)
    twin.plc.write(twin.machine.tags.sp.no_tray, NO_TRAY_MS // 100)
    beam.stuck = None
    twin.run_for(100)
    assert beam.read()
    assert twin.plant.conveyor.placed_tray is None
    twin.press("start")
    twin.run_until_state(State.HELD, within_ms=10_000)
    assert twin.alarms() == ["tray_jam"]
    assert home_again(twin) == {"tray"}
    go_on(twin)
    assert to_complete(twin) == undisturbed(trays=2)


@pytest.mark.parametrize("gap_m", first_of([0.058, 0.040, 0.045, 0.071]))
def test_every_tray_stops_within_half_a_creep_pulse_of_its_place(gap_m: float) -> None:
    """For any distance that remains after indexing, creep pulses of 3.6 mm stop the tray within 2 mm of its place."""
    twin = at_work(trays=4, parameters=MACHINE.with_values({"conveyor.gap_m": gap_m}))
    for number in range(4):
        assert abs(twin.plant.conveyor.offset_m(number)) <= 0.0020
        if number < 3:
            until_step(twin, "tray feeder", "settle", within_ms=2 * TRAY_MS)
            until_step(twin, "tray feeder", "wait for an empty tray", within_ms=1_000)


def test_a_beam_stuck_on_does_not_convey_the_next_tray_out_as_well() -> None:
    """If X15 is stuck on as a tray leaves, the full tray behind it overruns by at most 100 mm; no seedling is lost.

    After the operator has pulled the full tray back behind the beam, it is brought into place like any other tray.
    """
    twin = at_work({"trays_target": 2}, trays=2)
    until_step(twin, "tray feeder", "move tray out", within_ms=2 * TRAY_MS)
    beam = twin.plant.conveyor.beam
    beam.stuck = True
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert twin.alarms() == ["tray_jam"]
    assert twin.plant.counts().in_tray == 72
    beam.stuck = None
    assert home_again(twin) == {"tray"}
    finish(twin)
    assert twin.plant.counts() == undisturbed(trays=2)


# one cycle


def test_one_cycle_mode_takes_one_row_with_each_arm() -> None:
    """The first run releases only the rows that the arms are assumed to hold; each later run takes one row per arm.

    Two trays are emptied in six later runs.
    """
    twin = at_work({"trays_target": 2}, trays=2, mode=Mode.ONE_CYCLE)
    to_complete(twin)
    assert twin.cycles() == []
    for number in range(1, 7):
        go_on(twin)
        to_complete(twin, within_ms=40_000)
        rows = [(cycle.side, cycle.row) for cycle in twin.cycles()[-2:]]
        assert sorted(rows) == [(side, (number - 1) % 3 + 1) for side in SIDES]
        assert len(twin.cycles()) == 2 * number
        assert trays_done(twin) == number // 3
    assert twin.plant.counts() == undisturbed(trays=2)


def test_one_cycle_mode_is_complete_only_when_the_tray_is_also_at_rest() -> None:
    """If the arms are at home before the next tray arrives, Complete is reached only after the tray is in place.

    At 80 cups/min the arms finish early, and with a gap of 300 mm the feeder creeps 280 mm at 3.6 mm per 70 ms.
    """
    parameters = MACHINE.with_values({"conveyor.gap_m": 0.3, "cups.planting_frequency_per_min": 80.0})
    twin = at_work(trays=2, parameters=parameters, mode=Mode.ONE_CYCLE)
    to_complete(twin)
    for _ in range(2):
        go_on(twin)
        to_complete(twin)
    go_on(twin)
    twin.run_until_state(State.COMPLETING, within_ms=40_000)
    assert all(at_initial_state(twin, side) for side in SIDES)
    assert twin.run_until_state(State.COMPLETE, within_ms=6_000) >= 100
    assert trays_done(twin) == 1
    assert twin.plc.read(twin.machine.tags.tray.phase) == IN_PLACE
    assert twin.plant.conveyor.placed_tray == 1


def test_one_cycle_mode_can_be_left_at_rest_but_not_during_a_cycle() -> None:
    """During a cycle a mode change is refused and both arms finish their rows; in Complete it is accepted."""
    twin = at_work({"trays_target": 1}, mode=Mode.ONE_CYCLE)
    done = tags_of(twin, "right").cycle_done
    twin.run_until(done, within_ms=TRAY_MS)
    twin.command("mode_continuous")
    twin.scan()
    refused = twin.events[-1]
    assert isinstance(refused, RefusalEvent)
    assert (refused.command, refused.reason) == ("mode_continuous", Refusal.NO_MODE_CHANGE)
    assert twin.plc.read(twin.machine.tags.machine.mode) == Mode.ONE_CYCLE
    to_complete(twin)
    assert trays_done(twin) == 0
    twin.command("mode_continuous")
    twin.scan()
    assert twin.plc.read(twin.machine.tags.machine.mode) == Mode.CONTINUOUS
    go_on(twin)
    assert to_complete(twin) == undisturbed()


# unknown tray


def test_the_same_tray_is_refused_after_memory_loss() -> None:
    """After a memory loss with a tray in place, the answer "same" leaves the question open; "full" closes it."""
    twin = at_work({"trays_target": 1})
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=30_000)
    twin.store = MemoryStore()
    twin.power_cycle()
    twin.plc.press(twin.machine.tags.system.memory_lost)
    asking = twin.machine.tags.tray.ask
    twin.scan()
    twin.press("start")
    twin.run_for(300)
    assert (twin.state, twin.plc.read(asking)) == (State.RESETTING, 1)
    twin.command("tray_same")
    twin.run_until_state(State.HELD, within_ms=10_000)
    assert twin.plc.read(asking) == 1
    twin.command("tray_full")
    twin.scan()
    assert twin.plc.read(asking) == 0
    go_on(twin)
    assert to_complete(twin) == undisturbed()
