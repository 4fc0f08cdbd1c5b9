"""Field link loss and late scans: outputs go to their safe states, the fault is latched, and nothing restarts."""

from __future__ import annotations

import pytest

from controller.core.scan import Plc
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.program.states import State
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.recovery import home_again
from tests.controller.program.recovery.cable import CableLink
from tests.plant_sim.twin.twin_rig import moved_from_now_on
from tests.wiring import wired

LIMIT_MS = 100


@pytest.fixture
def cabled() -> tuple[Twin, CableLink]:
    """Return a twin in Execute with the left slide moving inward, and its link, whose cable can be disconnected."""
    twin = Twin(trays=1, set_points={"trays_target": 1})
    twin.home()
    twin.start()
    twin.run_until(twin.step_of("left arm", "approach row"), within_ms=30_000)
    twin.run_for(500)
    assert "left.slide_inward" in twin.outputs()
    return twin, connected(twin)


def connected(twin: Twin) -> CableLink:
    """Connect a twin through a cable that can be disconnected, and return its link."""
    cable = CableLink(twin.module)
    cable.open()
    twin.runtime.field.link = cable
    return cable


def test_a_gap_within_the_limit_is_bridged(cabled: tuple[Twin, CableLink]) -> None:
    """During a gap of 80 ms motion continues and no alarm is raised."""
    twin, cable = cabled
    cable.pulled = True
    twin.run_for(LIMIT_MS - 2 * SCAN_MS)
    cable.pulled = False
    twin.run_for(200)
    assert twin.state == State.EXECUTE
    assert twin.alarms() == []
    assert not twin.module.tripped
    assert "left.slide_inward" in twin.outputs()


def test_a_longer_gap_is_a_latched_fault(cabled: tuple[Twin, CableLink]) -> None:
    """After the cable is disconnected, the fault is latched exactly 100 ms after the last good exchange."""
    twin, cable = cabled
    last_good_ms = twin.now_ms - SCAN_MS
    cable.pulled = True
    twin.run_until(lambda: twin.runtime.link_lost, within_ms=200)
    assert twin.now_ms - SCAN_MS - last_good_ms == LIMIT_MS
    assert twin.outputs() == set()
    assert twin.alarms() == ["link_lost"], "the safe X image must not be reported as an emergency stop"
    # the plant keeps running; its watchdog has switched the outputs off
    assert twin.module.tripped
    assert twin.module.outputs == twin.io_map.safe_outputs()
    assert twin.module.tripped_at_ms is not None
    assert twin.module.last_write_ms is not None
    assert twin.module.tripped_at_ms - twin.module.last_write_ms == LIMIT_MS + 1
    twin.run_for(2_000)
    assert twin.state == State.ABORTED


def test_nothing_restarts_when_the_link_returns(cabled: tuple[Twin, CableLink]) -> None:
    """After reconnection the machine stays in Aborted and at rest until clear, home and start; no seedling is lost."""
    twin, cable = cabled
    cable.pulled = True
    twin.run_for(3_000)
    cable.pulled = False
    moved = moved_from_now_on(twin)
    twin.run_for(2_000)
    assert not twin.runtime.link_lost
    assert twin.state == State.ABORTED
    assert moved == set()
    twin.command("clear")
    twin.run_until_state(State.STOPPED, within_ms=50)
    twin.run_for(1_000)
    assert moved == set()
    assert home_again(twin) == {"tray"}
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=100_000)
    counts = twin.plant.counts()
    assert counts.in_cups + counts.P + counts.D + counts.T == 72
    assert twin.plant.events == []


def test_clear_is_refused_while_the_link_is_lost(cabled: tuple[Twin, CableLink]) -> None:
    """While the field link is lost, a clear command has no effect."""
    twin, cable = cabled
    cable.pulled = True
    twin.run_for(1_000)
    twin.command("clear")
    twin.run_for(100)
    assert twin.state == State.ABORTED


@pytest.mark.parametrize(("late_ms", "expected"), [(200, State.EXECUTE), (201, State.ABORTING)])
def test_a_scan_over_its_limit_is_a_latched_fault(late_ms: int, expected: State) -> None:
    """If a scan begins more than 200 ms after the previous one, the outputs are switched off in that scan."""
    twin = Twin()
    # the field limit is longer, so that only the scan limit applies
    cable, retentive_writer = CableLink(twin.module), DirectRetentiveWriter(twin.store)
    twin.runtime = Runtime(twin.machine, Plc(twin.machine.program), cable, retentive_writer, link_limit_ms=1_000)
    twin.home()
    twin.start()
    twin.run_until(lambda: twin.in_step("left arm", "approach row"), within_ms=30_000)
    twin.clock.advance(late_ms - SCAN_MS)
    twin.runtime.tick(twin.now_ms)
    assert twin.state == expected
    if expected == State.ABORTING:
        assert twin.outputs() == set()
        assert "scan_fault" in twin.alarms()


def test_a_field_that_never_responded_is_a_lost_link_from_the_first_scan() -> None:
    """If the field does not respond at power-up, the machine aborts immediately with the link alarm only."""
    twin = Twin()
    cable = CableLink(twin.module)
    cable.pulled = True
    twin.runtime = Runtime(twin.machine, Plc(twin.machine.program), cable, DirectRetentiveWriter(twin.store))
    twin.run_for(2 * SCAN_MS)
    assert twin.state == State.ABORTING
    assert twin.outputs() == set()
    assert twin.alarms() == ["link_lost"]


def test_the_field_recovers_with_horn_and_red_lamp_wired() -> None:
    """The tripped module receives the safe image that it requires, even though the horn and the red lamp are on."""
    twin = Twin(trays=1, io_map=wired("horn", "lamp_red"))
    twin.home()
    twin.start()
    twin.run_until(twin.step_of("left arm", "spread"), within_ms=30_000)
    cable = connected(twin)
    cable.pulled = True
    twin.run_until(lambda: twin.module.tripped, within_ms=200)
    twin.run_for(1_000)
    cable.pulled = False
    twin.run_until(lambda: not twin.runtime.link_lost and not twin.module.tripped, within_ms=1_000)
    twin.run_for(100)
    assert twin.state == State.ABORTED
    assert {"lamp_red", "horn"} <= twin.outputs()
