"""Two masters on one I/O module: with the lease of the plant, and on a foreign module without one."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager

import pytest
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.server import ModbusTcpServer

from controller.common.modbus.io_map import IoMap
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.io.field.device import FieldDevice
from controller.io.field.field_file import one_device
from controller.io.field.link import DevicesLink
from controller.io.field.tcp_line import TcpBus
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.output_guard import ModbusOutputGuard, ModuleKind
from controller.io.ownership import FREE_MS, RIVAL_MS
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.states import State
from plant_sim.links.io_module import WatchdogState
from plant_sim.links.modbus_server import PlantServer
from plant_sim.twin.commissioning import program_of
from tests.controller.common.modbus_rig import ALL_OFF, Client, Rig, make_module, read_pdu, write_coil_pdu
from tests.sampling import first_of
from tests.wiring import wired

IO_MAP = load_io_map(DEFAULT_IO_MAP)
AT_REST = make_module().inputs()
"""Inputs of a machine at rest; those of the foreign module never change."""
SCAN_MS = 10
EVERY = 5
WITHIN_MS = 100
"""Time within which both sides must report a second master, ms (issue)."""
TOUCHED = 15
"""Coil offset of an output that is off in Stopped: the right claws open."""


class Controller:
    """Program on a link to a port, scanned in simulated time."""

    def __init__(self, port: int, io_map: IoMap = IO_MAP) -> None:
        self.machine = program_of(io_map)
        self.plc = Plc(self.machine.program)
        self.link = ModbusTcpLink("127.0.0.1", port, io_map, timeout_s=5)
        self.guard = ModbusOutputGuard(self.link, every=EVERY)
        self.runtime = Runtime(
            self.machine, self.plc, self.link, DirectRetentiveWriter(MemoryStore()), guard=self.guard
        )
        self.now_ms = -SCAN_MS
        self.link.open()
        self.guard.identify()

    @property
    def state(self) -> int:
        return self.plc.read(self.machine.tags.machine.state)

    @property
    def alarms(self) -> set[str]:
        return {alarm.key for alarm in self.machine.alarms if self.plc.read(alarm.bit)}

    @property
    def kind(self) -> ModuleKind:
        return self.guard.kinds[self.link.devices[0]]

    @property
    def taken(self) -> str:
        return self.runtime.ownership.taken

    def scan(self, count: int = 1) -> None:
        for _ in range(count):
            self.now_ms += SCAN_MS
            self.runtime.tick(self.now_ms)

    def order(self, command: str) -> None:
        self.runtime.order(command)
        self.scan()

    def address(self) -> str:
        line = self.link.devices[0].line
        assert isinstance(line, TcpBus)
        assert line.socket is not None
        host, port = line.socket.getsockname()
        return f"{host}:{port}"


def scan_both(first: Controller, second: Controller, for_ms: int) -> None:
    for _ in range(for_ms // SCAN_MS):
        first.scan()
        second.scan()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def controller(stack: ExitStack, port: int, io_map: IoMap = IO_MAP) -> Controller:
    made = Controller(port, io_map)
    stack.callback(made.link.close)
    return made


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig(PlantServer(make_module(), port=0, lock_step_ms=SCAN_MS)) as rig:
        yield rig


# ---- the plant, which lends its outputs ------------------------------------------------------------------------


@pytest.mark.parametrize("before", first_of([0, 1, 200]))
def test_the_second_controller_is_refused_and_both_report_it(rig: Rig, stack: ExitStack, before: int) -> None:
    """Started at the same time, one scan later and 2 s later."""
    first, second = controller(stack, rig.server.port), controller(stack, rig.server.port)
    assert {first.kind, second.kind} == {ModuleKind.LENDS}
    first.scan(before)
    scan_both(first, second, WITHIN_MS)
    assert first.address() in second.taken
    assert "outputs_taken" in second.alarms
    assert second.state in (State.ABORTING, State.ABORTED)
    assert (first.state, first.taken) == (State.STOPPED, "")
    assert first.runtime.ownership.rival.endswith(second.address())
    assert "outputs_contested" in first.alarms
    assert rig.module.owner_report.owner == first.address()
    assert rig.module.owner_report.rival == second.address()


def test_the_refused_controller_writes_nothing_and_cannot_be_cleared(rig: Rig, stack: ExitStack) -> None:
    first, second = controller(stack, rig.server.port), controller(stack, rig.server.port)
    first.scan(10)
    scan_both(first, second, 2_000)
    assert rig.module.lease.refused == 1
    second.order("clear")
    scan_both(first, second, 100)
    assert second.state == State.ABORTED
    first.order("reset")
    scan_both(first, second, 1_000)
    assert first.state == State.RESETTING
    assert not second.runtime.write_safe_outputs()
    assert rig.module.lease.refused == 1
    scan_both(first, second, RIVAL_MS)
    assert "outputs_contested" not in first.alarms


def test_the_second_controller_takes_over_after_the_first_only_when_it_is_cleared(rig: Rig, stack: ExitStack) -> None:
    first, second = controller(stack, rig.server.port), controller(stack, rig.server.port)
    first.scan(10)
    scan_both(first, second, 200)
    first.link.close()
    second.scan(FREE_MS // SCAN_MS + EVERY)
    assert second.state == State.ABORTED
    assert rig.module.lease.owner == ""
    rig.thread.call(lambda: rig.module.advance(200))
    assert rig.module.tripped
    second.order("clear")
    second.scan(5)
    assert (second.state, second.taken, second.alarms) == (State.STOPPED, "", set())
    assert rig.module.lease.owner == second.address()
    assert rig.module.watchdog_state is WatchdogState.ARMED
    restarted = controller(stack, rig.server.port)
    restarted.scan(2)
    assert second.address() in restarted.taken


def test_a_restarted_controller_is_not_locked_out(rig: Rig, stack: ExitStack) -> None:
    """A controller that waits in Aborted does not take the outputs while the first one is being restarted."""
    first, second = controller(stack, rig.server.port), controller(stack, rig.server.port)
    first.scan(10)
    scan_both(first, second, 200)
    first.link.close()
    second.scan(200)
    restarted = controller(stack, rig.server.port)
    restarted.scan(10)
    assert (restarted.state, restarted.taken) == (State.STOPPED, "")
    second.scan(EVERY)
    assert second.state == State.ABORTED


def test_a_short_interruption_of_the_owner_is_bridged(rig: Rig, stack: ExitStack) -> None:
    """Its next connection has another port; the machine does not stop."""
    first = controller(stack, rig.server.port)
    first.scan(10)
    port = first.address()
    first.link.close()
    first.scan(3)
    assert first.address() != port
    assert (first.state, first.taken, first.alarms) == (State.STOPPED, "", set())


def test_a_foreign_client_as_the_owner_stops_the_controller(rig: Rig, stack: ExitStack) -> None:
    tool, first = rig.client(), controller(stack, rig.server.port)
    tool.ask(write_coil_pdu(TOUCHED, 0xFF00))
    first.scan(3)
    host, port = tool.socket.getsockname()
    assert f"{host}:{port}" in first.taken
    assert "outputs_taken" in first.alarms
    assert tool.ask(read_pdu(1, TOUCHED, 1)) == b"\x01\x01\x01", "nothing was written over the owner"


def test_an_output_register_is_part_of_the_lease(rig: Rig, stack: ExitStack) -> None:
    assert rig.client().ask(ALL_OFF)[0] == 15
    first = controller(stack, rig.server.port)
    assert not first.runtime.write_safe_outputs()
    assert first.taken


# ---- a foreign module without a lease --------------------------------------------------------------------------


class ForeignModule:
    """Server of pymodbus with 64 coils, 64 inputs and some registers, for the duration of a `with` block."""

    def __init__(self, registers: dict[int, int] | None = None) -> None:
        self.coils = ModbusSequentialDataBlock(1, [0] * 64)  # type: ignore[no-untyped-call]
        self._registers = ModbusSequentialDataBlock(1, [(registers or {}).get(n, 0) for n in range(0x1200)])  # type: ignore[no-untyped-call]
        self.port = 0
        self._ready: Future[int] = Future()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()))

    @contextmanager
    def running(self) -> Iterator[ForeignModule]:
        self._thread.start()
        self.port = self._ready.result(timeout=30)
        try:
            yield self
        finally:
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join()

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        inputs = ModbusSequentialDataBlock(1, [*AT_REST, *[False] * 42])  # type: ignore[no-untyped-call]
        device = ModbusDeviceContext(di=inputs, co=self.coils, hr=self._registers, ir=self._registers)
        context = ModbusServerContext(devices=device, single=True)
        server = ModbusTcpServer(context, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        assert isinstance(server.transport, asyncio.Server)
        self._ready.set_result(server.transport.sockets[0].getsockname()[1])
        await self._end.wait()
        await server.shutdown()  # type: ignore[no-untyped-call]


@pytest.fixture
def foreign() -> Iterator[ForeignModule]:
    with ForeignModule().running() as module:
        yield module


def coils(client: Client, count: int = 18) -> bytes:
    return client.ask(read_pdu(1, 0, count))[2:]


NONE = b"\x00\x00\x00"


def test_a_foreign_module_is_read_back(foreign: ForeignModule, stack: ExitStack) -> None:
    first = controller(stack, foreign.port)
    assert first.kind is ModuleKind.READ_BACK
    first.scan(100)
    assert (first.state, first.taken, first.alarms) == (State.STOPPED, "", set())


@pytest.mark.parametrize("offset", first_of(range(18), 2))
def test_the_write_of_another_master_stops_the_controller_in_the_next_scan(
    foreign: ForeignModule, stack: ExitStack, offset: int
) -> None:
    """Outputs safe first, then the alarm, and nothing is written any more."""
    first, tool = controller(stack, foreign.port), stack.enter_context(Client(foreign.port))
    first.scan()
    first.order("reset")
    first.scan(200)
    first.order("start")
    while not any(first.runtime.released):
        first.scan()
    assert coils(tool) != NONE
    was_on = coils(tool)[offset // 8] >> offset % 8 & 1
    tool.ask(write_coil_pdu(offset, 0 if was_on else 0xFF00))
    first.scan()
    number = next(point.number for point in IO_MAP.outputs if point.offset == offset)
    assert f"Y{number:o} changed" in first.taken
    assert coils(tool) == NONE
    assert "outputs_taken" not in first.alarms
    first.scan()
    assert "outputs_taken" in first.alarms
    tool.ask(write_coil_pdu(3, 0xFF00))
    first.scan(FREE_MS // SCAN_MS + 10)
    assert coils(tool) != NONE, "the controller writes over the other master"
    first.order("clear")
    assert first.state == State.ABORTED


def test_the_operator_clears_a_takeover_when_the_other_master_is_gone(foreign: ForeignModule, stack: ExitStack) -> None:
    first, tool = controller(stack, foreign.port), stack.enter_context(Client(foreign.port))
    first.scan(5)
    tool.ask(write_coil_pdu(TOUCHED, 0xFF00))
    first.scan(FREE_MS // SCAN_MS + 5)
    assert first.state == State.ABORTED
    first.order("clear")
    first.scan(5)
    assert (first.state, first.taken, first.alarms) == (State.STOPPED, "", set())
    first.order("reset")
    first.scan(5)
    assert first.state == State.RESETTING


def test_a_lamp_of_the_abort_is_not_written_either(foreign: ForeignModule, stack: ExitStack) -> None:
    """Nor is it the first image after the takeover: a module whose watchdog has tripped accepts only the safe state."""
    first = controller(stack, foreign.port, wired("lamp_red"))
    tool = stack.enter_context(Client(foreign.port))
    first.scan(5)
    tool.ask(write_coil_pdu(TOUCHED, 0xFF00))
    first.scan(FREE_MS // SCAN_MS + 5)
    assert first.plc.read(first.machine.tags.system.outputs_taken) == 0
    assert any(first.plc.memory.Y)
    assert not any(first.runtime.released)
    assert coils(tool, 20) == NONE


@pytest.mark.parametrize("before", first_of([0, 1, 200]))
def test_two_controllers_on_a_foreign_module_never_both_work(
    foreign: ForeignModule, stack: ExitStack, before: int
) -> None:
    """While both write equal values, neither can tell; the first difference stops both or one of them."""
    first, second = controller(stack, foreign.port), controller(stack, foreign.port)
    first.scan(before + 1)
    second.scan()
    for command in ("reset", "start"):
        first.order(command)
        second.order(command)
        for _ in range(200):
            scan_both(first, second, SCAN_MS)
            assert not (any(first.runtime.released) and any(second.runtime.released))
    assert first.taken or second.taken


@pytest.mark.parametrize("failing", ["open", "read_outputs"])
def test_an_answer_that_is_missing_is_no_takeover(
    foreign: ForeignModule, stack: ExitStack, failing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a lost connection the outputs are uncertain: they are written before they are compared."""
    first, tool = controller(stack, foreign.port), stack.enter_context(Client(foreign.port))
    first.scan(5)
    first.link.close()
    tool.ask(write_coil_pdu(TOUCHED, 0xFF00))
    first.scan(5)
    assert (first.taken, coils(tool)) == ("", NONE)


def test_a_module_that_cannot_be_read_back_is_used_without_detection(stack: ExitStack) -> None:
    class WriteOnly(ModbusTcpLink):
        def read_outputs(self, devices: Iterable[FieldDevice] | None = None) -> list[bool]:
            raise self.devices[0].failed("read of outputs", "refused")

    with ForeignModule().running() as module:
        link = WriteOnly("127.0.0.1", module.port, IO_MAP, timeout_s=5)
        stack.callback(link.close)
        link.open()
        guard = ModbusOutputGuard(link, every=EVERY)
        guard.identify()
        assert guard.blind == [link.devices[0].label]
        assert (guard.mismatch([True] * 18), guard.holder([True] * 18), guard.rival()) == ("", "", "")
        assert link.read_inputs() == AT_REST


@pytest.mark.parametrize("found", [0, 1])
def test_a_profile_sets_the_write_lock(found: int, stack: ExitStack) -> None:
    with ForeignModule({0x1124: found}).running() as module:
        plan = one_device(IO_MAP, "127.0.0.1", module.port, unit=1, timeout_ms=5_000, profile="beckhoff-ek9000-coils")
        link = DevicesLink(plan, IO_MAP)
        stack.callback(link.close)
        link.open()
        tool = stack.enter_context(Client(module.port))
        assert tool.ask(read_pdu(3, 0x1124, 1)) == b"\x03\x02\x00\x01"


def test_outputs_taken_is_restored_with_the_runtime(rig: Rig, stack: ExitStack) -> None:
    rig.client().ask(ALL_OFF)
    first = controller(stack, rig.server.port)
    before: Callable[[], object] = first.runtime.save
    saved = before()
    first.scan(2)
    assert first.taken
    first.runtime.restore(saved)
    assert first.taken == ""
