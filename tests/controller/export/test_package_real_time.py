"""Package for OpenPLC in real time: scans are paced, and the clocks advance, as its runtime does it."""

from __future__ import annotations

import time
from contextlib import ExitStack
from threading import Event

import pytest

from controller.export.runtime_parts.part import SCAN_MS
from controller.io.modbus_tcp import ModbusTcpLink
from controller.program.states import State
from plant_sim.twin.operator import Operator, counts_of
from tests.controller.export.package_rig import FROM_ZERO, LIMIT_S, PackageRig, plant_process, rig
from tests.controller.program.interlock_scene import MACHINE
from tests.real_time import LATE_MS

SEED, TRAYS = 1, 2
READ_EVERY = 5
"""Scans from one reading of the link word to the next; it must be shorter than the limit of the link."""


class Pace:
    """Absolute pace of the scans: a late scan is followed by scans without a pause.

    Attributes:
        latest_ms: Longest lateness of a scan, ms.
    """

    def __init__(self) -> None:
        self.latest_ms = 0.0
        self._start_ns = time.monotonic_ns()
        self._never = Event()

    def wait(self, machine: PackageRig) -> None:
        """Wait for the next scan, and set the clocks of the runtime."""
        machine.clock_ms += SCAN_MS  # counts scans
        due_ns = self._start_ns + machine.clock_ms * 1_000_000
        self._never.wait(max(0, due_ns - time.monotonic_ns()) / 1e9)
        machine.utc_ms = (time.monotonic_ns() - self._start_ns) // 1_000_000
        late_ns = max(0, time.monotonic_ns() - due_ns)
        machine.late_us = late_ns // 1_000 % 1_000_000
        self.latest_ms = max(self.latest_ms, late_ns / 1e6)


@pytest.mark.nightly
@pytest.mark.real_time
def test_a_package_completes_a_trial_in_real_time() -> None:
    """All seedlings are accounted for, without a fault of the clocks or of the link.

    On a computer that delays a scan beyond the limits, the machine must abort and say why.
    """
    machine = rig("openplc")
    machine.write(MACHINE.tags.sp.trays_target, TRAYS)
    with ExitStack() as stack:
        port = stack.enter_context(plant_process("--watchdog-ms", "500", seed=SEED, trays=TRAYS))
        operator = stack.enter_context(Operator("127.0.0.1", port))
        link = ModbusTcpLink("127.0.0.1", port, MACHINE.io_map, timeout_s=LIMIT_S)
        stack.callback(link.close)
        link.open()
        pace = Pace()
        for button, pressed, until in FROM_ZERO:
            for n in range(20_000):
                if n in (2, 2 + pressed):
                    operator.hold(button, pressed=n == 2)
                link.write_outputs(machine.outputs(link.read_inputs()))
                if n % READ_EVERY == 0:
                    machine.link_ms = int(operator.telemetry()["time_ms"])
                if (machine.is_in(until) and n > pressed + 10) or machine.is_in(State.ABORTED):
                    break
                pace.wait(machine)
            if machine.is_in(State.ABORTED):
                assert machine.alarm(901) or machine.alarm(902)
                assert pace.latest_ms > LATE_MS
                return
            assert machine.is_in(until), machine.state
        counts = counts_of(operator.telemetry())
    assert counts.in_cups + counts.P + counts.D + counts.T == counts.total == 72 * TRAYS
    assert not machine.alarm(901)
    assert not machine.alarm(902)
