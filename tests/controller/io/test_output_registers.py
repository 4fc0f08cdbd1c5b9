"""Output registers: Modbus frames, release at the end of a scan, and the safe value after every failure."""

from __future__ import annotations

from collections.abc import Sequence as Levels
from dataclasses import replace

import pytest

from controller.common.modbus.io_map import OutputRegister
from controller.core.retentive_store import MemoryStore
from controller.core.rungs import Mov
from controller.core.scan import Plc
from controller.io.link import LinkError
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.retentive_writer import DirectRetentiveWriter, RetentiveWriter
from controller.io.runtime import Runtime
from controller.program.machine import build
from controller.program.states import State
from plant_sim.links.in_process import InProcessLink, LinkDown
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from tests.controller.core.core_rig import d, program_of, x
from tests.controller.io.test_modbus_tcp_link import PATIENT_S, ScriptedServer, reply
from tests.wiring import wired

IO_MAP = wired("planter_speed")
MACHINE = load_machine()
(REGISTER,) = IO_MAP.registers
SAFE = 7
"""Safe value in the tests of the runtime, different from 0, the content of an unwritten register."""
PROGRAM = replace(program_of(Mov(456, d(0), when=x(0)), Mov(SAFE, d(0), when=x(1))), output_words=(d(0),))


def make_module() -> IoModule:
    return IoModule(Plant(IO_MAP, MACHINE, seed=1), IO_MAP)


# ---- Modbus TCP -----------------------------------------------------------------------------------------------


def registers(*places: tuple[int, int]) -> tuple[OutputRegister, ...]:
    """Return output registers with the given numbers and offsets."""
    return tuple(replace(REGISTER, number=number, offset=offset) for number, offset in places)


def confirmed(request: bytes) -> bytes:
    return reply(request, request[7:12])


def test_registers_are_written_by_one_request_per_run_of_offsets() -> None:
    """Values are in the order of the map, requests in the order of the offsets."""
    io_map = replace(IO_MAP, registers=registers((0, 11), (3, 10), (5, 40)))
    with ScriptedServer(confirmed) as server:
        link = ModbusTcpLink("127.0.0.1", server.port, io_map, unit=7, timeout_s=PATIENT_S)
        link.open()
        link.write_registers([456, 32_767, 1])
        link.close()
    first, second = server.requests
    assert first[2:] == bytes.fromhex("0000 000b 07 10 000a 0002 04 7fff 01c8")
    assert second[2:] == bytes.fromhex("0000 0009 07 10 0028 0001 02 0001")


def test_a_confirmation_of_a_different_write_is_an_error() -> None:
    with ScriptedServer(lambda q: reply(q, b"\x10\x00\x01\x00\x01")) as server:
        link = ModbusTcpLink("127.0.0.1", server.port, IO_MAP, timeout_s=PATIENT_S)
        link.open()
        with pytest.raises(LinkError, match="write of 1 registers from offset 0: answer confirms 1 from 1"):
            link.write_registers([456])


def test_a_device_without_the_register_is_reported() -> None:
    with ScriptedServer(lambda q: reply(q, b"\x90\x02")) as server:
        link = ModbusTcpLink("127.0.0.1", server.port, IO_MAP, timeout_s=PATIENT_S)
        link.open()
        with pytest.raises(LinkError, match=r"write of 1 registers from offset 0: refused with exception 02"):
            link.write_registers([456])


def test_a_wrong_number_of_values_is_an_error() -> None:
    link = ModbusTcpLink("127.0.0.1", 1, IO_MAP)
    with pytest.raises(ValueError, match="zip"):
        link.write_registers([])


def test_the_plant_receives_the_registers_over_modbus() -> None:
    module = make_module()
    with ServerThread(PlantServer(module, port=0, lock_step_ms=10)) as thread:
        link = ModbusTcpLink("127.0.0.1", thread.server.port, IO_MAP, timeout_s=PATIENT_S)
        link.open()
        link.write_registers([456])
        assert module.plant.planter_speed_m_s == 0.456
        link.close()


def test_the_in_process_link_writes_only_while_it_is_open() -> None:
    module = make_module()
    link = InProcessLink(module)
    with pytest.raises(LinkDown, match="not open"):
        link.write_registers([456])
    link.open()
    link.write_registers([456])
    assert module.registers == {0: 456}
    with pytest.raises(ValueError, match="zip"):
        link.write_registers([1, 2])


# ---- runtime --------------------------------------------------------------------------------------------------


class Strip:
    """Field I/O that records every write in order and fails on request."""

    def __init__(self) -> None:
        self.inputs = IO_MAP.safe_inputs()
        self.written: list[str | list[int]] = []
        self.fails = False
        self.refuses_registers = False

    def open(self) -> None:
        self._check()

    def read_inputs(self) -> list[bool]:
        self._check()
        return self.inputs.copy()

    def write_outputs(self, image: Levels[bool]) -> None:
        self._check()
        self.written.append("outputs")

    def write_registers(self, values: Levels[int]) -> None:
        self._check()
        if self.refuses_registers:
            raise OSError("refused")
        self.written.append(list(values))

    def close(self) -> None:
        """Do nothing."""

    def _check(self) -> None:
        if self.fails:
            raise OSError("no answer")


class Unsettled(DirectRetentiveWriter):
    """Retentive writer that reports unwritten values while `waits` is true."""

    waits = False

    @property
    def settled(self) -> bool:
        return not self.waits


class Cabinet:
    """Runtime of a program that writes 456 to its register while X0 is on, and the safe value while X1 is on."""

    def __init__(self, writer: RetentiveWriter | None = None) -> None:
        io_map = replace(IO_MAP, registers=(replace(REGISTER, safe=SAFE),))
        self.strip = Strip()
        self.plc = Plc(PROGRAM, input_filter_ms=0)
        machine = replace(build(io_map), program=PROGRAM)
        writer = writer or DirectRetentiveWriter(MemoryStore())
        self.runtime = Runtime(machine, self.plc, self.strip, writer, allow_forcing=True)
        self.now_ms = 0

    def tick(self, *on: int, after_ms: int = 10) -> list[str | list[int]]:
        """Run a scan with the given inputs on and return all writes in order."""
        self.strip.inputs[:2] = [number in on for number in range(2)]
        self.strip.written.clear()
        self.runtime.tick(self.now_ms)
        self.now_ms += after_ms
        return self.strip.written


def test_registers_are_written_before_the_outputs() -> None:
    """The order matters in lock step, where the plant advances when all outputs have been written."""
    cabinet = Cabinet()
    assert cabinet.tick(0) == [[456], "outputs"]
    assert cabinet.runtime.released_words == [456]
    assert cabinet.tick(1) == ["outputs", [SAFE]]


def test_a_device_that_refuses_its_register_does_not_keep_the_outputs_on() -> None:
    """The first rejection is a link error; then the safe outputs are written although the register is rejected."""
    cabinet = Cabinet()
    cabinet.tick(0)
    cabinet.strip.refuses_registers = True
    assert cabinet.tick(0) == []
    written = [cabinet.tick(0) for _ in range(20)]
    assert cabinet.runtime.link_lost
    assert cabinet.runtime.released == IO_MAP.safe_outputs()
    cabinet.now_ms += 1_000
    written += [cabinet.tick(0)]
    assert written[-1] == ["outputs"]


def test_the_first_write_after_a_link_loss_is_the_safe_value() -> None:
    cabinet = Cabinet()
    cabinet.tick(0)
    cabinet.strip.fails = True
    for _ in range(12):
        cabinet.tick(0)
    assert cabinet.runtime.released_words == [SAFE]
    cabinet.strip.fails = False
    cabinet.now_ms += 1_000
    assert cabinet.tick(0) == ["outputs", [SAFE]]
    assert cabinet.tick(0) == [[456], "outputs"]


def test_a_failed_scan_writes_the_safe_value(monkeypatch: pytest.MonkeyPatch) -> None:
    cabinet = Cabinet()
    cabinet.tick(0)

    def fail(now_ms: int, levels: Levels[bool]) -> list[bool]:
        raise ZeroDivisionError

    monkeypatch.setattr(cabinet.plc, "scan", fail)
    assert cabinet.tick(0) == ["outputs", [SAFE]]


def test_forced_inputs_do_not_drive_a_register() -> None:
    cabinet = Cabinet()
    cabinet.tick(0)
    machine = cabinet.runtime.machine.tags.machine
    cabinet.plc.write(machine.state, State.STOPPED)
    cabinet.plc.write(machine.manual, 1)
    cabinet.runtime.forcing.force(0, level=True)
    assert cabinet.tick(0) == ["outputs", [SAFE]]


def test_a_register_waits_for_the_retentive_memory_unless_it_becomes_safe() -> None:
    writer = Unsettled(MemoryStore())
    cabinet = Cabinet(writer)
    assert cabinet.tick(1) == ["outputs", [SAFE]]
    writer.waits = True
    assert cabinet.tick(0) == ["outputs", [SAFE]]
    writer.waits = False
    assert cabinet.tick(0) == [[456], "outputs"]
    writer.waits = True
    assert cabinet.tick(1) == ["outputs", [SAFE]]


def test_on_exit_the_outputs_come_first() -> None:
    """The outputs are already safe if the device does not respond to a write of its registers."""
    cabinet = Cabinet()
    cabinet.tick(0)
    cabinet.strip.written.clear()
    assert cabinet.runtime.write_safe_outputs()
    assert cabinet.strip.written == ["outputs", [SAFE]]
    assert cabinet.runtime.released_words == [SAFE]
    cabinet.strip.fails = True
    assert not cabinet.runtime.write_safe_outputs()
