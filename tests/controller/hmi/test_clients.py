"""Third-party clients connected to the controller's server during a trial: mbpoll, pyModbusTCP, modbus_tk, pymodbus."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pytest
from modbus_tk import defines, modbus_tcp  # type: ignore[import-untyped]
from pymodbus.client import ModbusTcpClient
from pyModbusTCP.client import ModbusClient  # type: ignore[import-untyped]

from controller.hmi.access.tag_list import tag_csv
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.states import State
from plant_sim.twin.operator import Operator
from plant_sim.twin.process import Process
from tests.retained import retained

LIMIT_S = 60.0
FASTEST, REAL_TIME, PAUSED = 65_535, 100, 0
SERVER_BUSY = 6
MBPOLL_LIMIT_S = 60.0

Rows = dict[str, dict[str, str]]


@dataclass(frozen=True)
class Scene:
    """Trial in Execute, with the tag list as imported into an HMI project."""

    port: int
    tags: Rows

    def address(self, name: str) -> int:
        return int(self.tags[name]["address"])


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    folder = tmp_path_factory.mktemp("trial")
    with ExitStack() as stack:
        plant = stack.enter_context(Process("plant", ["plant_sim", "serve", "--port", "0", "--lock-step-ms", "10"]))
        port = int((plant.next_line(LIMIT_S) or "").rpartition(":")[2])
        operator = stack.enter_context(Operator("127.0.0.1", port))
        controller = stack.enter_context(
            Process(
                "controller",
                [
                    "controller",
                    "run",
                    "--port",
                    str(port),
                    *retained(folder / "retentive.json"),
                    "--events",
                    "json",
                    "--no-console",
                    "--hmi-port",
                    "0",
                    "--simulated-time",
                    "--pace",
                    str(FASTEST),
                    "--timeout-ms",
                    "5000",
                ],
            )
        )
        hmi_port = int(json.loads(controller.next_line(LIMIT_S) or "{}")["hmi_port"])
        for state in (State.STOPPED, State.IDLE):
            until_state(controller, state)
            operator.press("start")
        until_state(controller, State.EXECUTE)
        rows = csv.DictReader(io.StringIO(tag_csv(build(load_io_map(DEFAULT_IO_MAP)))))
        yield Scene(hmi_port, {row["name"]: row for row in rows})


def until_state(controller: Process, state: State) -> None:
    while True:
        event = json.loads(controller.next_line(LIMIT_S) or "{}")
        if event["event"] == "state" and event["state"] == state:
            return


@pytest.fixture
def client(scene: Scene) -> Iterator[ModbusClient]:
    client = ModbusClient("127.0.0.1", scene.port, timeout=10.0)
    assert client.open()
    yield client
    client.close()


def word(client: ModbusClient, scene: Scene, name: str) -> int:
    answer = client.read_holding_registers(scene.address(name), 1)
    assert answer is not None, (name, client.last_error_as_txt, client.last_except_as_full_txt)
    return int(answer[0])


def by_modbus_tcp(client: ModbusClient, row: dict[str, str]) -> list[int]:
    address, words = int(row["address"]), int(row["words"])
    read = {"coil": client.read_coils, "discrete": client.read_discrete_inputs}.get(row["table"])
    answer = read(address, 1) if read else client.read_holding_registers(address, words)
    assert answer is not None, row
    return [int(value) for value in answer]


def by_modbus_tk(master: modbus_tcp.TcpMaster, row: dict[str, str]) -> list[int]:
    functions = {"coil": defines.READ_COILS, "discrete": defines.READ_DISCRETE_INPUTS}
    function_code = functions.get(row["table"], defines.READ_INPUT_REGISTERS)
    answer: Any = master.execute(1, function_code, int(row["address"]), int(row["words"]) or 1)
    return list(answer)


def mbpoll(port: int, *arguments: str) -> str:
    program = shutil.which("mbpoll")
    assert program is not None, "mbpoll is not installed: apt-get install mbpoll"
    done = subprocess.run(
        [program, "-m", "tcp", "-p", str(port), "-0", "-1", "-o", "10", "127.0.0.1", *arguments],
        check=False,
        capture_output=True,
        text=True,
        timeout=MBPOLL_LIMIT_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def mbpoll_values(port: int, table: str, address: int, number: int) -> list[int]:
    printed = mbpoll(port, "-t", table, "-r", str(address), "-c", str(number))
    found = re.findall(r"^\[(\d+)\]:\s+(\S+)", printed, re.MULTILINE)
    assert [int(where) for where, _ in found] == list(range(address, address + number)), printed
    return [int(value) for _, value in found]


def test_every_tag_reads_the_same_with_two_clients(scene: Scene, client: ModbusClient) -> None:
    """While the simulation is paused, two clients read the same value of every tag."""
    master = modbus_tcp.TcpMaster("127.0.0.1", scene.port, timeout_in_sec=10.0)
    try:
        assert client.write_single_register(scene.address("simulation.pace"), PAUSED)
        before = -1
        while (now := word(client, scene, "controller.scans")) != before:
            before = now
        rows = [row for row in scene.tags.values() if row["access"] != "write"]
        assert len(rows) > 200
        for row in rows:
            assert by_modbus_tcp(client, row) == by_modbus_tk(master, row), row["name"]
        assert word(client, scene, "machine.state") == State.EXECUTE
        assert word(client, scene, "machine.mode") == 1
        cups = word(client, scene, "set.no_cups")
        assert client.write_single_register(scene.address("set.no_cups"), cups + 1) is False
        assert client.last_except == SERVER_BUSY
    finally:
        client.write_single_register(scene.address("simulation.pace"), REAL_TIME)
        master.close()


def test_set_points_are_within_the_limits_of_the_list(scene: Scene, client: ModbusClient) -> None:
    rows = [row for name, row in scene.tags.items() if name.startswith("set.")]
    assert len(rows) == 26
    for row in rows:
        assert int(row["lowest"]) <= by_modbus_tcp(client, row)[0] <= int(row["highest"]), row


def test_pymodbustcp_writes_a_set_point_and_a_command(scene: Scene, client: ModbusClient) -> None:
    assert client.write_single_register(scene.address("set.no_cups"), 61)
    assert word(client, scene, "set.no_cups") == 61
    assert client.write_multiple_registers(scene.address("set.no_cups"), [62])
    assert word(client, scene, "set.no_cups") == 62
    refused = word(client, scene, "machine.refusals")
    assert client.write_single_coil(scene.address("command.clear"), True)
    assert word(client, scene, "machine.refusals") == refused + 1
    assert client.write_single_coil(scene.address("io.left.lift_extend"), True) is False
    assert client.last_except == 2
    assert client.write_single_register(scene.address("set.no_cups"), 6_001) is False
    assert client.last_except == 3


def test_modbus_tk_writes_a_set_point_and_a_command(scene: Scene, client: ModbusClient) -> None:
    master = modbus_tcp.TcpMaster("127.0.0.1", scene.port, timeout_in_sec=10.0)
    try:
        master.execute(1, defines.WRITE_SINGLE_REGISTER, scene.address("set.no_tray"), output_value=201)
        assert word(client, scene, "set.no_tray") == 201
        refused = word(client, scene, "machine.refusals")
        master.execute(1, defines.WRITE_SINGLE_COIL, scene.address("command.clear"), output_value=1)
        assert word(client, scene, "machine.refusals") == refused + 1
        assert master.execute(1, defines.READ_HOLDING_REGISTERS, scene.address("set.no_tray"), 1) == (201,)
    finally:
        master.close()


def test_pymodbus_reads_what_it_has_written(scene: Scene, client: ModbusClient) -> None:
    """At the speed of a real machine, at which a scan is due 10 ms after the last: 0 of 60 reads are stale."""
    address = scene.address("set.settle")
    with ModbusTcpClient("127.0.0.1", port=scene.port, timeout=10.0) as master:
        try:
            assert not master.write_register(scene.address("simulation.pace"), REAL_TIME).isError()
            for value in range(10, 30):
                assert not master.write_register(address, value).isError()
                assert master.read_holding_registers(address, count=1).registers == [value]
                both = master.readwrite_registers(
                    read_address=address, read_count=1, write_address=address, values=[value + 20]
                )
                assert both.registers == [value + 20]
                refused = word(client, scene, "machine.refusals")
                assert not master.write_coil(scene.address("command.clear"), True).isError()
                assert word(client, scene, "machine.refusals") == refused + 1
        finally:
            client.write_single_register(scene.address("simulation.pace"), REAL_TIME)


def test_mbpoll_reads_every_table(scene: Scene, client: ModbusClient) -> None:
    first = scene.address("set.trays_target")
    assert mbpoll_values(scene.port, "4", first, 15) == client.read_holding_registers(first, 15)
    assert mbpoll_values(scene.port, "3", first, 15) == client.read_holding_registers(first, 15)
    stop = scene.tags["io.stop"]
    assert stop["table"] == "discrete"
    assert mbpoll_values(scene.port, "1", int(stop["address"]), 1) == by_modbus_tcp(client, stop)
    assert mbpoll_values(scene.port, "0", scene.address("machine.manual"), 1) == [0]


@pytest.mark.nightly
def test_mbpoll_writes_a_set_point_and_a_command(scene: Scene, client: ModbusClient) -> None:
    mbpoll(scene.port, "-t", "4", "-r", str(scene.address("set.settle")), "12")
    assert word(client, scene, "set.settle") == 12
    refused = word(client, scene, "machine.refusals")
    mbpoll(scene.port, "-t", "0", "-r", str(scene.address("command.clear")), "1")
    assert word(client, scene, "machine.refusals") == refused + 1


@pytest.mark.nightly
def test_polling_does_not_delay_the_trial(scene: Scene, client: ModbusClient) -> None:
    scans = word(client, scene, "controller.scans")
    for _ in range(1_000):
        client.read_holding_registers(0, 125)
        if word(client, scene, "controller.scans") != scans:
            break
    else:
        pytest.fail("no scan during 1,000 polls")
    assert word(client, scene, "machine.state") in {State.EXECUTE, State.SUSPENDED, State.COMPLETE, State.COMPLETING}
