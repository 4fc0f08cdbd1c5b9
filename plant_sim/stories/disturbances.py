"""Stories of faults: switches, jams, cups, trays and refused commands."""

from __future__ import annotations

import random
from collections.abc import Iterator
from functools import partial

from controller.core.expr import any_of
from controller.program.operator.buttons import ANSWER_PRESS_MS
from controller.program.states import Mode, State
from controller.program.tags import FORGOTTEN, ROWS, SIDES
from plant_sim.faults import Fault
from plant_sim.machine.arm import ARM_SWITCHES
from plant_sim.stories.stops import HOMING_MS, home_and_answer
from plant_sim.stories.story import Stage, Story
from plant_sim.stories.work import FASTER, STOP_MS, TRAY_MS, begin, complete
from plant_sim.twin.recovery import answer_truly, begin_homing, clear, operate_manually, press_emergency_stop, repair

HALFWAY = (
    ("lift_down", "lower over cups", 300),
    ("lift_up", "lift from row", 300),
    ("slide_at_feed", "slide to feed", 500),
    ("slide_at_pick_1", "approach row", 900),
    ("claws_spread", "spread", 400),
    ("claws_converged", "converge", 400),
)
"""Switches that stick on while their device moves towards them, with the step and the time since its beginning, ms."""
DRIVES = ("lift", "slide", "spreader")
NOTICED_MS = 60_000
"""Longest time until a fault stops the machine, ms: the part may move only once a cycle."""
RESTS = (State.HELD, State.ABORTED, State.STOPPED, State.SUSPENDED)
FAST_PER_MIN = 120.0
"""Planting frequency above the permitted 90 cups per minute."""
BEGIN_MS = 12_000
"""Time of work before a fault, ms."""


def faults(stage: Stage, which: tuple[Fault, ...]) -> None:
    """Let each fault strike, wait for the stop, repair it, home and go on."""
    twin = stage.twin
    begin(twin)
    twin.run_for(BEGIN_MS)
    for fault in which:
        strike(stage, fault)
    complete(stage)


def faults_in_motion(stage: Stage, which: tuple[tuple[Fault, str, int], ...]) -> None:
    """Let each fault strike some time after its arm has entered a step; wait for the stop, repair, home and go on."""
    twin = stage.twin
    begin(twin)
    for fault, step, after_ms in which:
        side = fault.target.partition(".")[0]
        twin.run_until(twin.step_of(f"{side} arm", step), within_ms=TRAY_MS, what=f"{side} arm: {step}")
        twin.run_for(after_ms)
        strike(stage, fault)
    complete(stage)


def stuck_between_rows(stage: Stage, side: str) -> None:
    """Let the switch of row 3 stick on as the slide leaves row 1 on its way to row 3."""
    twin = stage.twin
    arm = twin.machine.tags.arms[SIDES[side == "right"]]
    begin(twin)
    approach = twin.step_of(f"{side} arm", "approach row") & arm.row_is[3]
    for passed in (arm.sensed_at_pick[1], ~arm.sensed_at_pick[1]):
        twin.run_until(approach & passed, within_ms=3 * TRAY_MS, what=f"{side} arm on its way to row 3")
    strike(stage, Fault("stuck_on", f"{side}.slide_at_pick_3"))
    complete(stage)


def strike(stage: Stage, fault: Fault) -> None:
    """Let a fault strike, wait for the stop, repair it, home and start."""
    twin = stage.twin
    twin.plant.faults.add(fault)
    word = twin.machine.tags.machine.state
    twin.runs_until(any_of(*(word.equals(state) for state in (*RESTS, State.COMPLETE))), for_ms=NOTICED_MS)
    twin.run_for(5_000)
    stage.end(fault.name)
    repair(twin, fault)
    if twin.state is State.COMPLETE:
        return
    if twin.state is State.ABORTED:
        clear(twin)
    if twin.state in {State.HELD, State.STOPPED}:
        home_and_answer(stage)
        twin.start()


def stopped_tractor(stage: Stage) -> None:
    """Stop the tractor while both arms wait over the cups, and go on; then change its speed."""
    twin = stage.twin
    begin(twin)
    twin.run_for(BEGIN_MS)
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_until_state(State.SUSPENDED, within_ms=TRAY_MS)
    twin.run_for(3_000)
    stage.end("no cups")
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
    stage.end("stopped over the cups")
    twin.plant.planting_frequency_per_min = 30.0
    begin(twin)
    twin.run_until(twin.step_of("left arm", "open claws"), within_ms=TRAY_MS)
    stage.end("slow")
    twin.plant.planting_frequency_per_min = 75.0
    twin.run_for(20_000)
    stage.end("fast")
    twin.plant.planting_frequency_per_min = 45.0
    complete(stage)


def fast_tractor(stage: Stage) -> None:
    """Drive faster than permitted, stop the tractor, and drive at the usual speed again."""
    twin = stage.twin
    begin(twin)
    twin.run_until(twin.machine.tags.arms["left"].cycles.equals(1), within_ms=TRAY_MS)
    twin.plant.planting_frequency_per_min = FAST_PER_MIN
    twin.run_until_state(State.HELD, within_ms=STOP_MS)
    stage.end("too fast")
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_for(5_000)
    home_and_answer(stage)
    twin.start()
    twin.run_for(3_000)
    stage.end("started at a standstill")
    twin.plant.planting_frequency_per_min = 60.0
    complete(stage)


def stop_and_go(stage: Stage) -> None:
    """Stop and start the tractor again and again, so that releases are left out."""
    twin, draws = stage.twin, random.Random(1)
    begin(twin)
    for _ in range(20):
        twin.plant.planting_frequency_per_min = 0.0
        twin.run_for(draws.choice((500, 1_000, 2_000)))
        twin.plant.planting_frequency_per_min = 60.0
        twin.run_for(draws.randrange(4_500, 9_000, 10))
    stage.end("stop and go")
    complete(stage)


def no_tray(stage: Stage) -> None:
    """Work without a second tray until the feeder reports none, insert one, and start again."""
    twin = stage.twin
    twin.plant.conveyor.in_magazine = 0
    begin(twin)
    twin.run_until_state(State.SUSPENDED, within_ms=2 * TRAY_MS)
    twin.run_for(2_000)
    stage.end("no tray")
    twin.plant.conveyor.in_magazine = 1
    twin.press("start")
    twin.run_until_state(State.EXECUTE, within_ms=30_000)
    stage.end("tray inserted")
    complete(stage)


def tray_met(stage: Stage, for_ms: int) -> None:
    """Let the front edge sensor read a tray for some time in the gap behind the tray that leaves."""
    twin = stage.twin
    begin(twin)
    twin.run_until(twin.step_of("tray feeder", "index"), within_ms=2 * TRAY_MS, what="tray feeder: index")
    now_ms = twin.plant.time_ms
    twin.plant.faults.add(Fault("stuck_on", "tray_front_edge", now_ms + 20, now_ms + 20 + for_ms))
    twin.runs_until(twin.machine.tags.machine.state.equals(State.HELD), for_ms=10_000)
    stage.end("tray met")
    if twin.state is State.HELD:
        home_and_answer(stage)
        twin.start()
    complete(stage)


def answers(stage: Stage, side: str, answer: str, after_ms: int = BEGIN_MS) -> None:
    """Lose power while the claws close on a row; answer the question of the arm and the wrong ones before it."""
    twin = stage.twin
    begin(twin)
    twin.run_for(after_ms)
    twin.run_until(twin.step_of(f"{side} arm", "close claws"), within_ms=TRAY_MS)
    twin.run_for(150)
    twin.power_cycle()
    twin.run_for(300)
    twin.command("reset")  # X0 would answer the question that is shown
    twin.run_until_state(State.HELD, State.IDLE, within_ms=HOMING_MS)
    stage.end("asked")
    for command in ("cups_empty", "tray_full", f"{side}_{answer}"):
        twin.command(command)
        twin.run_for(300)
        stage.end(command)
    home_and_answer(stage)
    twin.start()
    complete(stage)


def answers_by_buttons(stage: Stage, side: str, row: int, *, moved: bool) -> None:
    """Lose power while the claws close on a row, and answer the questions with X0 and X24 as a panel shows them.

    Args:
        stage: Stage of the story.
        side: Arm.
        row: Row on which its claws close.
        moved: True if the arm is moved to feed by hand before the answer.
    """
    twin = stage.twin
    begin(twin)
    tags = twin.machine.tags
    closing = twin.step_of(f"{side} arm", "close claws") & tags.arms[SIDES[side == "right"]].row_is[row]
    twin.run_until(closing, within_ms=2 * TRAY_MS)
    twin.run_for(150)
    twin.power_cycle()
    twin.watch(lambda each: each.runtime.panel.read())
    twin.run_for(300)
    twin.plc.write(tags.tray.phase, FORGOTTEN)
    if moved:
        operate_manually(twin, f"{side}.slide_outward", for_ms=4_000)
        twin.run_for(1_500)
    stage.end("asked")
    _hold(stage, "stop")
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=HOMING_MS)
    stage.end("tray asked")
    _hold(stage, "start")
    home_and_answer(stage)
    twin.start()
    complete(stage)


def _hold(stage: Stage, button: str) -> None:
    """Press a button long enough to answer."""
    stage.twin.press(button, for_ms=ANSWER_PRESS_MS + 200)
    stage.twin.run_for(ANSWER_PRESS_MS + 1_000)
    stage.end(f"{button} held")


def discards(stage: Stage, side: str) -> None:
    """Discard a load after an emergency stop, and one after a stop at the end of the cycle."""
    twin = stage.twin
    begin(twin)
    for _ in range(2):
        twin.run_until(twin.step_of(f"{side} arm", "wait for cups"), within_ms=TRAY_MS)
        press_emergency_stop(twin)
        clear(twin)
        twin.command(f"{side}_discard")
        twin.run_for(100)
        stage.end("discard")
        home_and_answer(stage)
        twin.start()
    complete(stage)


def tray_questions(stage: Stage, answer: str) -> None:
    """Move the tray manually at rest, home, and answer the question of the tray."""
    twin = stage.twin
    begin(twin)
    twin.run_for(BEGIN_MS)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
    twin.run_for(300)
    twin.command("mode_manual")
    twin.scan()
    begin(twin)
    for _ in range(4):
        twin.command("jog_tray_run")
        twin.run_for(100)
    twin.run_for(1_000)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
    twin.run_for(300)
    twin.command("mode_continuous")
    twin.scan()
    twin.command("reset")  # X0 would answer the question that is shown
    twin.run_until_state(State.HELD, State.IDLE, within_ms=HOMING_MS)
    stage.end("asked")
    twin.command(answer)
    twin.run_for(300)
    stage.end(answer)
    answer_truly(twin)
    home_and_answer(stage)
    twin.start()
    complete(stage)


def every_command(stage: Stage) -> None:
    """Give every command in every state at rest, after which the machine returns to that state."""
    twin = stage.twin
    twin.scan()
    commands = [command.name for command in twin.machine.tags.commands]
    stopping = {"abort", "stop", "reset", "start", "mode_manual", "right_row_3_empty"}  # an empty tray is conveyed out
    harmless = [name for name in commands if name not in stopping]
    _give_all(stage, "Stopped", harmless)
    twin.command(f"mode_{Mode.CONTINUOUS.name.lower()}")
    twin.home()
    _give_all(stage, "Idle", [name for name in harmless if not name.startswith("mode")])
    twin.start()
    twin.run_for(3_000)
    keep = {"hold", "suspend", "unsuspend", "complete", "empty_line", "discard"}
    _give_all(stage, "Execute", [name for name in harmless if name not in keep])
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=STOP_MS)
    _give_all(stage, "Held", [name for name in harmless if not name.startswith(("unhold", "mode"))])
    twin.command("abort")
    twin.run_for(300)
    _give_all(stage, "Aborted", [name for name in harmless if name != "clear"])
    twin.plant.box.emergency_stop = True
    twin.run_for(200)
    _give_all(stage, "Aborted by emergency stop", harmless)
    clear(twin)
    home_and_answer(stage)
    twin.start()
    complete(stage)


def _give_all(stage: Stage, state: str, commands: list[str]) -> None:
    twin = stage.twin
    for name in commands:
        twin.command(name)
        twin.run_for(50)
        stage.end(f"{name} in {state}")


def _switch_faults(side: str, kind: str) -> tuple[Fault, ...]:
    return tuple(Fault(kind, f"{side}.{switch}") for switch in ARM_SWITCHES)


def stories() -> Iterator[Story]:
    """Yield the stories of disturbances."""
    yield Story("every command", every_command)
    yield Story("stopped tractor", stopped_tractor)
    yield Story("fast tractor", fast_tractor, values=FASTER)
    yield Story("stop and go", stop_and_go, trays=2, set_points={"trays_target": 2}, values=FASTER)
    yield Story("no tray", no_tray, trays=2, values=FASTER)
    for answer in ("tray_same", "tray_full", "tray_none"):
        yield Story(
            f"answer {answer}",
            partial(tray_questions, answer=answer),
            trays=4,
            set_points={"trays_target": 2},
            values=FASTER,
        )
    for side in SIDES:
        for answer in ("loaded_yes", "loaded_no", "discard"):
            yield Story(f"answer {side} {answer}", partial(answers, side=side, answer=answer), values=FASTER)
        first_row = partial(answers, side=side, answer="loaded_no", after_ms=0)
        yield Story(f"answer {side} loaded_no on row 1", first_row, values=FASTER)
        for row in ROWS:
            for moved in (False, True):
                by_buttons = partial(answers_by_buttons, side=side, row=row, moved=moved)
                name = f"answers by buttons, {side} row {row}{', moved' if moved else ''}"
                yield Story(name, by_buttons, values=FASTER)
        yield Story(f"discards, {side} arm", partial(discards, side=side), trays=2, values=FASTER)
        for kind in ("stuck_off", "stuck_on"):
            which = _switch_faults(side, kind)
            for some in (which[:4], which[4:]):
                name = f"{kind}, {some[0].target} to {some[-1].target}"
                yield Story(name, partial(faults, which=some), trays=4, values=FASTER)
        for some_switches in (HALFWAY[:3], HALFWAY[3:]):
            moving = tuple((Fault("stuck_on", f"{side}.{name}"), step, ms) for name, step, ms in some_switches)
            name = f"stuck_on halfway, {side} arm, {some_switches[0][0]} to {some_switches[-1][0]}"
            yield Story(name, partial(faults_in_motion, which=moving), trays=4, values=FASTER)
        between = partial(stuck_between_rows, side=side)
        yield Story(f"stuck_on between rows, {side} arm", between, trays=2, values=FASTER)
        jams = tuple(Fault("jammed", f"{side}.{drive}") for drive in DRIVES)
        yield Story(f"jams, {side} arm", partial(faults, which=jams), trays=4, values=FASTER)
        cups = (Fault("stuck_off", f"{side}.cup_pulse"), Fault("doubled_pulses", f"{side}.cup_pulse", size=1.0))
        yield Story(f"cup counter, {side} arm", partial(faults, which=cups), trays=3, values=FASTER)
    tray = (Fault("stuck_off", "tray_front_edge"), Fault("stuck_on", "tray_front_edge"), Fault("jammed", "conveyor"))
    for fault in tray:
        yield Story(fault.name, partial(faults, which=(fault,)), trays=3, values=FASTER)
    for for_ms in (100, 1_000):
        yield Story(f"tray met for {for_ms} ms", partial(tray_met, for_ms=for_ms), trays=3, values=FASTER)
    yield Story("low supply", partial(faults, which=(Fault("low_supply", "supply", size=0.1e6),)), trays=2)
