"""A thousand random faults of the link in a trial: no wrong bit is taken as good, nothing is lost or counted twice."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack, suppress

import pytest

from controller.io.link import LinkError, OutputsTakenError
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.output_guard import ModbusOutputGuard, ModuleKind
from controller.io.runtime import Runtime
from controller.program.states import State
from controller.program.tags import SIDES
from plant_sim.crop.incident import Incident
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.plant import Event
from plant_sim.twin.lock_step import SCAN_MS, NotReachedError, Twin
from plant_sim.twin.recovery import clear, home_again
from tests.controller.io.field.faulty_proxy import FaultyProxy
from tests.sampling import first_of

FAULTS = 1_000
"""Number of faults in a trial (issue)."""
TIMEOUT_S = 0.005
"""Timeout of an answer, s. An answer that is late on a busy computer is one more fault."""
SHARE = 0.15
"""Probability of a fault in an exchange of a trial of one tray."""
MOST_SCANS = 60_000
LATE_MS = 200
"""Longest time from a failed exchange to an overrun, ms: the timeout of the link, and the braking of the slide."""
AT_REST = (State.ABORTED, State.STOPPED, State.HELD, State.IDLE)


class CheckedLink(ModbusTcpLink):
    """Link that compares every accepted image with the plant, whose server is idle after a valid answer.

    Attributes:
        accepted: Number of X and of Y images.
        failed: Number of exchanges without a valid answer.
    """

    def __init__(self, twin: FaultTwin, port: int) -> None:
        super().__init__("127.0.0.1", port, twin.io_map, timeout_s=TIMEOUT_S)
        self._twin = twin
        self.accepted = [0, 0]
        self.failed = 0
        self._connections = 0

    def open(self) -> None:
        line = self.devices[0].line
        if not line.is_open:
            self._connections += 1
        try:
            super().open()
        except OSError:
            line.close()
            self._twin.proxy.wait_until_ended(self._connections)
            raise

    def read_inputs(self) -> list[bool]:
        try:
            image = super().read_inputs()
        except OSError:
            self._fail()
            raise
        assert image == self._twin.module.inputs(), "a wrong X image was accepted"
        self.accepted[0] += 1
        return image

    def write_outputs(self, image: Sequence[bool]) -> None:
        before = self._twin.module.outputs
        try:
            super().write_outputs(image)
        except (OSError, OutputsTakenError):
            self._fail()
            assert self._twin.settled_outputs() in (before, list(image)), "a part of an image was written"
            raise
        assert self._twin.module.outputs == list(image), "a write was confirmed that was not executed"
        self.accepted[1] += 1

    def _fail(self) -> None:
        """Count a failed exchange, and wait until its request cannot be executed any more."""
        self.failed += 1
        if not self.devices[0].line.is_open:
            self._twin.proxy.wait_until_ended(self._connections)


class FaultTwin(Twin):
    """Twin whose controller reaches the plant over a real connection with faults.

    Plant time advances with every complete write, and in scans without one by the time that is missing.

    Attributes:
        losses: Number of times that the link was lost.
        pulses: Number of cup pulses, at the terminals and in the program, while the link was not lost.
        overruns: Incidents of a slide that arrived at its row while its stop could not be written, and that homing
            then moved back on the same way; no seedling is damaged (docs/fault-matrix.md).
    """

    def __init__(self, stack: ExitStack, *, seed: int, trays: int) -> None:
        super().__init__(seed=seed, trays=trays, set_points={"trays_target": trays})
        server = PlantServer(self.module, port=0, lock_step_ms=SCAN_MS)
        self.thread = stack.enter_context(ServerThread(server))
        self.proxy = stack.enter_context(FaultyProxy(server.port, seed))
        self.link = CheckedLink(self, self.proxy.port)
        stack.callback(self.link.close)
        guard = ModbusOutputGuard(self.link, every=5)
        self.runtime = Runtime(self.machine, self.plc, self.link, self._writer, guard=guard)
        self.runtime.observers.append(self._log)
        while guard.kinds[self.link.devices[0]] is not ModuleKind.LENDS:  # an answer may be late on a busy computer
            with suppress(LinkError):
                self.link.open()
                guard.identify()
        self.losses = 0
        self.pulses = [0, 0]
        self.overruns: list[Event] = []
        self._failed_ms = -LATE_MS
        self._was_lost = False
        self._cups = [self.io_map[f"{side}.cup_pulse"].number for side in SIDES]
        self._levels = [[True] * len(self._cups) for _ in self.pulses]

    def settled_outputs(self) -> list[bool]:
        """Return the outputs after every request that the server has received."""
        return self.thread.call(lambda: self.module.outputs)

    def scan(self) -> None:
        """Run one scan, and count the cup pulses at the terminals and in the program, and the overruns."""
        images = [self.module.inputs()]
        events, lost = len(self.plant.events), self.plant.counts().P
        super().scan()
        if not self.runtime.field.is_open:
            self._failed_ms = self.now_ms
        late = self.now_ms - self._failed_ms <= LATE_MS or (bool(self.overruns) and self.state is State.RESETTING)
        if late and lost == self.plant.counts().P:
            self.overruns += [e for e in self.plant.events[events:] if e.kind is Incident.ARM_THROUGH_TRAY]
        images.append(self.runtime.field.inputs)
        for n, image in enumerate(images):
            levels = [image[number] for number in self._cups]
            if self.runtime.link_lost:
                levels = [True] * len(levels)
            self.pulses[n] += sum(new and not old for new, old in zip(levels, self._levels[n], strict=True))
            self._levels[n] = levels

    def _advance_plant(self) -> None:
        self.losses += self.runtime.link_lost and not self._was_lost
        self._was_lost = self.runtime.link_lost
        missing_ms = self.clock.now_ms() + SCAN_MS - self.plant.time_ms
        assert missing_ms in (0, SCAN_MS), "a write was executed twice in one scan"
        if missing_ms:
            self.thread.call(lambda: self.module.advance(missing_ms))
        self.clock.advance(SCAN_MS)


def run_trial(twin: FaultTwin) -> None:
    """Run to the end of the trial; after a lost link, clear the abort, home and start, as the operator does."""
    while twin.state is not State.COMPLETE:
        assert twin.now_ms < MOST_SCANS * SCAN_MS, twin.situation()
        if twin.runtime.link_lost or twin.state not in AT_REST:
            twin.scan()
            continue
        share, twin.proxy.share = twin.proxy.share, 0.0
        with suppress(NotReachedError):  # the link was lost again
            resume(twin)
        twin.proxy.share = share


def resume(twin: FaultTwin) -> None:
    if twin.state is State.ABORTED:
        clear(twin)
    if twin.state in (State.STOPPED, State.HELD):
        home_again(twin)
    twin.start()


@pytest.mark.nightly
@pytest.mark.parametrize(("seed", "trays"), first_of([(1, 1), (2, 2), (3, 2), (4, 2)]))
def test_a_thousand_link_faults_in_a_trial(seed: int, trays: int) -> None:
    with ExitStack() as stack:
        twin = FaultTwin(stack, seed=seed, trays=trays)
        twin.scan()
        twin.proxy.share, twin.proxy.limit = SHARE / trays, FAULTS
        run_trial(twin)
        faults = twin.proxy.faults
    assert sum(faults.values()) == FAULTS
    assert {*faults} == twin.proxy.kinds
    assert min(faults.values()) > FAULTS / len(faults) / 2
    assert twin.link.failed > FAULTS / 2
    assert min(twin.link.accepted) > 5_000
    assert twin.losses
    at_terminals, in_program = twin.pulses
    assert 0 <= at_terminals - in_program <= len(SIDES) * twin.losses, "only a pulse before a loss is not seen"
    counts = twin.plant.counts()
    assert counts.in_tray == counts.in_claw == 0
    assert counts.in_cups + counts.P + counts.D + counts.T == counts.total == 72 * trays
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == trays
    assert twin.plant.events == twin.overruns
