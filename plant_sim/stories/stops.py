"""Stories of stops in every step: emergency stop, power loss, link loss, scan and store faults, lost memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from controller.program.machine import Transplanter
from controller.program.operator.buttons import STUCK_MS
from controller.program.states import State
from controller.program.tags import ROWS, SIDES
from plant_sim.stories.story import Stage, Story
from plant_sim.stories.work import FASTER, LATE, TRAY_MS, begin, complete
from plant_sim.twin.lock_step import CLEAR_MS, NotReachedError, Twin
from plant_sim.twin.recovery import (
    answer_truly,
    begin_homing,
    clear,
    operate_manually,
    press_emergency_stop,
    questions,
)

INTO_MS = 120
"""Time from entering a step to the stop, ms: long enough for coils and valves to act, shorter than any stroke."""
REST_MS = 1_000
RISE_MS = 300
"""Time to lift an arm beyond its lower switch by the manual override, ms; the plugs remain in their cells."""
STEPS_A_STORY = 6
HOMING_MS = 40_000

Stop = Callable[[Stage], None]


def emergency_stop(stage: Stage) -> None:
    """Press the emergency stop, tap X24, and clear; a tap of X24 must not clear."""
    twin = stage.twin
    press_emergency_stop(twin)
    stage.end("emergency stop")
    twin.plant.box.emergency_stop = False
    twin.run_for(200)
    twin.press("stop", for_ms=100)
    twin.run_for(CLEAR_MS + REST_MS)
    stage.end("X24 tapped")
    clear(twin)


def power_loss(stage: Stage) -> None:
    """Switch the controller off for a second."""
    stage.twin.power_cycle()
    stage.twin.run_for(REST_MS)


def link_loss(stage: Stage) -> None:
    """Report the loss of the link to the program for a second; the commands clear it afterwards."""
    _with_status(stage, "link_lost")


def scan_fault(stage: Stage) -> None:
    """Report a late scan to the program."""
    _with_status(stage, "scan_fault")


def store_fault(stage: Stage) -> None:
    """Report a fault of the retentive store to the program."""
    _with_status(stage, "store_fault")


def silent_panel(stage: Stage) -> None:
    """Report to the program that the panel no longer responds; the machine holds."""
    twin = stage.twin
    bit = twin.machine.tags.system.panel_silent
    twin.plc.write(bit, 1)
    twin.run_until_state(State.HELD, State.ABORTED, within_ms=HOMING_MS)
    stage.end("panel silent")
    twin.plc.write(bit, 0)
    twin.run_for(REST_MS)


def _with_status(stage: Stage, name: str) -> None:
    twin = stage.twin
    bit = getattr(twin.machine.tags.system, name)
    twin.plc.write(bit, 1)
    twin.run_for(REST_MS)
    twin.command("clear")
    twin.run_for(100)
    stage.end(f"{name}, clear refused")
    twin.plc.write(bit, 0)
    twin.run_for(REST_MS)
    stage.end(f"{name} ended")
    twin.command("clear")
    twin.run_until_state(State.STOPPED, within_ms=500)
    twin.run_for(300)


def home_and_answer(stage: Stage) -> None:
    """Home until the machine is Idle, answering each question truthfully; the questions are recorded."""
    twin = stage.twin
    for _ in range(4):
        answer_truly(twin)  # the buttons do not home while a question is shown
        begin_homing(twin)
        twin.run_until_state(State.IDLE, State.HELD, within_ms=HOMING_MS)
        stage.end(f"homed, asked {', '.join(sorted(questions(twin))) or 'nothing'}")
        if twin.state is State.IDLE:
            return
        answer_truly(twin)
    raise NotReachedError(f"homing does not end in Idle; {twin.situation()}")


def in_steps(stage: Stage, stop: Stop, sequence: str, titles: tuple[str, ...]) -> None:
    """Stop in each of these steps of a sequence, recover, and complete the tray."""
    twin = stage.twin
    begin(twin)
    for title in titles:
        _until(twin, sequence, title)
        stop(stage)
        stage.end(f"{sequence}: {title}")
        home_and_answer(stage)
        twin.start()
    complete(stage)


def holds_in_steps(stage: Stage, side: str) -> None:
    """Hold in every usual step of an arm, resume, and complete the trays; the arms finish their cycle first."""
    twin = stage.twin
    begin(twin)
    for title in USUAL:
        twin.run_until(twin.step_of(f"{side} arm", title), within_ms=TRAY_MS, what=f"{side} arm: {title}")
        twin.run_for(20)
        twin.command("hold")
        twin.run_until_state(State.HELD, within_ms=HOMING_MS)
        twin.run_for(REST_MS)
        stage.end(f"held in {title}")
        twin.command("unhold")
        twin.run_for(100)
    complete(stage)


def in_homing_steps(stage: Stage, stop: Stop, side: str, titles: tuple[str, ...]) -> None:
    """Stop in each of these steps of homing, recover, and complete the tray."""
    twin = stage.twin
    begin(twin)
    for title in titles:
        twin.run_for(6_000)
        press_emergency_stop(twin)
        clear(twin)
        begin_homing(twin)
        _until(twin, f"{side} homing", title, required=False)
        stop(stage)
        stage.end(f"{side} homing: {title}")
        home_and_answer(stage)
        twin.start()
    complete(stage)


def _until(twin: Twin, sequence: str, title: str, *, required: bool = True) -> None:
    limit_ms = TRAY_MS if required else 6_000
    if not twin.runs_until(twin.step_of(sequence, title), for_ms=limit_ms) and required:
        raise NotReachedError(f"{sequence}: {title} not reached within {limit_ms} ms; {twin.situation()}")
    twin.run_for(INTO_MS)


def put_back(stage: Stage, side: str) -> None:
    """Stop as the claws begin to close on each row, and home: the row is put back and remains full."""
    twin = stage.twin
    begin(twin)
    for row in ROWS:
        picks = twin.step_of(f"{side} arm", "close claws") & twin.machine.tags.arms[SIDES[side == "right"]].row_is[row]
        twin.run_until(picks, within_ms=2 * TRAY_MS, what=f"{side} arm closes on row {row}")
        twin.run_for(20)
        press_emergency_stop(twin)
        clear(twin)
        if row == 2:  # the arm has to be lowered again
            operate_manually(twin, f"{side}.lift_retract", for_ms=RISE_MS)
        home_and_answer(stage)
        stage.end(f"row {row} put back")
        twin.start()
    complete(stage)


def lost_memory(stage: Stage) -> None:
    """Lose the retentive memory while the arms hold rows over a tray that has been started."""
    twin = stage.twin
    begin(twin)
    twin.run_until(twin.step_of("left arm", "lift from row"), within_ms=TRAY_MS)
    twin.run_for(400)
    twin.store.values = None
    twin.power_on()
    twin.plc.write(twin.machine.tags.system.memory_lost, 1)
    twin.run_for(REST_MS)
    stage.end("memory lost")
    begin_homing(twin)
    twin.run_until_state(State.IDLE, State.HELD, within_ms=HOMING_MS)
    stage.end("homed without memory")
    answer_truly(twin)
    stage.end("answered")


def reset_of_alarms(stage: Stage) -> None:
    """Raise the alarm of a stuck button in Stopped, acknowledge it, and reset it."""
    twin = stage.twin
    twin.scan()
    twin.press("stop", for_ms=STUCK_MS + 1_000)
    twin.run_for(STUCK_MS + 500)
    stage.end("X24 stuck")
    twin.command("acknowledge")
    twin.run_for(1_000)
    stage.end("X24 free")
    begin(twin)
    complete(stage)


STOPS: dict[str, Stop] = {
    "emergency stop": emergency_stop,
    "power loss": power_loss,
    "link loss": link_loss,
    "scan fault": scan_fault,
    "store fault": store_fault,
    "silent panel": silent_panel,
}
RARE = ("link loss", "scan fault", "store fault", "silent panel")
"""Stops whose effect on the program does not depend on the step; they are played in a few steps only."""
USUAL = (
    "wait at feed",
    "approach row",
    "settle at row",
    "close claws",
    "lift from row",
    "slide to feed",
    "pause at feed",
    "spread",
    "lower over cups",
    "wait for cups",
    "release delay",
    "open claws",
)
"""Steps of the cycle of an arm that normal work enters."""
OPTIONAL = ("wait to lower", "raise empty", "converge", "lower empty")
"""Steps of the cycle that the arm enters if it lowers and converges late."""


def stories(machine: Transplanter) -> Iterator[Story]:
    """Yield the stories of stops: several steps each, so that every step of an arm and of the feeder is stopped in."""
    yield Story("stuck stop button", reset_of_alarms, values=FASTER)
    yield Story("lost memory", lost_memory)
    for side in SIDES:
        yield Story(f"rows put back, {side} arm", partial(put_back, side=side), trays=2, values=FASTER)
    for side in SIDES:
        for name in RARE:
            play = partial(in_steps, stop=STOPS[name], sequence=f"{side} arm", titles=("close claws", "spread"))
            yield Story(f"{name}, {side} arm", play, values=FASTER)
        yield Story(f"holds, {side} arm", partial(holds_in_steps, side=side), trays=3, values=FASTER)
        for name in ("emergency stop", "power loss"):
            for some in (USUAL[:6], USUAL[6:]):
                play = partial(in_steps, stop=STOPS[name], sequence=f"{side} arm", titles=some)
                yield Story(f"{name}, {side} arm, {some[0]} to {some[-1]}", play, trays=2, values=FASTER)
            play = partial(in_steps, stop=STOPS[name], sequence=f"{side} arm", titles=OPTIONAL)
            title = f"{name}, {side} arm, lowering and converging late"
            yield Story(title, play, trays=2, set_points=LATE, values=FASTER)
    for name in ("emergency stop", "power loss"):
        feeder = ("move tray out", "index", "creep", "settle")
        play = partial(in_steps, stop=STOPS[name], sequence="tray feeder", titles=feeder)
        yield Story(f"{name}, tray feeder", play, trays=5, values=FASTER)
    for side in SIDES:
        homing = [step.title for step in machine.homings[side].steps]
        for first in range(0, len(homing), STEPS_A_STORY):
            titles = tuple(homing[first : first + STEPS_A_STORY])
            play = partial(in_homing_steps, stop=emergency_stop, side=side, titles=titles)
            yield Story(f"emergency stop, {side} homing, {titles[0]} to {titles[-1]}", play, trays=2, values=FASTER)
