"""New machine: memory that is declared as never written; X0 conveys its tray out, and no question is asked."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from controller.core.scan import Plc
from controller.program.memory import declare_new, lose
from controller.program.operator.refusals import Refusal
from controller.program.states import State
from controller.program.tags import COMING, FORGOTTEN, FULL, IN_PLACE, MOVING_OUT, ROWS, SIDES, TAKEN
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import begin_homing, home_again, questions
from tests.controller.program.interlock_scene import MACHINE
from tests.controller.program.recovery.test_ways_out import lose_memory, machine, read, refusals
from tests.plant_sim.twin.routes import run_to
from tests.plant_sim.twin.twin_rig import TRAY_MS, tags_of
from tests.sampling import first_of


def phase(twin: Twin) -> int:
    return twin.plc.read(twin.machine.tags.tray.phase)


def rows(twin: Twin) -> set[int]:
    return {twin.plc.read(tags_of(twin, side).rows[row]) for side in SIDES for row in ROWS}


def declare(twin: Twin) -> None:
    twin.command("new_machine")
    twin.run_for(50)


def lost(*, trays: int = 2) -> Twin:
    """Return a machine in Stopped with a full tray in place and without memory."""
    twin = machine(trays=trays, trays_target=1)
    twin.home()
    lose_memory(twin)
    assert twin.alarms() == ["memory_lost"]
    return twin


def test_the_tray_of_a_new_machine_is_conveyed_out_by_x0_without_a_question() -> None:
    """The declaration itself moves nothing; it ends the alarm, and the next tray is full."""
    twin = lost()
    declare(twin)
    assert (twin.alarms(), refusals(twin)) == ([], [])
    assert (phase(twin), rows(twin)) == (MOVING_OUT, {TAKEN})
    twin.run_for(20_000)
    assert (twin.state, twin.plant.conveyor.placed_tray) == (State.STOPPED, 0)
    begin_homing(twin)
    asked: set[str] = set()
    asking = [twin.machine.tags.tray.ask, *(tags_of(twin, side).ask for side in SIDES)]
    twin.watch(lambda each: asked.update(questions(each)), asking)
    twin.run_until_state(State.IDLE, within_ms=60_000)
    assert asked == set()
    assert twin.plant.conveyor.placed_tray == 1
    assert (phase(twin), rows(twin)) == (IN_PLACE, {FULL})
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=4 * TRAY_MS)
    assert twin.plant.counts().in_tray == 72  # those of the first tray
    assert twin.plant.events == []


@pytest.mark.parametrize("step", first_of(["lift from row", "slide to feed", "wait for cups"]))
def test_the_claws_of_a_new_machine_count_as_loaded_and_open_over_cups(step: str) -> None:
    """A row that the claws really hold is thrown over its cups, not dropped."""
    twin = machine(trays=2, trays_target=1)
    run_to(step)(twin, "left")
    twin.run_for(300)
    lose_memory(twin)
    declare(twin)
    for side in SIDES:
        arm = tags_of(twin, side)
        assert all(twin.plc.read(bit) for bit in (arm.loaded, arm.claws_closed, arm.clamped))
        assert not twin.plc.read(arm.claws_known)
    held = sum(len(arm.grip.held) for arm in twin.plant.arms.values())
    assert held
    before = twin.plant.counts()
    assert home_again(twin) == set()
    assert sum(len(arm.grip.held) for arm in twin.plant.arms.values()) == held
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=4 * TRAY_MS)
    counts = twin.plant.counts()
    assert counts.in_cups - before.in_cups + counts.T - before.T >= held
    assert twin.plant.events == []


def test_a_machine_that_moves_is_not_declared_new() -> None:
    """It is refused in homing; in Held, where the question waits for an answer, it is accepted and ends it."""
    twin = lost()
    begin_homing(twin)
    twin.run_until_state(State.RESETTING, within_ms=1_000)
    twin.run_for(300)
    declare(twin)
    assert refusals(twin)[-1][:2] == ("new_machine", Refusal.MOVING)
    assert phase(twin) == FORGOTTEN
    twin.run_until_state(State.HELD, within_ms=40_000)
    assert questions(twin) == {"tray"}
    declare(twin)
    assert (questions(twin), phase(twin)) == (set(), MOVING_OUT)
    assert home_again(twin) == set()
    assert twin.plant.conveyor.placed_tray == 1


AT: dict[str, Callable[[Twin], None]] = {
    "Stopped": lambda twin: twin.run_for(100),
    "Idle": lambda twin: twin.home(),
    "Execute": lambda twin: run_to("slide to feed")(twin, "left"),
}


@pytest.mark.parametrize("moment", AT)
def test_a_machine_with_valid_memory_is_not_declared_new(moment: str) -> None:
    twin = machine()
    AT[moment](twin)
    before = phase(twin), rows(twin), twin.state
    declare(twin)
    assert refusals(twin)[-1][:2] == ("new_machine", Refusal.MEMORY_VALID)
    assert (phase(twin), rows(twin), twin.state) == before


def test_a_lost_memory_that_has_been_answered_is_not_declared_new() -> None:
    twin = lost()
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=40_000)
    twin.command("tray_full")
    twin.run_for(50)
    declare(twin)
    assert refusals(twin)[-1][:2] == ("new_machine", Refusal.MEMORY_VALID)
    assert (phase(twin), rows(twin)) == (IN_PLACE, {FULL})


def test_a_declaration_outlasts_a_loss_of_power() -> None:
    twin = lost()
    declare(twin)
    twin.power_cycle()
    twin.run_for(100)
    assert (twin.alarms(), phase(twin)) == ([], MOVING_OUT)
    assert home_again(twin) == set()
    assert read(twin, "trays_done") == 0
    assert twin.plant.conveyor.placed_tray == 1


def test_a_declaration_in_the_first_scan_after_a_loss_is_accepted() -> None:
    """A client sets the command before the first scan; the memory is empty, and only its loss is reported."""
    twin = machine(trays=2, trays_target=1)
    twin.home()
    twin.store.values = None
    twin.power_cycle()
    twin.plc.write(twin.machine.tags.system.memory_lost, 1)
    declare(twin)
    assert (twin.alarms(), refusals(twin), questions(twin)) == ([], [], set())
    assert (phase(twin), rows(twin)) == (MOVING_OUT, {TAKEN})


@pytest.mark.parametrize(("state", "alarm", "expected"), [(lose, True, FORGOTTEN), (declare_new, False, COMING)])
def test_a_runtime_states_the_memory_before_the_first_scan(
    state: Callable[..., None], alarm: bool, expected: int
) -> None:
    """Without a tray at the sensor, a new machine has none; the claws count as loaded in both cases."""
    plc = Plc(MACHINE.program)
    state(MACHINE.tags, plc)
    assert plc.read(MACHINE.tags.tray.phase) == FORGOTTEN, "stored before the first scan"
    plc.scan(0, [point.level(False) for point in sorted(MACHINE.io_map.inputs, key=lambda each: each.number)])
    assert plc.read(MACHINE.tags.tray.phase) == expected
    assert bool(plc.read(MACHINE.alarms.memory_lost)) is alarm
    assert all(plc.read(arm.loaded) for arm in MACHINE.tags.arms.values())
