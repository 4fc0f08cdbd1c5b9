"""Protocol stacks of others against running processes: pymcprotocol, plc-comm-slmp, and mcprotocol from npm.

`ladder run` serves a program whose devices are all writable, and `run` the machine's program with its whitelist. X10 is
the ninth input in every protocol. pymcprotocol has the hexadecimal labels of a Q, so that X10 is its X8; mcprotocol and
plc-comm-slmp with the profile of an FX5 have octal labels.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import Any, Protocol

import pymcprotocol  # type: ignore[import-untyped]
import pytest
from pymcprotocol.mcprotocolerror import MCProtocolError  # type: ignore[import-untyped]
from slmp import SlmpClient, SlmpError, SlmpTarget
from slmp.constants import ModuleIONo

from controller.common.mitsubishi.devices import Device
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.twin.commissioning import program_of
from plant_sim.twin.process import Process
from tests.retained import retained

NODE_FOLDER = Path(__file__).parent / "node"
LIMIT_S = 60.0
ATTEMPTS = 2_000
PROGRAM = """
LD X10
OUT Y10
OUT T0 K5
LD X11
OUT C0 K2
LD M10
MOV D10 D11
END
"""
MACHINE = program_of(load_io_map(DEFAULT_IO_MAP))


class Stack(Protocol):
    """Client of one protocol stack; devices have their FX names."""

    has_states: bool

    def bits(self, first: str, count: int) -> list[bool]: ...

    def words(self, first: str, count: int) -> list[int]: ...

    def write_bits(self, first: str, levels: Sequence[bool]) -> bool: ...

    def write_words(self, first: str, values: Sequence[int]) -> bool: ...


def hexadecimal(name: str) -> str:
    """Return the name of a device as a Q has it: TS0 and CS0 are contacts, X and Y have hexadecimal numbers."""
    device = Device.parsed(name)
    if device.kind in ("X", "Y"):
        return f"{device.kind}0{device.number:X}"
    return f"{device.kind}S{device.number}" if device.kind in ("T", "C") else name


class PyMcProtocol:
    """pymcprotocol (PyPI): frames 3E and 4E in binary and ASCII code; it has no S."""

    has_states = False

    def __init__(self, stack: ExitStack, port: int, *, is_4e: bool, code: str) -> None:
        self.client = pymcprotocol.Type4E() if is_4e else pymcprotocol.Type3E()
        self.client.setaccessopt(commtype=code)
        self.client.connect("127.0.0.1", port)
        stack.callback(self.client.close)

    def bits(self, first: str, count: int) -> list[bool]:
        return [bool(level) for level in self.client.batchread_bitunits(hexadecimal(first), count)]

    def words(self, first: str, count: int) -> list[int]:
        return list(self.client.batchread_wordunits(hexadecimal(first), count))

    def write_bits(self, first: str, levels: Sequence[bool]) -> bool:
        return accepted(lambda: self.client.batchwrite_bitunits(hexadecimal(first), [int(level) for level in levels]))

    def write_words(self, first: str, values: Sequence[int]) -> bool:
        return accepted(lambda: self.client.batchwrite_wordunits(hexadecimal(first), list(values)))


class PlcCommSlmp:
    """plc-comm-slmp (PyPI) with its profile of the FX5: frame 3E in binary code, octal X and Y."""

    has_states = True

    def __init__(self, stack: ExitStack, port: int) -> None:
        target = SlmpTarget(network=0, station=0xFF, module_io=ModuleIONo.OWN_STATION, multidrop=0)
        self.client = SlmpClient(
            "127.0.0.1", port, transport="tcp", default_target=target, plc_profile="melsec:iq-f", timeout=LIMIT_S
        )
        self.client.connect()
        stack.callback(self.client.close)

    @staticmethod
    def name(device: str) -> str:
        return f"{device[0]}S{device[1:]}" if device[0] in "TC" and device[1].isdigit() else device

    def bits(self, first: str, count: int) -> list[bool]:
        return [bool(level) for level in self.client.read_devices(self.name(first), count, bit_unit=True)]

    def words(self, first: str, count: int) -> list[int]:
        return [
            word - 65_536 if word >= 32_768 else word for word in self.client.read_devices(first, count, bit_unit=False)
        ]

    def write_bits(self, first: str, levels: Sequence[bool]) -> bool:
        return accepted(lambda: self.client.write_devices(self.name(first), list(levels), bit_unit=True))

    def write_words(self, first: str, values: Sequence[int]) -> bool:
        return accepted(lambda: self.client.write_devices(first, [value & 0xFFFF for value in values], bit_unit=False))


class NodeMcProtocol:
    """mcprotocol (npm): frame 1E in binary and ASCII code, octal X and Y."""

    has_states = True

    def __init__(self, stack: ExitStack, port: int, *, code: str) -> None:
        node = shutil.which("node")
        assert node is not None, "the tests need nodejs: run scripts/setup dev"
        self.process = subprocess.Popen(
            [node, NODE_FOLDER / "exchange.js", str(port), code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        stack.enter_context(self.process)
        stack.callback(self.process.kill)

    def exchange(self, write: Mapping[str, Any], read: Sequence[str]) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps({"write": write, "read": list(read)}) + "\n")
        self.process.stdin.flush()
        for line in self.process.stdout:
            if line.startswith("{"):
                result: dict[str, Any] = json.loads(line)
                return result
        raise AssertionError("mcprotocol has ended; run scripts/setup dev")

    def bits(self, first: str, count: int) -> list[bool]:
        return [bool(value) for value in self.read(hexadecimal_free(first), count)]

    def words(self, first: str, count: int) -> list[int]:
        return [int(value) for value in self.read(first, count)]

    def read(self, name: str, count: int) -> list[Any]:
        result = self.exchange({}, [f"{name},{count}"])
        assert result["read_failed"] is False, result
        values = result["values"][f"{name},{count}"]
        return values if isinstance(values, list) else [values]

    def write_bits(self, first: str, levels: Sequence[bool]) -> bool:
        return self.write(hexadecimal_free(first), levels)

    def write_words(self, first: str, values: Sequence[int]) -> bool:
        return self.write(first, values)

    def write(self, name: str, values: Sequence[Any]) -> bool:
        item = f"{name},{len(values)}" if len(values) > 1 else name
        failed = self.exchange({item: list(values) if len(values) > 1 else values[0]}, [])["write_failed"]
        return not failed


def hexadecimal_free(name: str) -> str:
    """Return the name of a contact as mcprotocol has it."""
    return f"{name[0]}S{name[1:]}" if name[0] in "TC" and name[1].isdigit() else name


def accepted(write: Any) -> bool:
    """Return False if the PLC answers a write with an end code."""
    try:
        write()
    except (MCProtocolError, SlmpError):
        return False
    return True


STACKS = ["pymcprotocol 3E", "pymcprotocol 3E ASCII", "pymcprotocol 4E", "pymcprotocol 4E ASCII", "plc-comm-slmp"]
STACKS_1E = ["mcprotocol", "mcprotocol ASCII"]


def stack_of(name: str, ports: Mapping[str, int], stack: ExitStack) -> Stack:
    if name.startswith("mcprotocol"):
        return NodeMcProtocol(stack, ports["1e"], code="ascii" if "ASCII" in name else "binary")
    if name == "plc-comm-slmp":
        return PlcCommSlmp(stack, ports["3e"])
    code = "ascii" if "ASCII" in name else "binary"
    return PyMcProtocol(stack, ports["3e"], is_4e="4E" in name, code=code)


# --- any program, all devices writable --------------------------------------------------------------


@pytest.fixture(scope="module")
def ladder_ports(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, int]]:
    """Ports of two processes, one for each frame."""
    file = tmp_path_factory.mktemp("ladder") / "program.il"
    file.write_text(PROGRAM, encoding="utf-8")
    with ExitStack() as stack:
        ports = {}
        for frame in ("1e", "3e"):
            options = ["--serve-mc", frame, "--mc-port", "0", "--input-filter-ms", "0", "--pace", "1000"]
            process = Process(f"ladder {frame}", ["controller", "ladder", "run", str(file), *options])
            stack.enter_context(process)
            ports[frame] = int(json.loads(process.next_line(LIMIT_S) or "{}")["mc_port"])
        yield ports


@pytest.fixture(params=STACKS + STACKS_1E)
def stack(request: pytest.FixtureRequest, ladder_ports: dict[str, int]) -> Iterator[Stack]:
    with ExitStack() as exits:
        yield stack_of(request.param, ladder_ports, exits)


def until_bits(stack: Stack, first: str, expected: list[bool]) -> None:
    for attempt in count():
        if stack.bits(first, len(expected)) == expected:
            return
        assert attempt < ATTEMPTS, f"{first}: {stack.bits(first, len(expected))}"


def until_words(stack: Stack, first: str, expected: list[int]) -> None:
    for attempt in count():
        if stack.words(first, len(expected)) == expected:
            return
        assert attempt < ATTEMPTS, f"{first}: {stack.words(first, len(expected))}"


@pytest.mark.nightly
def test_every_kind_of_device_is_read_and_written(stack: Stack) -> None:
    assert stack.write_bits("X10", [False, False])
    assert stack.write_bits("M10", [False])
    until_bits(stack, "Y10", [False])
    assert stack.write_words("TN0", [0])
    assert stack.write_words("CN0", [0])
    assert stack.write_bits("C0", [False])
    assert stack.write_words("D10", [-5, 0])
    assert not stack.has_states or stack.write_bits("S20", [True, False, True])
    assert stack.write_bits("Y11", [True])
    until_bits(stack, "X6", [False] * 4)
    assert stack.write_bits("X10", [True])
    until_bits(stack, "X6", [False, False, True, False])  # X6 X7 X10 X11
    until_bits(stack, "Y6", [False, False, True, True])  # no coil drives Y11
    if stack.has_states:
        until_bits(stack, "S20", [True, False, True])
    until_words(stack, "TN0", [5])
    until_bits(stack, "T0", [True])
    for value in (1, 2):
        assert stack.write_bits("X11", [True])
        until_words(stack, "CN0", [value])
        assert stack.write_bits("X11", [False])
        until_bits(stack, "X11", [False])
    until_bits(stack, "C0", [True])
    assert stack.write_bits("M10", [True])
    assert stack.words("D10", 2) == [-5, -5]


# --- the machine's program, with a whitelist --------------------------------------------------------


@pytest.fixture(scope="module")
def machine_ports(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, int]]:
    """Ports of two controllers on one plant each, which have run for at least one scan."""
    with ExitStack() as stack:
        ports = {}
        for frame in ("1e", "3e"):
            folder = tmp_path_factory.mktemp(f"machine-{frame}")
            command = ["plant_sim", "serve", "--port", "0", "--lock-step-ms", "10"]
            plant = stack.enter_context(Process(f"plant {frame}", command))
            port = (plant.next_line(LIMIT_S) or "").rpartition(":")[2]
            options = ["--port", port, *retained(folder / "retentive.json"), "--timeout-ms", "5000"]
            options += ["--mc", frame, "--mc-port", "0", "--events", "json", "--no-console", "--no-hmi"]
            options += ["--simulated-time", "--pace", "100"]
            controller = stack.enter_context(Process(f"controller {frame}", ["controller", "run", *options]))
            event: dict[str, Any] = {}
            while event.get("event") != "serving_mc":
                event = json.loads(controller.next_line(LIMIT_S) or "{}")
            ports[frame] = int(event["mc_port"])
            while event.get("event") != "state":
                event = json.loads(controller.next_line(LIMIT_S) or "{}")
        yield ports


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["pymcprotocol 3E", "plc-comm-slmp", "mcprotocol"])
def test_the_machine_is_read_and_commanded_but_not_otherwise_written(machine_ports: dict[str, int], name: str) -> None:
    with ExitStack() as exits:
        stack = stack_of(name, machine_ports, exits)
        tags = MACHINE.tags
        state = tags.machine.state.number
        target = f"D{tags.sp.trays_target.number}"
        assert stack.words(f"D{state}", 1) != [0]
        assert True in stack.bits("X0", 24), "sensors and normally closed contacts are on"
        for other in ("Y0", "M0", "T0", "C0", "X10", *(["S0"] if stack.has_states else [])):
            assert not stack.write_bits(other, [True]), other
        for other in ("D100", "TN0", "CN0", "D8010"):
            assert not stack.write_words(other, [1]), other
        for value in range(3, 23):
            assert stack.write_words(target, [value])
            assert stack.words(target, 1) == [value]
        assert not stack.write_words(target, [30_000])
        refusals = stack.words(f"D{tags.machine.refusals.number}", 1)[0]
        assert stack.write_bits(f"M{tags.commands['suspend'].number}", [True])  # refused by the program in this state
        assert stack.words(f"D{tags.machine.refusals.number}", 1) == [refusals + 1]
