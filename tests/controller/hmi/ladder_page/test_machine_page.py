"""Ladder page of the machine's program at work, beside what another client reads, and the command as a process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx
import pytest
from pymodbus.client import ModbusTcpClient

from controller.cli.ladder.page_server import program_of_machine
from controller.cli.main import main as controller
from controller.core.clock import MonotonicClock
from controller.core.devices import device_name
from controller.hmi.ladder_page import live_source
from controller.hmi.ladder_page.live_source import LiveSource
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.fx3u_map import bit_spans
from plant_sim.faults import parse_fault
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.process import Process
from tests.controller.common.modbus_rig import PATIENT_S
from tests.controller.hmi.hmi_rig import HmiRig
from tests.controller.hmi.ladder_page.evaluation import end_states
from tests.controller.hmi.ladder_page.page_rig import TIMEOUT_S, WebRig
from tests.controller.program.interlock_scene import MACHINE

MOST_BITS = 1_600


def devices(port: int) -> dict[str, bool]:
    """Return all bit devices as another Modbus client reads them."""
    found: dict[str, bool] = {}
    with ModbusTcpClient("127.0.0.1", port=port, timeout=PATIENT_S) as client:
        for span in bit_spans("discrete"):
            for first in range(0, span.count, MOST_BITS):
                count = min(MOST_BITS, span.count - first)
                bits = client.read_discrete_inputs(span.first + first, count=count).bits[:count]
                found |= {device_name(span.kind, span.number + first + n): on for n, on in enumerate(bits)}
    return found


@pytest.mark.nightly
def test_every_contact_and_coil_of_the_machine_beside_another_client(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_source, "PERIOD_MS", 0)
    twin = Twin(seed=1, trays=1, machine=MACHINE, faults=[parse_fault("stuck_off:left.lift_down@14s..17s")])
    with HmiRig(twin) as rig:
        rig.scans_for_writes = False
        program, work = program_of_machine(MACHINE)
        connection = ModbusConnection("127.0.0.1", rig.server.port, timeout_s=PATIENT_S)
        with WebRig(LiveSource(program, connection, MonotonicClock(), work)) as web:
            twin.home()
            twin.start()
            for _ in range(12):
                twin.run_for(1_510)
                expected = end_states(program.ladder, devices(rig.server.port).__getitem__)
                shown: dict[str, str] = {}
                for first in range(0, len(program.reference.rungs), 100):
                    shown |= web.look("end", first=first)["symbols"]
                assert {at: shown[str(at)] for at in expected if shown[str(at)] != expected[at]} == {}
                executed = web.look("executed")
                assert (executed["scan"], executed["differing"], executed["known"]) == (twin.plc.scans, [], True)
                answer = web.get("/api/why", device="Y2").json()
                assert answer["available"]
                assert answer["lines"][0]["text"]["en"].startswith("Why is Y2 left.lift_retract ")
                assert answer["lines"][-1]["text"]["zh"] == "未经重放证明：此前的扫描未记录"
            assert len(expected) > 4_000


@pytest.mark.nightly
def test_the_command_shows_a_live_program(tmp_path: Path) -> None:
    file = tmp_path / "program.il"
    file.write_text("LD M8013\nOUT Y0\nLDI Y0\nOUT Y1\nEND\n", encoding="utf-8")
    run = ["controller", "ladder", "run", str(file), "--serve-modbus", "--modbus-port", "0"]
    with Process("program", run) as program:
        port = json.loads(program.next_line(TIMEOUT_S) or "")["modbus_port"]
        page = ["controller", "ladder", "page", str(file), "--connect", f"127.0.0.1:{port}", "--port", "0"]
        with Process("page", page) as server:
            url = (server.next_line(TIMEOUT_S) or "").split()[-1]
            look: dict[str, Any] = {"state": "starting"}
            while "state" in look:
                look = httpx.get(f"{url}/api/look?view=executed&first=0&count=9", timeout=TIMEOUT_S).json()
            assert (look["differing"], look["known"]) == ([], True)
            assert {look["symbols"]["1"], look["symbols"]["3"]} == {"on", "off"}


def test_invalid_options_are_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "program.il"
    file.write_text("LD X0\nOUT Y0\nEND\n", encoding="utf-8")
    for options, told in (
        ([], "ladder page: give either the file of a program or --machine"),
        ([str(file), "--machine"], "ladder page: give either the file of a program or --machine"),
        ([str(file), "--connect", "5021"], "--connect 5021: must be HOST:PORT"),
        ([str(file), "--host", "192.0.2.1"], "--host 192.0.2.1: the page has no login"),
    ):
        assert controller(["ladder", "page", *options]) == 2
        assert told in capsys.readouterr().err
