"""Unexpected exceptions in the tasks of the plant: outputs are safe, and the process ends with an exit code."""

from __future__ import annotations

import asyncio
import contextlib
import subprocess
import sys

import pytest

from controller.common.supervision.failures import failures
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.plc.client import Advance
from plant_sim.links.real_time import RealTime
from tests.controller.common.modbus_rig import write_coils_pdu
from tests.controller.common.supervision.failure_rig import DefectError, drawn, fresh_counts, patch
from tests.plant_sim.links.block_rig import IO_MAP, Rig, make_module
from tests.real_time import WAIT_S

ALL_ON = write_coils_pdu(0, "1" * 18)
MOST_WRITES = 20_000
"""Limit of the writes, reached only in a failing test."""


@pytest.fixture(autouse=True)
def _counts(monkeypatch: pytest.MonkeyPatch) -> None:
    fresh_counts(monkeypatch)


def check_end(server: PlantServer, task: str) -> None:
    """Write outputs until a defect ends the server; plant time then stands, so that no watchdog acts."""
    rig = Rig(server)
    with pytest.raises(DefectError):
        _serve(rig)
    assert rig.module.outputs == IO_MAP.safe_outputs()
    assert not rig.module.tripped
    assert failures() == {task: 1}


def _serve(rig: Rig) -> None:
    with rig:
        client = rig.client()
        with contextlib.suppress(AssertionError, OSError):  # the server closes the connection
            for _ in range(MOST_WRITES):
                client.ask(ALL_ON)


@pytest.mark.parametrize("failing", drawn("plant time", 200))
def test_a_defect_of_plant_time_ends_the_server_with_safe_outputs(
    failing: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RealTime, "catch_up", lambda _: None)  # plant time passes in the task alone
    patch(monkeypatch, RealTime, "_tick", failing)
    check_end(PlantServer(make_module(), port=0), "plant time")


class DefectivePlc:
    """PLC client whose exchange fails at a drawn moment, after it has switched outputs on."""

    def __init__(self, module: IoModule, failing: int) -> None:
        self._module, self._failing = module, failing

    async def run(self, advance: Advance) -> None:
        for _ in range(self._failing):
            self._module.write_as("PLC", dict.fromkeys(range(18), True))
            advance(exchanged=True)
            await asyncio.sleep(0)
        assert any(self._module.outputs)
        raise DefectError


@pytest.mark.parametrize("failing", [1 + call for call in drawn("plant at a PLC", 200)])
def test_a_defect_of_the_client_of_a_plc_ends_the_server_with_safe_outputs(failing: int) -> None:
    module = make_module()
    plc = DefectivePlc(module, failing)
    check_end(PlantServer(module, port=0, lock_step_ms=1, plc=plc), "plant at a PLC")  # type: ignore[arg-type]


SERVE = """
import sys
from controller.common.stop_request import run_process
from plant_sim.cli.main import main
from plant_sim.links.io_module import IoModule
from plant_sim.links.real_time import RealTime
calls = iter(range({failing}))
tick, make_safe = RealTime._tick, IoModule.make_safe
def failing(*args):
    next(calls)
    return tick(*args)
def told(module):
    make_safe(module)
    print("outputs safe")
RealTime._tick, IoModule.make_safe = failing, told
run_process(lambda stop: main(["serve", "--port", "0"], stop))
"""


@pytest.mark.parametrize("failing", drawn("plant process", 100, 1))
def test_a_defect_of_plant_time_ends_the_process_with_an_exit_code(failing: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SERVE.format(failing=failing)],
        capture_output=True,
        text=True,
        check=False,
        timeout=WAIT_S,
    )
    assert done.stdout.splitlines()[-1] == "outputs safe"
    assert "task plant time: the part ends" in done.stderr
    assert done.returncode == 1
