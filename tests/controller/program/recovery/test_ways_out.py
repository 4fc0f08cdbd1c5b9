"""Ways to go on: answers with the buttons, lost memory, part-filled trays, an arm out of service, an empty line."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from controller.common.modbus.io_map import IoMap
from controller.core.expr import evaluate
from controller.events.kinds import ModeEvent, RefusalEvent, StateEvent
from controller.program.operator.answers import Question
from controller.program.operator.commands import ARM_OUTPUTS
from controller.program.operator.next_press import NextPress
from controller.program.operator.refusals import Refusal
from controller.program.states import Mode, State
from controller.program.tags import FULL, IN_DOUBT, ROWS, SIDES, TAKEN, Side
from controller.program.texts.next_press import NEXT_PRESSES
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import begin_homing, home_again, press_emergency_stop, questions
from tests.controller.program.modes.hands import jog_command, stop, to_manual
from tests.plant_sim.twin.routes import BRISK, run_to
from tests.plant_sim.twin.twin_rig import MACHINE, TRAY_MS, other_side, output_bits, switched_on, tags_of
from tests.sampling import first_of, one_in
from tests.wiring import unwired, wired

PRESSES = {NEXT_PRESSES[press].en: press for press in NextPress} | {"": NextPress.NONE}
HELD_MS = 2_300
"""Duration of a press that answers, ms; 2 to 10 s are required."""


def machine(*, io_map: IoMap | None = None, trays: int = 1, **set_points: int) -> Twin:
    """Return a machine in Stopped."""
    return switched_on(set_points, trays=trays, parameters=BRISK, io_map=io_map)


def show_panel(twin: Twin) -> None:
    """Connect an operator panel, which reads the controller ten times a second."""
    twin.every(100, lambda each: each.runtime.panel.read())


def power_lost_clamping(side: Side, io_map: IoMap | None = None) -> Twin:
    """Return a machine in Stopped after a power loss while the claws were closing on row 2."""
    twin = machine(io_map=io_map, trays_target=1)
    run_to("close claws")(twin, side)
    twin.run_for(150)
    twin.power_cycle()
    twin.run_for(50)
    assert questions(twin) == {f"{side} loaded"}
    return twin


def lose_memory(twin: Twin) -> None:
    """Switch the power off and on with the retentive memory lost."""
    twin.store.values = None
    twin.power_cycle()
    twin.plc.write(twin.machine.tags.system.memory_lost, 1)
    twin.run_for(50)


def hold(twin: Twin, button: str, for_ms: int = HELD_MS) -> None:
    """Hold a button, release it and wait until the inputs have settled."""
    twin.press(button, for_ms=for_ms)
    twin.run_for(for_ms + 200)


def read(twin: Twin, name: str) -> int:
    """Return the value of a machine tag."""
    return twin.plc.read(getattr(twin.machine.tags.machine, name))


def refusals(twin: Twin) -> list[tuple[str, Refusal, NextPress]]:
    """Return the refused presses so far: command, reason and next useful press."""
    return [
        (event.command, Refusal(event.reason), PRESSES[event.next_press.en])
        for event in twin.events
        if isinstance(event, RefusalEvent)
    ]


def rows(twin: Twin, side: Side) -> list[int]:
    """Return the stored states of the rows of an arm."""
    return [twin.plc.read(word) for word in tags_of(twin, side).rows.values()]


# answers with the buttons


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("button", "row_2"), [("start", TAKEN), ("stop", None)])
def test_held_buttons_answer_a_question_that_a_panel_shows(side: Side, button: str, row_2: int | None) -> None:
    """X0 answers yes and the row counts as taken; X24 answers no and the row is put back."""
    twin = power_lost_clamping(side)
    show_panel(twin)
    twin.run_for(100)
    assert read(twin, "question") == Question[f"{side.upper()}_LOADED"]
    assert read(twin, "next_press") == NextPress[f"ANSWER_{side.upper()}_LOADED"]
    hold(twin, button)
    assert twin.state.name == "STOPPED"
    assert questions(twin) == set()
    assert refusals(twin) == []
    assert home_again(twin) == {"tray"}
    assert rows(twin, side)[1] == (FULL if row_2 is None else row_2)


@pytest.mark.parametrize("button", ["start", "stop"])
def test_buttons_answer_nothing_that_no_lamp_or_panel_shows(button: str) -> None:
    twin = power_lost_clamping("left", unwired("lamp_amber"))
    twin.press(button, for_ms=HELD_MS)
    twin.run_for(HELD_MS + 100)
    assert rows(twin, "left")[1] == IN_DOUBT


def test_a_short_press_answers_nothing_and_names_the_hold() -> None:
    """X0 pressed as for homing neither homes nor answers; reason and next press are reported."""
    twin = power_lost_clamping("left")
    show_panel(twin)
    twin.run_for(100)
    hold(twin, "start", 1_500)
    assert rows(twin, "left")[1] == IN_DOUBT
    assert twin.state.name == "STOPPED"
    assert refusals(twin) == [("reset", Refusal.RELEASED_EARLY, NextPress.ANSWER_LEFT_LOADED)]


def test_a_question_that_changes_while_a_button_is_held_is_not_answered() -> None:
    """The hold begun for one question does not answer the next one."""
    twin = power_lost_clamping("left")
    show_panel(twin)
    twin.run_for(100)
    twin.plant.box.start = True
    twin.run_for(1_500)
    twin.command("left_loaded_no")
    twin.plc.write(tags_of(twin, "right").loaded, False)
    twin.plc.write(tags_of(twin, "right").rows[1], IN_DOUBT)
    twin.run_for(1_500)
    twin.plant.box.start = False
    twin.run_for(200)
    assert rows(twin, "right")[0] == IN_DOUBT


def test_power_lost_while_a_button_answers() -> None:
    """The question is asked again, and the button that is still held answers nothing."""
    twin = power_lost_clamping("left")
    show_panel(twin)
    twin.run_for(100)
    twin.plant.box.start = True
    twin.run_for(1_800)
    twin.power_cycle()
    show_panel(twin)
    twin.run_for(HELD_MS + 1_000)
    twin.plant.box.start = False
    twin.run_for(200)
    assert rows(twin, "left")[1] == IN_DOUBT
    assert twin.state.name == "STOPPED"


@pytest.mark.parametrize("side", SIDES)
def test_the_amber_lamp_flashes_the_number_of_the_question(side: Side) -> None:
    """In each cycle of 7 s, the lamp flashes once for the left arm and twice for the right arm."""
    io_map = wired("lamp_amber")
    twin = power_lost_clamping(side, io_map)
    lamp, levels = io_map["lamp_amber"].number, list[bool]()
    twin.watch(lambda each: levels.append(each.plc.memory.Y[lamp]))
    twin.run_for(14_000)
    flashes = sum(after and not before for before, after in itertools.pairwise(levels))
    assert flashes in {2 * Question[f"{side.upper()}_LOADED"], 2 * Question[f"{side.upper()}_LOADED"] - 1}
    hold(twin, "start")
    assert questions(twin) == set()


def test_the_amber_lamp_flashes_three_times_for_a_refused_press() -> None:
    io_map = wired("lamp_amber")
    twin = machine(io_map=io_map)
    twin.run_for(100)
    lamp, levels = io_map["lamp_amber"].number, list[bool]()
    twin.watch(lambda each: levels.append(each.plc.memory.Y[lamp]))
    twin.press("stop")
    twin.run_for(3_000)
    assert sum(after and not before for before, after in itertools.pairwise([False, *levels])) == 3
    assert refusals(twin) == [("stop", Refusal.NOT_STOPPABLE, NextPress.HOME)]


def test_cups_are_confirmed_with_x0() -> None:
    """After power-up the counts are unknown; X0 confirms empty cups while the arms wait over them."""
    twin = switched_on(parameters=MACHINE.with_values({"cups.planting_frequency_per_min": 20.0}))
    show_panel(twin)
    twin.home()
    twin.start()
    twin.run_until(lambda: read(twin, "question") == Question.CUPS_EMPTY, within_ms=30_000, what="cups asked")
    twin.press("start", for_ms=HELD_MS)
    twin.run_until(
        lambda: any(twin.plc.read(tags_of(twin, side).cups_confirmed) for side in SIDES),
        within_ms=HELD_MS + 100,
        what="cups confirmed",
    )


# next press


def test_aborted_names_the_hold_of_x24() -> None:
    """Aborted names X25 first, then X24 pressed for 3 s; a shorter press of X24 is refused with the same advice."""
    twin = machine()
    press_emergency_stop(twin)
    aborted = [event for event in twin.events if isinstance(event, StateEvent) and event.state == State.ABORTED]
    assert [event.next_press.en for event in aborted] == ["release X25, then press X24 for 3 s and release it"]
    hold(twin, "stop", 300)
    assert refusals(twin)[-1] == ("clear", Refusal.EMERGENCY_STOP, NextPress.RELEASE_EMERGENCY_STOP)
    twin.plant.box.emergency_stop = False
    twin.run_for(100)
    assert read(twin, "next_press") == NextPress.CLEAR
    hold(twin, "stop", 1_000)
    assert twin.state.name == "ABORTED"
    assert refusals(twin)[-1] == ("clear", Refusal.RELEASED_EARLY, NextPress.CLEAR)
    before = len(refusals(twin))
    hold(twin, "stop", 3_200)
    assert twin.state.name == "STOPPED"
    assert len(refusals(twin)) == before


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.CONTINUOUS])
def test_a_mode_that_survived_power_is_announced(mode: Mode) -> None:
    twin = switched_on(mode=mode)
    twin.events.clear()
    twin.power_cycle()
    twin.run_for(50)
    assert [event.mode for event in twin.events if isinstance(event, ModeEvent)] == [mode]
    state = next(event for event in twin.events if isinstance(event, StateEvent))
    name = mode.name.lower().replace("_", " ")
    assert state.next_press.en == f"press X0 to reset and home (mode: {name})"


def test_presses_without_effect_are_refused_in_every_state() -> None:
    """X0 in Execute and X24 in Stopping have no effect; both are reported with a reason."""
    twin = machine()
    twin.home()
    twin.start()
    twin.run_for(200)
    twin.press("start")
    twin.run_for(300)
    assert refusals(twin)[-1][:2] == ("start", Refusal.NOT_IDLE)
    twin.press("stop")
    twin.run_for(300)
    twin.press("stop")
    twin.run_for(300)
    assert refusals(twin)[-1][:2] == ("stop", Refusal.NOT_STOPPABLE)


# lost memory

MOMENTS: dict[str, Callable[[Twin], None]] = {
    "full tray at rest": lambda twin: twin.home(),
    **{
        f"{side} {step}": lambda twin, side=side, step=step: run_to(step)(twin, side)  # type: ignore[misc]
        for side in SIDES
        for step in ("approach row", "close claws", "lift from row", "slide to feed", "wait for cups", "converge")
    },
}


@pytest.mark.parametrize(("is_seen", "moment"), one_in(4, itertools.product((True, False), MOMENTS)))
def test_a_tray_is_not_conveyed_after_a_loss_of_memory(moment: str, is_seen: bool) -> None:
    """Homing asks, whether the tray is seen or not; neither 'none' nor X24 nor a second loss of power moves it."""
    twin = machine(trays=2)
    MOMENTS[moment](twin)
    lose_memory(twin)
    if not is_seen:
        twin.plant.conveyor.beam.stuck = False
    show_panel(twin)
    moved: list[int] = []
    run = twin.machine.tags.tray.driven["tray_run"]
    twin.watch(lambda each: moved.append(each.now_ms) if evaluate(run, each.plc.memory) else None, output_bits(twin))
    twin.run_for(200)
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=40_000)
    assert questions(twin) == {"tray"}
    if is_seen:
        twin.command("tray_none")
        twin.run_for(100)
        assert refusals(twin)[-1][1] is Refusal.TRAY_SEEN
        hold(twin, "stop")
        assert refusals(twin)[-1][1] is Refusal.TRAY_SEEN
    twin.power_cycle()
    twin.run_for(200)
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=40_000)
    assert questions(twin) == {"tray"}
    assert moved == []


def test_a_tray_of_which_every_row_is_stated_as_empty_leaves_after_a_loss_of_memory() -> None:
    """A tray taken as full can be stated as empty row by row; it then leaves, and the next one is fed."""
    twin = machine(trays=2)
    twin.home()
    lose_memory(twin)
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=40_000)
    twin.command("tray_full")
    twin.run_for(100)
    for side in SIDES:
        for row in ROWS:
            assert read(twin, "trays_done") == 0
            twin.command(f"{side}_row_{row}_empty")
            twin.run_for(50)
    assert read(twin, "trays_done") == 1
    assert home_again(twin) == set()
    assert twin.plant.conveyor.placed_tray == 1


# part-filled trays


def test_a_row_stated_as_empty_is_not_picked() -> None:
    """The arm begins with its second row; the seedlings of the first stay in the tray if it was not empty."""
    twin = machine(trays_target=1)
    twin.home()
    stop(twin)
    twin.command("left_row_3_empty")
    twin.run_for(50)
    assert rows(twin, "left") == [FULL, FULL, TAKEN]
    twin.command("rows_full")
    twin.run_for(50)
    assert rows(twin, "left") == [FULL, FULL, FULL]
    twin.command("left_row_3_empty")
    twin.home()
    twin.start()
    twin.command("right_row_3_empty")
    twin.run_for(50)
    assert refusals(twin)[-1][1] is Refusal.MOVING
    twin.run_until_state(State.COMPLETE, within_ms=4 * TRAY_MS)
    assert twin.plant.counts().in_tray == 12
    assert twin.plc.read(tags_of(twin, "left").cycles) == 2
    assert read(twin, "trays_done") == 1


# an arm out of service


@pytest.mark.parametrize("out", first_of(SIDES))
def test_one_arm_works_alone(out: Side) -> None:
    """The arm out of service is never driven; the other takes its three rows, and the tray leaves with the rest."""
    twin = machine(trays=2, trays_target=1)
    twin.home()
    stop(twin)
    twin.command(f"{out}_out_of_service")
    twin.run_for(50)
    driven: set[str] = set()
    coils = tags_of(twin, out).coils
    twin.watch(
        lambda each: driven.update(name for name, coil in coils.items() if evaluate(coil, each.plc.memory)),
        output_bits(twin),
    )
    twin.command(f"{other_side(out)}_out_of_service")
    twin.run_for(50)
    assert refusals(twin)[-1][1] is Refusal.OTHER_ARM_OUT
    twin.home()
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=4 * TRAY_MS)
    assert driven == set()
    assert twin.plant.counts().in_tray == 36 + 72
    assert read(twin, "rows_left") == 3
    assert read(twin, "trays_done") == 1
    assert twin.alarms() == []


def test_an_arm_out_of_service_survives_a_loss_of_power_and_returns() -> None:
    twin = machine()
    twin.home()
    twin.command("left_out_of_service")
    twin.run_for(50)
    assert refusals(twin)[-1][1] is Refusal.NOT_STOPPED
    stop(twin)
    twin.command("left_out_of_service")
    twin.run_for(50)
    twin.power_cycle()
    twin.run_for(200)
    assert twin.plc.read(tags_of(twin, "left").out_of_service)
    twin.command("left_in_service")
    twin.run_for(50)
    assert home_again(twin) == {"tray"}
    twin.start()
    twin.run_until(twin.step_of("left arm", "approach row"), within_ms=TRAY_MS, what="left arm works")


@pytest.mark.parametrize("side", SIDES)
def test_an_arm_out_of_service_cannot_be_jogged(side: Side) -> None:
    twin = machine()
    twin.home()
    stop(twin)
    twin.command(f"{side}_out_of_service")
    twin.run_for(50)
    to_manual(twin)
    for output in ARM_OUTPUTS:
        twin.command(jog_command(f"{side}.{output}"))
        twin.run_for(50)
        assert f"{side}.{output}" not in twin.outputs()
    twin.command(jog_command(f"{other_side(side)}.lift_retract"))
    twin.run_for(50)
    assert f"{other_side(side)}.lift_retract" in twin.outputs()


def test_an_arm_away_from_feed_is_not_taken_out_of_service() -> None:
    twin = machine()
    run_to("approach row")(twin, "left")
    twin.run_for(500)
    twin.power_cycle()
    twin.run_for(200)
    twin.command("left_out_of_service")
    twin.run_for(50)
    assert refusals(twin)[-1][1] is Refusal.LEFT_NOT_AT_FEED


def test_an_arm_out_of_service_that_leaves_feed_raises_an_alarm() -> None:
    """Away from feed, the arm might meet the other one or the tray: homing ends in an alarm."""
    twin = machine()
    twin.home()
    stop(twin)
    twin.command("left_out_of_service")
    twin.run_for(50)
    twin.plant.arms["left"].sensors["slide_at_feed"].stuck = False
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=40_000)
    assert "left: off home" in twin.alarms()


# emptying the line


def test_the_line_is_emptied() -> None:
    """Held rows are thrown, no further one is taken, the tray is conveyed out with the rest, and none follows."""
    twin = machine(trays=2)
    twin.home()
    twin.start()
    twin.run_until(twin.step_of("left arm", "lift from row"), within_ms=TRAY_MS, what="a row is lifted")
    twin.command("empty_line")
    twin.run_until_state(State.COMPLETE, within_ms=2 * TRAY_MS)
    left = [row for side in SIDES for row in rows(twin, side) if row == FULL]
    assert len(left) in {4, 5}
    assert read(twin, "rows_left") == len(left)
    assert twin.plant.counts().in_tray == 12 * len(left) + 72
    assert not any(arm.grip.held for arm in twin.plant.arms.values())
    assert twin.plant.conveyor.placed_tray is None
    assert not twin.plant.conveyor.beam.read()
    home_again(twin)
    assert twin.plant.conveyor.placed_tray == 1
