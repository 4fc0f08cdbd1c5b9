"""Client of a PLC: loss and return of the PLC, wrong answers, and refused outputs."""

from __future__ import annotations

import asyncio
import struct
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import pytest

from controller.common.modbus.async_client import AsyncTcpClient
from plant_sim.links.io_module import IoModule, WatchdogState
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.plc.modbus import ModbusPlc
from plant_sim.links.plc.port import PlcError
from plant_sim.links.write_timing import PlcState
from tests.controller.common.modbus_rig import IO_MAP, PATIENT_S, Rig, frame, read_registers
from tests.plant_sim.links.plc.plc_rig import LIMIT_S, client_of, modbus_plc, module_of, profile_of

COIL = 5
PROFILE = profile_of("fx3u")
OUTPUTS = IO_MAP.output_count
OK_BIT = PROFILE.ok_bit or 0


class Said(list[str]):
    """Reported lines, for which a test can wait."""

    def __init__(self) -> None:
        super().__init__()
        self._said = threading.Condition()

    def append(self, line: str) -> None:
        with self._said:
            super().append(line)
            self._said.notify_all()

    def wait_for(self, *texts: str) -> str:
        """Wait for a line with each text, in any order; return the first line with the first text.

        The lines up to the last one that was waited for are forgotten.
        """
        with self._said:
            assert self._said.wait_for(lambda: all(self._first(text) is not None for text in texts), LIMIT_S), (
                texts,
                list(self),
            )
            found = [number for text in texts if (number := self._first(text)) is not None]
            line = self[found[0]]
            del self[: max(found) + 1]
            return line

    def _first(self, text: str) -> int | None:
        return next((number for number, line in enumerate(self) if text in line), None)


class OneOutput:
    """Program that switches one output on while it is told to, and notes the inputs."""

    def __init__(self) -> None:
        self.is_on = True
        self.inputs: list[bool] = []

    def scan(self, inputs: Sequence[bool]) -> list[bool]:
        self.inputs = list(inputs)
        return [self.is_on and number == COIL for number in range(OUTPUTS)]


@contextmanager
def connected(module: IoModule, port: int, said: Said, *, watchdog_limit: float = 1.0) -> Iterator[Rig]:
    """Run the plant in real time as client of a PLC."""
    master = AsyncTcpClient("127.0.0.1", port, timeout_s=watchdog_limit)
    plc = ModbusPlc(PROFILE, master, output_count=OUTPUTS)
    client = client_of(plc, module, PROFILE, period_s=0.005, said=said)
    with Rig(PlantServer(module, port=0, plc=client, tell=said.append)) as rig:
        yield rig


def test_a_lost_plc_trips_the_watchdog_and_comes_back_by_itself() -> None:
    """Outputs off in the meantime; after the return they are refused until the PLC has switched all of them off."""
    said, program = Said(), OneOutput()
    module = module_of(watchdog_ms=2_000)  # trips only by the loss on a busy computer too
    with ExitStack() as stack:
        first = ExitStack()
        port = first.enter_context(modbus_plc(PROFILE, program.scan))
        rig = stack.enter_context(connected(module, port, said))
        said.wait_for(f"PLC 127.0.0.1:{port} answers at")
        assert rig.thread.call(lambda: module.outputs[COIL])
        assert program.inputs[OK_BIT]

        first.close()
        assert "trying again" in said.wait_for("does not answer", "output watchdog tripped")  # in any order
        telemetry = read_registers(rig.client())
        assert (telemetry["plc_state"], telemetry["plc_losses"]) == (PlcState.LOST, 1)
        assert (telemetry["watchdog_state"], telemetry["y_image"]) == (WatchdogState.TRIPPED, 0)

        stack.enter_context(modbus_plc(PROFILE, program.scan, port))
        said.wait_for("answers at")
        assert "write every output to its safe level first" in said.wait_for("outputs refused")
        assert not rig.thread.call(lambda: module.outputs[COIL])
        assert not program.inputs[OK_BIT]
        program.is_on = False
        said.wait_for("outputs accepted again")
        program.is_on = True
        while not rig.thread.call(lambda: module.outputs[COIL]):
            pass
        assert read_registers(rig.client())["plc_state"] == PlcState.CONNECTED


def test_outputs_belong_to_the_plc() -> None:
    """Another client of the plant can read telemetry and press buttons, but not write outputs."""
    said, program, module = Said(), OneOutput(), module_of()
    with modbus_plc(PROFILE, program.scan) as port, connected(module, port, said) as rig:
        said.wait_for("answers at")
        client = rig.client()
        assert client.ask(struct.pack(">BHH", 5, COIL, 0)) == bytes([0x85, 6])
        assert client.ask(struct.pack(">BHH", 5, 100, 0xFF00))[0] == 5
        while not program.inputs[IO_MAP["start"].number]:
            pass


class Wrong:
    """TCP server that answers every request in a wrong way."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self._answer = answer

    async def __call__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while request := await reader.read(300):
                writer.write(self._answer(request))
        finally:
            writer.close()


def confirmed(request: bytes) -> bytes:
    return frame(request[7:12], transaction=int.from_bytes(request[:2]))


WRONG = {
    "transaction": (
        lambda r: frame(r[7:12], transaction=9),
        "200 ms, but a frame with transaction 9,",
    ),
    "unit": (lambda r: frame(r[7:12], transaction=int.from_bytes(r[:2]), unit=4), "unit 4"),
    "protocol": (lambda r: r[:2] + b"\0\1" + confirmed(r)[4:], "protocol 1"),
    "length": (lambda r: r[:4] + b"\0\1" + r[6:8], "length 1"),
    "function": (lambda r: frame(b"\x10" + r[8:12], transaction=int.from_bytes(r[:2])), "another function .16."),
    "address": (lambda r: frame(b"\x0f\0\0\0\1", transaction=int.from_bytes(r[:2])), "answer confirms 1 from 0"),
    "exception": (lambda r: frame(b"\x8f\x02", transaction=int.from_bytes(r[:2])), "no such address.*M7000 .coil 7000"),
    "cut": (lambda r: confirmed(r)[:9], "no answer within 200 ms"),
    "silence": (lambda r: b"", "no answer within 200 ms"),
    "short": (
        lambda r: confirmed(r) if r[7] == 15 else frame(b"\x01\x01\x00", transaction=int.from_bytes(r[:2])),
        "answer contains 8 bits",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_answer_is_never_taken_for_outputs(name: str) -> None:
    answer, complaint = WRONG[name]

    async def exchange() -> None:
        server = await asyncio.start_server(Wrong(answer), "127.0.0.1", 0)
        async with server:
            port = server.sockets[0].getsockname()[1]
            plc = ModbusPlc(PROFILE, AsyncTcpClient("127.0.0.1", port, timeout_s=0.2), output_count=OUTPUTS)
            await plc.open()
            try:
                with pytest.raises(PlcError, match=complaint):
                    await plc.exchange([False] * 32)
            finally:
                plc.close()

    asyncio.run(exchange())


def test_the_first_failure_is_repeated_at_once_and_is_not_a_loss() -> None:
    """A single failed exchange costs one connection; it is counted, and nothing is told."""
    said, program, module = Said(), OneOutput(), module_of(watchdog_ms=5_000)
    scans = 0

    def scan(inputs: Sequence[bool]) -> list[bool]:
        nonlocal scans
        scans += 1
        if scans == 5:
            raise OSError("the connection breaks")
        return program.scan(inputs)

    with modbus_plc(PROFILE, scan) as port, connected(module, port, said, watchdog_limit=PATIENT_S) as rig:
        said.wait_for("answers at")
        while scans < 12:
            rig.thread.call(lambda: None)
        assert rig.thread.call(lambda: rig.server._plc.errors if rig.server._plc else 0) == 1
        assert list(said) == []
        assert read_registers(rig.client())["plc_losses"] == 0


def test_in_lock_step_only_exchanges_advance_plant_time() -> None:
    """Buttons pressed by another client take no plant time."""
    said, program, module = Said(), OneOutput(), module_of()
    with modbus_plc(PROFILE, program.scan) as port:
        master = AsyncTcpClient("127.0.0.1", port, timeout_s=PATIENT_S)
        plc = client_of(ModbusPlc(PROFILE, master, output_count=OUTPUTS), module, PROFILE, period_s=0, said=said)
        with Rig(PlantServer(module, port=0, lock_step_ms=10, plc=plc)) as rig:
            said.wait_for("answers at")
            client = rig.client()
            for _ in range(50):
                client.ask(struct.pack(">BHH", 5, 100, 0xFF00))
                writes, time_ms = rig.thread.call(lambda: (module.block_writes, module.plant.time_ms))
                assert time_ms == 10 * writes
