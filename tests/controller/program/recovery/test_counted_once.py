"""Rows and releases are counted once, even if a stop, or two answers, come in the scan that decides."""

from __future__ import annotations

import pytest

from controller.program.operator.refusals import Refusal
from controller.program.states import Mode, State
from controller.program.tags import FULL, IN_DOUBT, IN_PROGRESS, SIDES, TAKEN, Side
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import clear, home_again, questions
from tests.controller.program.recovery.test_questions import machine, power_lost_clamping, rows
from tests.plant_sim.twin.routes import finish, run_to
from tests.plant_sim.twin.twin_rig import is_parked_loaded, tags_of, undisturbed, until_step


def putting_back(side: Side) -> Twin:
    """Return a machine that opens the claws in homing, to put back the row that they had just closed on."""
    twin = machine()
    run_to("close claws")(twin, side)
    twin.run_for(100)
    twin.command("abort")
    twin.run_for(500)
    twin.command("clear")
    twin.run_for(500)
    assert rows(twin, side) == [TAKEN, IN_PROGRESS, FULL]
    twin.command("reset")
    until_step(twin, f"{side} homing", "put back")
    return twin


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("scans_before", [0, 1, 2])
def test_a_stop_in_the_scan_in_which_a_row_is_put_back(side: Side, scans_before: int) -> None:
    """The row is full if the claws have opened for their dwell time, else in progress; nobody is asked about it."""
    twin = putting_back(side)
    arm = tags_of(twin, side)
    dwell = twin.plc.read(twin.machine.tags.sp.release)
    twin.run_until(arm.t_opening.value >= dwell - 1 - scans_before, within_ms=1_000, what="claws nearly open")
    twin.command("abort")
    twin.scan()
    assert rows(twin, side) == [TAKEN, FULL if scans_before == 0 else IN_PROGRESS, FULL]
    twin.run_for(500)
    assert questions(twin) == set()
    clear(twin)
    assert home_again(twin) == {"tray"}
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("other", ["loaded_yes", "discard"])
def test_of_two_answers_the_one_that_assumes_a_load_counts(side: Side, other: str) -> None:
    """The panel and another client answer in the same scan; claws that may hold a row never count as empty."""
    twin = power_lost_clamping(side, "lift_retract", "slide_outward", "lift_extend")
    assert questions(twin) == {f"{side} loaded"}
    twin.command(f"{side}_loaded_no")
    twin.command(f"{side}_{other}")
    twin.run_for(200)
    assert questions(twin) == set()
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    assert home_again(twin) == {"tray"}
    assert is_parked_loaded(twin, side) == (other == "loaded_yes")


@pytest.mark.parametrize("side", SIDES)
def test_a_row_in_doubt_is_not_discarded_while_jogging(side: Side) -> None:
    """In manual mode, the order is refused until the question is answered, because the row would stay in doubt."""
    twin = power_lost_clamping(side)
    twin.command("mode_manual")
    twin.run_for(100)
    twin.command("reset")
    twin.run_for(100)
    twin.command("start")
    twin.run_until_state(State.EXECUTE, within_ms=1_000)
    assert twin.plc.read(twin.machine.tags.machine.mode) == Mode.MANUAL
    twin.command(f"{side}_discard")
    twin.run_for(100)
    assert twin.plc.read(twin.machine.tags.machine.refusal) == Refusal.QUESTION
    assert not twin.plc.read(tags_of(twin, side).discard)
    assert rows(twin, side)[1] == IN_DOUBT
