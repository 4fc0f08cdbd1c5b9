"""Watchdogs of the controller: field timeout, late scan, panel timeout."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Levels

import pytest

from controller.core.clock import SimulatedClock
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.events.kinds import StateEvent
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.program.states import Reason, State
from plant_sim.twin.commissioning import default_io_map, program_of
from plant_sim.twin.lock_step import SCAN_MS, Twin
from tests.plant_sim.twin.twin_rig import at_work, scan_ms, undisturbed

MACHINE = program_of(default_io_map())
LIMIT_MS, TIMEOUT_MS = 100, 30
"""Time limit for detecting the loss of the link, and timeout of a request, ms."""
PANEL_LIMIT_MS = 1_000


class HungField:
    """Field I/O that responds immediately until it hangs; then every request takes its full timeout."""

    def __init__(self, clock: SimulatedClock) -> None:
        self._clock = clock
        self.hangs = False
        self.last_good_ms = 0

    def open(self) -> None:
        """Do nothing; a hung process still accepts connections."""

    def read_inputs(self) -> list[bool]:
        self._answer()
        levels = MACHINE.io_map.safe_inputs()
        for point in MACHINE.io_map.inputs:
            levels[point.number] = point.level(False)
        return levels

    def write_outputs(self, image: Levels[bool]) -> None:
        self._answer()
        self.last_good_ms = self._clock.now_ms()

    def write_registers(self, values: Levels[int]) -> None:
        self._answer()

    def close(self) -> None:
        """Do nothing."""

    def _answer(self) -> None:
        if self.hangs:
            self._clock.advance(TIMEOUT_MS)
            raise OSError("no answer")


@pytest.mark.parametrize("hangs_at_ms", [200, 210, 220, 230])
def test_the_loss_of_a_hung_field_is_detected_within_its_limit(hangs_at_ms: int) -> None:
    """If the field hangs between two scans, the fault is latched at most 100 ms after the last good exchange."""
    clock = SimulatedClock()
    field = HungField(clock)
    plc = Plc(MACHINE.program)
    runtime = Runtime(
        MACHINE,
        plc,
        field,
        DirectRetentiveWriter(MemoryStore()),
        link_limit_ms=LIMIT_MS,
        link_wait_ms=TIMEOUT_MS + SCAN_MS,
    )
    due_ms = 0
    latched_ms = None
    while latched_ms is None and due_ms < 1_000:
        clock.advance(max(0, due_ms - clock.now_ms()))
        field.hangs = due_ms >= hangs_at_ms
        runtime.tick(due_ms)
        if plc.read(MACHINE.tags.machine.state) in (State.ABORTING, State.ABORTED):
            latched_ms = clock.now_ms()
        due_ms += SCAN_MS
        if clock.now_ms() > due_ms:
            due_ms += (clock.now_ms() - due_ms) // SCAN_MS * SCAN_MS
    assert latched_ms is not None
    assert field.last_good_ms == hangs_at_ms - SCAN_MS
    assert TIMEOUT_MS < latched_ms - field.last_good_ms <= LIMIT_MS
    assert plc.read(MACHINE.alarms.link_lost)


def test_a_field_with_one_missing_response_is_not_lost() -> None:
    """If one request receives no response, the next response arrives in time and no loss is detected."""
    clock = SimulatedClock()
    field = HungField(clock)
    plc = Plc(MACHINE.program)
    runtime = Runtime(
        MACHINE,
        plc,
        field,
        DirectRetentiveWriter(MemoryStore()),
        link_limit_ms=LIMIT_MS,
        link_wait_ms=TIMEOUT_MS + SCAN_MS,
    )
    for due_ms in (0, 10, 20, 50, 60, 70):
        clock.advance(max(0, due_ms - clock.now_ms()))
        field.hangs = due_ms == 20
        runtime.tick(due_ms)
        assert not runtime.link_lost
    assert plc.read(MACHINE.tags.machine.state) == State.STOPPED


@pytest.mark.parametrize(("gap_ms", "faulty"), [(200, False), (210, True)])
def test_a_scan_over_its_limit_is_latched(gap_ms: int, faulty: bool) -> None:
    """A scan interval over the limit aborts the machine and latches the alarm; one equal to the limit does neither."""
    clock = SimulatedClock()
    plc = Plc(MACHINE.program)
    runtime = Runtime(MACHINE, plc, HungField(clock), DirectRetentiveWriter(MemoryStore()), link_limit_ms=1_000)
    for at_ms in (0, 10, 10 + gap_ms, 20 + gap_ms, 30 + gap_ms):
        runtime.tick(at_ms)
    assert bool(plc.read(MACHINE.alarms.scan_fault)) == faulty
    assert plc.read(MACHINE.tags.machine.state) == (State.ABORTED if faulty else State.STOPPED)


# the panel


def watched_panel(twin: Twin) -> Twin:
    """Start the panel supervision with a single request."""
    twin.runtime.panel.limit_ms = PANEL_LIMIT_MS
    twin.runtime.panel.heartbeat()
    return twin


def speak_until(twin: Twin, reached: Callable[[], bool]) -> None:
    """Run until a condition is true, with a panel that sends a request every 500 ms."""
    while not reached():
        if twin.now_ms % 500 == 0:
            twin.runtime.panel.heartbeat()
        twin.scan()


def test_a_panel_timeout_lets_the_cycle_finish_and_holds() -> None:
    """After the timeout the machine holds and reports the reason; unhold resumes work without the panel."""
    twin = watched_panel(at_work({"trays_target": 1}))
    silent_from_ms = twin.now_ms + 5_000
    speak_until(twin, lambda: twin.now_ms >= silent_from_ms)
    assert twin.state is State.EXECUTE
    heard_ms = max(ms for ms in range(0, silent_from_ms, 500))
    twin.run_until_state(State.HOLDING, within_ms=PANEL_LIMIT_MS + SCAN_MS)
    assert scan_ms(twin) == heard_ms + PANEL_LIMIT_MS
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert twin.plc.read(twin.machine.tags.machine.reason) == Reason.PANEL_SILENT
    assert twin.alarms() == ["hmi_silent"]
    held = [event for event in twin.events if isinstance(event, StateEvent) and event.state == State.HELD]
    assert held[-1].reason.en == "operator panel not responding"
    twin.command("unhold")
    twin.run_until_state(State.COMPLETE, within_ms=120_000)
    assert twin.plant.counts() == undisturbed()


def test_a_panel_request_ends_its_timeout_warning() -> None:
    """One request from the panel resets the warning."""
    twin = watched_panel(at_work({"trays_target": 1}))
    twin.run_until(lambda: twin.alarms() == ["hmi_silent"], within_ms=PANEL_LIMIT_MS + 2 * SCAN_MS)
    twin.runtime.panel.heartbeat()
    twin.scan()
    assert twin.alarms() == []


def test_a_panel_that_never_connected_does_not_hold_the_machine() -> None:
    """If no panel has ever connected, no alarm is raised and the machine stays in Execute."""
    twin = at_work({"trays_target": 1})
    twin.runtime.panel.limit_ms = PANEL_LIMIT_MS
    twin.run_for(5_000)
    assert (twin.state, twin.alarms()) == (State.EXECUTE, [])
