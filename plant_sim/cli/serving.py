"""Options and operation shared by the commands ``serve`` and ``connect``: a plant in one process."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Final

from controller.common.errors import InputError
from controller.common.modbus.address import listening_remedy
from controller.common.modbus.rtu import SerialLine
from controller.common.real_time import add_real_time_arguments, claim_real_time, freeze_garbage, pin
from controller.common.supervision.tasks import run_supervised
from controller.iomap.loader import load_io_map
from plant_sim.cli.options import (
    add_air_argument,
    add_fault_arguments,
    add_machine_arguments,
    add_record_argument,
    check_machine_arguments,
    faults_of,
    machine_of,
)
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.plc.client import PlcClient
from plant_sim.links.real_time import precise_loop
from plant_sim.links.serve import serve
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant

MAX_PLANTING_FREQUENCY_PER_MIN: Final = 300.0
"""Highest planting frequency, cups per minute per row."""


def add_plant_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the plant, its output watchdog and its time."""
    add_machine_arguments(parser)
    parser.add_argument(
        "--watchdog-ms", type=int, default=100, help="time without a write after which outputs go to safe levels"
    )
    parser.add_argument(
        "--gap-limit-ms",
        type=int,
        default=None,
        help="time without a write that is reported as a gap; default: half of --watchdog-ms",
    )
    parser.add_argument(
        "--allow-remote",
        action="store_true",
        help="permit an address to listen on that other computers can reach; Modbus has no password",
    )
    add_frequency_argument(parser)
    add_real_time_arguments(parser)
    add_air_argument(parser)
    add_fault_arguments(parser)
    add_record_argument(parser)


def add_frequency_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option for the planting frequency."""
    parser.add_argument(
        "--planting-frequency", type=float, default=None, help="cups per minute per row; 0 = tractor stationary"
    )


def build(options: argparse.Namespace, module_type: type[IoModule] = IoModule) -> tuple[IoModule, Machine]:
    """Return the module of a new plant, and the parameters of the machine.

    Args:
        options: Options of the command.
        module_type: Class of the module.

    Raises:
        InputError: An option or a file is invalid.
    """
    check_machine_arguments(options)
    claim_real_time(options)
    if not 0 <= (options.planting_frequency or 0) <= MAX_PLANTING_FREQUENCY_PER_MIN:
        raise InputError(
            f"--planting-frequency {options.planting_frequency}: must be 0 to {MAX_PLANTING_FREQUENCY_PER_MIN:g}"
        )
    io_map = load_io_map(options.io_map)
    machine = machine_of(options)
    plant = Plant(io_map, machine, seed=options.seed, trays=options.trays, faults=faults_of(options))
    if options.planting_frequency is not None:
        plant.planting_frequency_per_min = options.planting_frequency
    try:
        module = module_type(plant, io_map, watchdog_ms=options.watchdog_ms)
    except ValueError as error:
        raise InputError(str(error)) from error
    module.lease.on_refusal = _refusal_report(module)
    return module, machine


def operate(
    options: argparse.Namespace,
    module: IoModule,
    machine: Machine,
    *,
    host: str,
    port: int,
    serial: SerialLine | None = None,
    plc: PlcClient | None = None,
    begin: Callable[[PlantServer], None] | None = None,
) -> int:
    """Serve until the request to stop, then report the timing measured in real time.

    Args:
        options: Options of the command.
        module: Module of the plant.
        machine: Parameters of the machine.
        host: Address to listen on.
        port: TCP port; 0 = any free port.
        serial: Serial line to serve as well.
        plc: PLC of which the plant is a client.
        begin: Function that is called once clients can connect.

    Raises:
        InputError: An option is invalid, or the port or the serial line cannot be opened.
    """
    try:
        server = PlantServer(
            module,
            host=host,
            port=port,
            lock_step_ms=options.lock_step_ms,
            allow_remote=options.allow_remote,
            serial=serial,
            models_wire=serial is not None and options.wire_time,
            plc=plc,
            gap_limit_ms=options.gap_limit_ms,
            tell=tell,
        )
    except ValueError as error:
        raise InputError(str(error)) from error

    def listening(opened: int) -> None:
        print(f"plant listening on {host}:{opened}", flush=True)
        if serial is not None:
            print(f"plant listening on {serial.path}, unit {serial.unit}", flush=True)
        if begin is not None:
            begin(server)

    with contextlib.ExitStack() as stack:
        if options.record is not None:
            stack.enter_context(_recording(options, module, machine))
        pin(options)
        freeze_garbage()
        try:
            run_supervised(serve(server, options.stop, listening=listening), precise_loop)
        except OSError as error:
            reason = error.strerror or str(error)
            text = f"cannot listen on {host}:{port}: {reason}; {listening_remedy(error)}"
            raise InputError(text) from error
    if options.lock_step_ms is None:  # otherwise the timing is that of the option
        for line in module.timing.lines():
            tell(line)
    return 0


def tell(line: str) -> None:
    """Print a line on standard error."""
    print(line, file=sys.stderr, flush=True)


@contextlib.contextmanager
def _recording(options: argparse.Namespace, module: IoModule, machine: Machine) -> Iterator[None]:
    from plant_sim.scope.recorder import LIVE_ROWS_PER_GROUP, Recorder  # noqa: PLC0415 - pyarrow is optional

    recorder = Recorder(
        module.plant,
        options.record,
        io_map=module.io_map,
        machine=machine,
        seed=options.seed,
        outputs=lambda: module.outputs,
        rows_per_group=LIVE_ROWS_PER_GROUP,
    )
    with recorder:
        module.observers.append(recorder.sample)
        yield


def _refusal_report(module: IoModule) -> Callable[[], None]:
    """Return a function that reports a refused write, at most once per second of plant time for each owner."""
    reported: tuple[str, int] | None = None

    def report() -> None:
        nonlocal reported
        lease, second = module.lease, module.plant.time_ms // 1_000
        if reported != (lease.owner, second):
            reported = lease.owner, second
            tell(f"outputs belong to {lease.owner}: write by {lease.last_refused} refused ({lease.refused} so far)")

    return report
