"""PLC with the exported program behind a Modbus server that nobody here wrote, and the plant as its client."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from pyModbusTCP.server import DataHandler, ModbusServer  # type: ignore[import-untyped]

from controller.export.instruction_list import acting, export
from controller.fx.engine.execution import fastest_execution
from controller.fx.engine.plc import FxPlc
from controller.fx.language.instruction import Ladder
from controller.program.machine import build
from controller.program.states import State
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.plc.client import PlcClient
from plant_sim.links.plc.port import PlcPort
from plant_sim.links.plc.profile import PlcProfile, load_profile
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import set_points_of
from plant_sim.twin.lock_step import SCAN_MS, Twin
from tests.controller.common.modbus_rig import IO_MAP, MACHINE

LIMIT_S = 100.0
RUN_MS = 25_000
"""Time of a run after the start: more than one cycle of both arms."""


def profile_of(name: str) -> PlcProfile:
    return load_profile(name, input_count=IO_MAP.input_count, output_count=IO_MAP.output_count)


@cache
def exported() -> Ladder:
    return export(acting(build(IO_MAP).program))


@dataclass(frozen=True)
class Reference:
    """Run of the twin: what the operator does, and the result.

    Attributes:
        presses: Times at which the start button is pressed for 100 ms.
        until_ms: End of the run.
        counts: Seedlings at the end.
        state: State of the plant at the end.
    """

    presses: tuple[int, ...]
    until_ms: int
    counts: SeedlingCounts
    state: bytes


@cache
def reference(trays: int = 1, run_ms: int | None = RUN_MS) -> Reference:
    """Run the twin for a time after the start, or to the end of its trays."""
    twin = Twin(trays=trays, set_points={"trays_target": trays})
    twin.home()
    idle_ms = twin.now_ms
    twin.start()
    if run_ms is None:
        twin.run_until_state(State.COMPLETE, within_ms=600_000)
    else:
        twin.run_for(idle_ms + run_ms - twin.now_ms)
    return Reference((10, idle_ms + 200), twin.now_ms, twin.plant.counts(), twin.plant.state.tobytes())


@cache
def homing(until_ms: int) -> Reference:
    """Run the twin from the power-up to a time during homing."""
    twin = Twin(trays=1, set_points={"trays_target": 1})
    twin.scan()
    twin.press("start")
    twin.run_for(until_ms - twin.now_ms)
    return Reference((10,), twin.now_ms, twin.plant.counts(), twin.plant.state.tobytes())


@dataclass
class ProgramOfPlc:
    """Exported program in a simulated FX, scanned once for every block of inputs that it receives."""

    trays: int = 1
    now_ms: int = 0
    fx: FxPlc = field(init=False)

    def __post_init__(self) -> None:
        self.fx = FxPlc(exported(), execution=fastest_execution)

    def scan(self, inputs: Sequence[bool]) -> list[bool]:
        outputs = self.fx.scan(self.now_ms, list(inputs)[: IO_MAP.input_count])[: IO_MAP.output_count]
        if self.now_ms == 0:  # the first scan sets the defaults, and takes the memory for lost
            self._commission()
        self.now_ms += SCAN_MS
        return outputs

    def _commission(self) -> None:
        for name, value in {**set_points_of(MACHINE), "trays_target": self.trays}.items():
            device = getattr(build(IO_MAP).tags.sp, name)
            self.fx.memory.set_word(device.kind, device.number, value)
        new = build(IO_MAP).tags.commands.new_machine
        self.fx.memory.M[new.number] = True


class PlcMemory(DataHandler):  # type: ignore[misc]
    """Memory of the PLC: a write of the inputs executes one scan of the program."""

    def __init__(self, profile: PlcProfile, scan: Callable[[Sequence[bool]], list[bool]]) -> None:
        super().__init__()
        self.profile, self.scan = profile, scan
        self.requests: list[str] = []

    def write_coils(self, address: int, bits_l: list[bool], srv_info: Any) -> Any:
        self.requests.append("write")
        result = super().write_coils(address, bits_l, srv_info)
        self._program(address, bits_l)
        return result

    def write_h_regs(self, address: int, words_l: list[int], srv_info: Any) -> Any:
        self.requests.append("write")
        result = super().write_h_regs(address, words_l, srv_info)
        self._program(address, [bool(words_l[n // 16] >> n % 16 & 1) for n in range(16 * len(words_l))])
        return result

    def _program(self, address: int, inputs: Sequence[bool]) -> None:
        if address != self.profile.inputs.first:
            return
        outputs, block = self.scan(inputs), self.profile.outputs
        if block.length(32) == 32:
            self.data_bank.set_coils(block.first, outputs)
        else:
            words = [sum(on << n for n, on in enumerate(outputs[first : first + 16])) for first in (0, 16)]
            self.data_bank.set_holding_registers(block.first, words)


@contextmanager
def modbus_plc(profile: PlcProfile, scan: Callable[[Sequence[bool]], list[bool]], port: int = 0) -> Iterator[int]:
    """Run a PLC as Modbus TCP server; return its port."""
    server = ModbusServer("127.0.0.1", port, no_block=True, data_hdl=PlcMemory(profile, scan))
    server.start()
    try:
        yield server._service.server_address[1]
    finally:
        server.stop()


def module_of(trays: int = 1, seed: int = 1, watchdog_ms: int = 100) -> IoModule:
    return IoModule(Plant(IO_MAP, MACHINE, seed=seed, trays=trays), IO_MAP, watchdog_ms=watchdog_ms)


def client_of(port: PlcPort, module: IoModule, profile: PlcProfile, *, period_s: float, said: list[str]) -> PlcClient:
    return PlcClient(
        port,
        module,
        input_bits=profile.input_bits(IO_MAP.input_count),
        ok_bit=profile.ok_bit,
        period_s=period_s,
        tell=said.append,
    )


def run_in_lock_step(port: PlcPort, profile: PlcProfile, expected: Reference, trays: int = 1) -> IoModule:
    """Run the plant as client of a PLC up to the end of the reference, with the same buttons."""
    module, ended = module_of(trays), threading.Event()
    plant = module.plant

    def operate() -> None:
        plant.box.start = any(0 <= plant.time_ms - press_ms < 100 for press_ms in expected.presses)
        if plant.time_ms >= expected.until_ms:
            ended.set()
            raise EndOfRun

    module.observers.append(operate)
    client = client_of(port, module, profile, period_s=0, said=[])
    server = PlantServer(module, port=0, lock_step_ms=SCAN_MS, plc=client)
    try:
        with ServerThread(server):
            assert ended.wait(LIMIT_S), f"reached only {plant.time_ms} ms"
    except EndOfRun:
        pass
    return module


class EndOfRun(Exception):  # noqa: N818 - not an error
    """End of a run; it ends the server."""
