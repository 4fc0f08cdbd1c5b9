"""Service manager: messages of a real controller, and the delivered unit files."""

from __future__ import annotations

import configparser
import json
import os
import shlex
import shutil
import socket
import subprocess
from pathlib import Path
from typing import Any

import pytest

from controller.cli.main import COMMAND_LINE as CONTROLLER
from controller.common.command_line import USAGE_ERROR
from controller.common.real_time import DEFAULT_PRIORITY
from controller.common.service_manager import ALIVE, ALIVE_MS, READY, STOPPING, ServiceManager
from controller.program.states import State
from plant_sim.cli.main import COMMAND_LINE as PLANT
from plant_sim.twin.operator import Operator
from plant_sim.twin.process import Process
from tests.paths import DOCS
from tests.real_time import LOCK_STEP, SIMULATED, WAIT_S
from tests.retained import retained

FOLDER = DOCS / "examples" / "systemd"
KIOSK = "transplanter-kiosk.service"
"""Unit of the screen, which starts programs of the system only."""
UNITS = sorted(path.name for path in FOLDER.glob("*.service") if path.name != KIOSK)
LINES = {"transplanter-controller": CONTROLLER, "transplanter-plant": PLANT}
PREFIX = "/opt/transplanter"


@pytest.fixture
def manager(tmp_path: Path) -> Any:
    """Return the socket of a service manager."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(tmp_path / "notify"))
        receiver.settimeout(WAIT_S)
        yield receiver


@pytest.mark.nightly
def test_the_manager_is_told_when_the_field_responds_and_that_scans_go_on(
    manager: socket.socket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = str(reserved.getsockname()[1])
    monkeypatch.setenv("NOTIFY_SOCKET", manager.getsockname())
    arguments = ["--port", port, *retained(tmp_path / "r.json"), "--hmi-port", "0", "--no-console"]
    with Process("controller", ["controller", "run", *arguments, *SIMULATED]) as controller:
        assert controller.next_line(WAIT_S)  # serves its panels while the field does not respond
        manager.setblocking(False)
        with pytest.raises(BlockingIOError):
            manager.recv(100)
        manager.settimeout(WAIT_S)
        with Process("plant", ["plant_sim", "serve", "--port", port, *LOCK_STEP]) as plant:
            assert plant.next_line(WAIT_S)
            assert [manager.recv(100).decode() for _ in range(4)] == [READY, ALIVE, ALIVE, ALIVE]
            assert controller.stop() == 0
        while (message := manager.recv(100).decode()) == ALIVE:
            pass
        assert message == STOPPING


def test_messages_are_limited_to_one_per_interval(manager: socket.socket) -> None:
    told = ServiceManager({"NOTIFY_SOCKET": manager.getsockname()})
    for now_ms in range(0, 2 * ALIVE_MS + 1, 10):
        told.alive(now_ms)
    told.close()
    assert [manager.recv(100).decode() for _ in range(4)] == [ALIVE, ALIVE, ALIVE, STOPPING]


def test_an_abstract_socket_is_reached() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(f"\0transplanter-test-{os.getpid()}")
        receiver.settimeout(WAIT_S)
        told = ServiceManager({"NOTIFY_SOCKET": f"@transplanter-test-{os.getpid()}"})
        told.send(READY)
        assert receiver.recv(100).decode() == READY
        told.close()


def test_a_manager_that_has_gone_does_not_disturb_the_scan(tmp_path: Path) -> None:
    told = ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "nothing")})
    told.alive(0)
    told.close()
    ServiceManager({}).alive(0)


@pytest.mark.nightly
def test_a_restarted_controller_waits_in_stopped_with_its_outputs_safe(tmp_path: Path) -> None:
    """As after a restart by systemd: the controller is killed while an arm moves, and started with the same memory."""
    options = ["--retain", str(tmp_path / "r.json"), "--no-hmi", "--no-console", "--events", "json"]
    with Process("plant", ["plant_sim", "serve", "--port", "0", *LOCK_STEP]) as plant:
        port = (plant.next_line(WAIT_S) or "").rpartition(":")[2]
        command = ["controller", "run", "--port", port, *options, *SIMULATED, "--pace", "65535"]
        with Operator("127.0.0.1", int(port)) as operator:
            with Process("controller", command) as controller:
                wait_for(controller, State.STOPPED)
                operator.press("start")
                wait_for(controller, State.RESETTING)
                while not operator.telemetry()["y_image"]:
                    pass
                controller.kill()
            with Process("controller", command) as restarted:
                assert wait_for(restarted, State.STOPPED) == [State.STOPPED]
                begin_ms = operator.telemetry()["time_ms"]
                while (now := operator.telemetry())["time_ms"] < begin_ms + 2_000:
                    assert now["y_image"] == 0


def wait_for(controller: Process, state: State) -> list[int]:
    """Read the events until a state, and return the states on the way."""
    states: list[int] = []
    while state not in states:
        event = json.loads(controller.next_line(WAIT_S) or "{}")
        assert event, "the controller has ended"
        if event["event"] == "state":
            states.append(event["state"])
    return states


def unit(name: str) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=True, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    text = (FOLDER / name).read_text(encoding="utf-8").replace("\\\n", " ")
    parser.read_string(text)
    return parser


@pytest.mark.parametrize("name", UNITS)
def test_the_command_of_a_unit_is_accepted_by_its_program(name: str) -> None:
    service = unit(name)["Service"]
    program, *arguments = shlex.split(service["ExecStart"])
    folder, _, script = program.rpartition("/")
    assert folder == f"{PREFIX}/bin"
    options = LINES[script].parser({arguments[0]}).parse_args(arguments)
    priority = getattr(options, "real_time_priority", None)
    if priority is None:
        assert "LimitRTPRIO" not in service
        assert service["RestrictRealtime"] == "yes"
    else:
        assert (priority, service["LimitRTPRIO"]) == (DEFAULT_PRIORITY, str(DEFAULT_PRIORITY))
        assert service["LimitMEMLOCK"] == "infinity"


@pytest.mark.parametrize("name", UNITS)
def test_a_unit_restarts_after_a_failure_only_and_not_with_invalid_input(name: str) -> None:
    parser = unit(name)
    service = parser["Service"]
    assert service["Restart"] == "on-failure"
    assert service["RestartPreventExitStatus"] == str(USAGE_ERROR)
    assert int(parser["Unit"]["StartLimitBurst"]) * int(service["RestartSec"]) < int(
        parser["Unit"]["StartLimitIntervalSec"]
    ), "the limit of restarts is never reached"
    assert service["LogNamespace"] == "transplanter"
    assert (FOLDER / f"journald@{service['LogNamespace']}.conf").exists()


def test_the_watchdog_of_the_controller_allows_several_missing_messages() -> None:
    service = unit("transplanter-controller.service")["Service"]
    assert service["Type"] == "notify"
    assert int(service["WatchdogSec"]) * 1_000 >= 4 * ALIVE_MS


def test_the_screen_waits_for_the_panel_and_is_always_restarted() -> None:
    service = unit(KIOSK)["Service"]
    panel = "http://127.0.0.1:8080"
    assert shlex.split(service["ExecStart"])[-1] == panel
    assert shlex.split(service["ExecStartPre"])[-1] == f"{panel}/api/me"
    assert service["Restart"] == "always"
    assert unit(KIOSK)["Unit"]["StartLimitIntervalSec"] == "0"


@pytest.mark.parametrize("name", [*UNITS, KIOSK])
def test_systemd_accepts_the_unit(name: str, tmp_path: Path) -> None:
    """Every directive has a section and a name that systemd knows; where systemd is installed, it checks the values."""
    assert unit(name).sections() == ["Unit", "Service", "Install"]
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        return
    binaries = tmp_path / "bin"
    binaries.mkdir()
    for script in (*LINES, "cage", "curl"):
        (binaries / script).write_text("#!/bin/sh\n", encoding="utf-8")
        (binaries / script).chmod(0o755)
    for each in [*UNITS, KIOSK]:
        text = (FOLDER / each).read_text(encoding="utf-8").replace(PREFIX, str(tmp_path))
        text = text.replace("/usr/bin/cage", f"{binaries}/cage").replace("/usr/bin/curl", f"{binaries}/curl")
        (tmp_path / each).write_text(text, encoding="utf-8")
    done = subprocess.run(
        [analyze, "verify", "--man=no", str(tmp_path / name)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
