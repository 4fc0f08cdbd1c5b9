"""Stories of normal work: trays, batches, holds, modes and set-points."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from controller.program.operator.commands import JOGGED
from controller.program.states import Mode, State
from controller.program.tags import SIDES, STEPPED
from plant_sim.stories.story import Stage, Story
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import answer_truly, begin_homing

TRAY_MS = 120_000
"""Time limit for a tray, ms; at 45 cups/min a tray takes 65 s."""
STOP_MS = 40_000
"""Time limit for a stop at the end of the cycle, ms."""
JOG_RENEWAL_MS = 100
LATE = {"descend_at_count": 11, "converge_at": 1}
"""Set-points with which the arms lower and converge late; they enter all steps of the cycle."""
FASTER = {"cups.planting_frequency_per_min": 60.0}
"""Faster tractor, for shorter stories."""
WIDE = FASTER | {"layout.arms_may_meet_in_plant": True}
"""As `FASTER`, with room for both arms in the centre."""


def begin(twin: Twin) -> None:
    """Home with X0 and start with X0."""
    twin.home()
    twin.start()


def complete(stage: Stage, name: str = "Complete") -> None:
    """Run to Complete."""
    stage.twin.run_until_state(State.COMPLETE, within_ms=2 * TRAY_MS)
    stage.end(name)


def give(stage: Stage, command: str, *states: State, within_ms: int = STOP_MS) -> None:
    """Give a command and wait for one of the states; record the part."""
    twin = stage.twin
    twin.command(command)
    twin.scan()
    if states:
        twin.run_until_state(*states, within_ms=within_ms)
    twin.run_for(200)
    stage.end(command)


def two_trays(stage: Stage) -> None:
    """Transplant two trays, and home again for the next batch."""
    twin = stage.twin
    twin.home()
    stage.end("homed")
    twin.start()
    for side in SIDES:
        twin.run_until(twin.machine.tags.arms[side].cycles.equals(1), within_ms=TRAY_MS)
        stage.end(f"{side} row 1")
    complete(stage)
    begin_homing(twin)
    twin.run_until_state(State.IDLE, State.HELD, within_ms=STOP_MS)
    stage.end("homed again")
    twin.command("count_reset")
    twin.run_for(100)
    stage.end("counts reset")


def holds(stage: Stage) -> None:
    """Hold, resume, suspend, resume, stop at the end of the cycle, restart, and complete by command."""
    twin = stage.twin
    begin(twin)
    twin.run_for(9_000)
    give(stage, "hold", State.HELD)
    give(stage, "unhold", State.EXECUTE)
    twin.run_for(8_000)
    give(stage, "suspend", State.SUSPENDED)
    twin.run_for(5_000)
    stage.end("suspended")
    give(stage, "unsuspend", State.EXECUTE)
    twin.run_for(6_000)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
    stage.end("stopped by X24")
    begin(twin)
    twin.run_for(7_000)
    give(stage, "stop", State.STOPPED)
    give(stage, "reset", State.IDLE)
    give(stage, "start", State.EXECUTE)
    twin.run_for(4_000)
    give(stage, "complete", State.COMPLETE)
    give(stage, "reset", State.IDLE)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
    stage.end("stopped in Idle")


def stops_in_homing(stage: Stage) -> None:
    """Press X24 at several moments of homing, and home again."""
    twin = stage.twin
    twin.scan()
    for after_ms in (300, 900, 1_700, 2_600):
        begin_homing(twin)
        twin.run_for(after_ms)
        twin.press("stop")
        twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
        twin.run_for(300)
        stage.end(f"stopped {after_ms} ms into homing")
    begin(twin)
    complete(stage)


def one_cycle(stage: Stage) -> None:
    """Work in one-cycle mode, then return to zero and change back to continuous work."""
    twin = stage.twin
    twin.scan()
    give(stage, "mode_one_cycle")
    begin(twin)
    complete(stage, "one cycle")
    begin(twin)
    complete(stage, "second cycle")
    give(stage, "mode_zero_return")
    give(stage, "reset", State.IDLE)
    give(stage, "start")
    give(stage, "stop", State.STOPPED)
    give(stage, "mode_continuous")
    begin(twin)
    complete(stage)


def steps(stage: Stage) -> None:
    """Execute one cycle of each sequence in step mode, with presses of X0 and step commands."""
    twin = stage.twin
    begin(twin)
    twin.run_for(15_000)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
    give(stage, f"mode_{Mode.STEP.name.lower()}")
    begin(twin)
    twin.run_for(500)
    for number, name in enumerate(STEPPED, start=1):
        twin.plc.write(twin.machine.tags.sp.step_sequence, number)
        for press in range(24):
            if press % 2:
                twin.press("start")
            else:
                twin.command("step")
            twin.run_for(1_600)
            stage.end(f"{name}, press {press + 1}")
    twin.command("step")
    twin.run_for(6_000)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
    stage.end("stopped")
    give(stage, "mode_continuous")
    begin(twin)
    complete(stage)


def jogs(stage: Stage) -> None:
    """Jog every output at home, take a row manually, then return to automatic work."""
    twin = stage.twin
    begin(twin)
    twin.run_for(15_000)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
    give(stage, "mode_manual")
    begin(twin)
    for output in JOGGED:
        jog(stage, output, 600)
        twin.run_for(1_000)
    for side in SIDES:
        for output, for_ms in MANUAL_ROW:
            jog(stage, f"{side}.{output}", for_ms)
    give(stage, "stop", State.STOPPED)
    give(stage, "mode_continuous")
    for _ in range(4):
        answer_truly(twin)  # the buttons do not home while a question is shown
        begin_homing(twin)
        twin.run_until_state(State.IDLE, State.HELD, within_ms=STOP_MS)
        stage.end("homed after jogs")
        if twin.state is State.IDLE:
            break
        answer_truly(twin)
    twin.start()
    complete(stage)


MANUAL_ROW = (
    ("lift_retract", 1_500),
    ("converge", 1_500),
    ("lift_extend", 1_500),
    ("claws_open", 500),
    ("slide_inward", 2_500),
    ("claws_close", 500),
    ("lift_retract", 1_500),
    ("slide_outward", 2_500),
    ("spread", 1_500),
    ("lift_extend", 1_500),
    ("claws_open", 500),
)
"""Outputs of an arm and the time for which each is jogged, ms, to take a row to the cups; the load is not released."""


def jog(stage: Stage, output: str, for_ms: int) -> None:
    """Jog an output; the parts end while the output is on, after the release, and after a jog without renewal."""
    twin = stage.twin
    command = f"jog_{output.replace('.', '_')}"
    for number in range(for_ms // JOG_RENEWAL_MS):
        twin.command(command)
        twin.run_for(JOG_RENEWAL_MS)
        if number == 0:
            stage.end(f"jog {output}")
    twin.run_for(250)
    stage.end(f"jog {output} not renewed")
    twin.command("jog_release")
    twin.run_for(100)
    stage.end(f"jog {output} released")


def set_points(stage: Stage) -> None:
    """Work with set-points that change the cycle."""
    begin(stage.twin)
    complete(stage)


def stated_rows(stage: Stage) -> None:
    """State two rows of the tray as empty, and transplant the other ones."""
    twin = stage.twin
    twin.home()
    for row in ("left_row_1", "right_row_2"):
        give(stage, f"{row}_empty")
    twin.start()
    complete(stage)


def emptying(stage: Stage) -> None:
    """Empty the line after the first row; then transplant another tray."""
    twin = stage.twin
    begin(twin)
    twin.run_until(twin.machine.tags.arms["left"].cycles.equals(1), within_ms=TRAY_MS)
    give(stage, "empty_line", State.COMPLETE, within_ms=TRAY_MS)
    begin_homing(twin)
    twin.run_until_state(State.IDLE, State.HELD, within_ms=STOP_MS)
    twin.start()
    complete(stage)


def one_arm(stage: Stage, side: str) -> None:
    """Transplant a tray with one arm out of service, and return the arm to service."""
    twin = stage.twin
    twin.home()
    give(stage, "stop", State.STOPPED)
    give(stage, f"{side}_out_of_service")
    begin(twin)
    complete(stage)
    give(stage, "stop", State.STOPPED)
    give(stage, f"{side}_in_service")
    twin.home()
    stage.end("homed")


STORIES = (
    Story("two trays", two_trays, trays=2),
    Story("holds and stops", holds, trays=2, values=FASTER),
    Story("stops in homing", stops_in_homing),
    Story("one cycle and zero return", one_cycle, trays=2, values=FASTER),
    Story("early descent and converging", set_points, set_points={"descend_at_count": 9, "converge_at": 1}),
    Story("arms may meet", set_points, set_points={"arms_may_meet": 1}, values=WIDE),
    Story("jogs", jogs, trays=3, set_points={"trays_target": 2}),
    Story("steps", steps, trays=2),
    Story("steps, lowering and converging late", steps, trays=2, set_points=LATE),
    Story("stated rows", stated_rows, values=FASTER),
    Story("emptying the line", emptying, trays=3, set_points={"trays_target": 2}, values=FASTER),
    *(Story(f"{side} arm out of service", partial(one_arm, side=side), trays=2, values=FASTER) for side in SIDES),
    Story("fixed release delay", set_points, set_points={"release_delay": 60}, values=FASTER),
)


def stories() -> Iterator[Story]:
    """Yield the stories of normal work."""
    yield from STORIES
