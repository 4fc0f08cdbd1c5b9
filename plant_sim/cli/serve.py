"""Command ``serve``: the plant as a Modbus TCP device."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import sys
from collections.abc import Callable

from controller.common.errors import InputError
from controller.common.modbus.address import listening_remedy
from controller.common.real_time import add_real_time_arguments, claim_real_time, freeze_garbage, pin
from controller.iomap.loader import load_io_map
from plant_sim.cli.options import (
    add_air_argument,
    add_fault_arguments,
    add_machine_arguments,
    add_network_arguments,
    add_record_argument,
    check_machine_arguments,
    check_port,
    faults_of,
    machine_of,
)
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.serve import serve
from plant_sim.machine.plant import Plant

MAX_PLANTING_FREQUENCY_PER_MIN = 300.0
"""Highest planting frequency, cups per minute per row."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``serve``."""
    add_machine_arguments(parser)
    add_network_arguments(parser)
    parser.add_argument(
        "--watchdog-ms", type=int, default=100, help="time without a write after which outputs go to safe levels"
    )
    parser.add_argument(
        "--lock-step-ms",
        type=int,
        default=None,
        help="milliseconds of plant time per write of the outputs, instead of real time",
    )
    parser.add_argument(
        "--allow-remote",
        action="store_true",
        help="permit a --host that other computers can reach; Modbus has no password",
    )
    parser.add_argument(
        "--planting-frequency", type=float, default=None, help="cups per minute per row; 0 = tractor stationary"
    )
    add_real_time_arguments(parser)
    add_air_argument(parser)
    add_fault_arguments(parser)
    add_record_argument(parser)


def run(options: argparse.Namespace) -> int:
    """Serve until the request to stop.

    Raises:
        InputError: An option or a file is invalid, or the port is in use.
    """
    _check(options)
    claim_real_time(options)
    io_map = load_io_map(options.io_map)
    machine = machine_of(options)
    plant = Plant(io_map, machine, seed=options.seed, trays=options.trays, faults=faults_of(options))
    if options.planting_frequency is not None:
        plant.planting_frequency_per_min = options.planting_frequency
    try:
        module = IoModule(plant, io_map, watchdog_ms=options.watchdog_ms)
        server = PlantServer(
            module,
            host=options.host,
            port=options.port,
            lock_step_ms=options.lock_step_ms,
            allow_remote=options.allow_remote,
        )
    except ValueError as error:
        raise InputError(str(error)) from error

    module.lease.on_refusal = _refusal_report(module)

    def listening(port: int) -> None:
        print(f"plant listening on {options.host}:{port}", flush=True)

    with contextlib.ExitStack() as stack:
        if options.record is not None:
            from plant_sim.scope.recorder import LIVE_ROWS_PER_GROUP, Recorder  # noqa: PLC0415 - pyarrow is optional

            recorder = Recorder(
                plant,
                options.record,
                io_map=io_map,
                machine=machine,
                seed=options.seed,
                outputs=lambda: module.outputs,
                rows_per_group=LIVE_ROWS_PER_GROUP,
            )
            module.observers.append(stack.enter_context(recorder).sample)
        pin(options)
        freeze_garbage()
        try:
            asyncio.run(serve(server, options.stop, listening=listening))
        except OSError as error:
            reason = error.strerror or str(error)
            text = f"cannot listen on {options.host}:{options.port}: {reason}; {listening_remedy(error)}"
            raise InputError(text) from error
    return 0


def _refusal_report(module: IoModule) -> Callable[[], None]:
    """Return a function that reports a refused write, at most once per second of plant time for each owner."""
    reported: tuple[str, int] | None = None

    def report() -> None:
        nonlocal reported
        lease, second = module.lease, module.plant.time_ms // 1_000
        if reported != (lease.owner, second):
            reported = lease.owner, second
            print(
                f"outputs belong to {lease.owner}: write by {lease.last_refused} refused ({lease.refused} so far)",
                file=sys.stderr,
                flush=True,
            )

    return report


def _check(options: argparse.Namespace) -> None:
    check_machine_arguments(options)
    check_port(options)
    if not 0 <= (options.planting_frequency or 0) <= MAX_PLANTING_FREQUENCY_PER_MIN:
        raise InputError(
            f"--planting-frequency {options.planting_frequency}: must be 0 to {MAX_PLANTING_FREQUENCY_PER_MIN:g}"
        )
