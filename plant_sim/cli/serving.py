"""Options and operation shared by the commands ``serve`` and ``connect``: a plant in one process."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator

from controller.common.errors import InputError
from controller.common.modbus.address import listening_remedy
from controller.common.modbus.rtu import SerialLine
from controller.common.real_time import claim_real_time, freeze_garbage, pin
from controller.common.supervision.tasks import run_supervised
from controller.iomap.loader import load_io_map
from plant_sim.cli.reproduce.origin import provenance_of
from plant_sim.cli.settings import faults_of, machine_of
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.plc.client import PlcClient
from plant_sim.links.real_time import precise_loop
from plant_sim.links.serve import serve
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant


def build(options: argparse.Namespace, module_type: type[IoModule] = IoModule) -> tuple[IoModule, Machine]:
    """Return the module of a new plant, and the parameters of the machine.

    Args:
        options: Options of the command.
        module_type: Class of the module.

    Raises:
        InputError: An option or a file is invalid.
    """
    claim_real_time(options)
    io_map = load_io_map(options.io_map)
    machine = machine_of(options)
    plant = Plant(io_map, machine, seed=options.seed, trays=options.trays, faults=faults_of(options))
    module = module_type(plant, io_map, watchdog_ms=options.watchdog_ms)
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
        provenance=provenance_of(options),
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
