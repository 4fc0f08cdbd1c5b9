"""Live mode of ``ladder run``: a program runs in real time while tools read and write its devices."""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import ExitStack
from typing import Final

from controller.cli.fx_options import cpu_of, peripherals_of
from controller.common.arguments.number_type import PORT, integer
from controller.common.command_line import version
from controller.common.errors import InputError
from controller.common.stop_request import StopRequest
from controller.core.input_filter import LONGEST_FILTER_MS
from controller.fx.engine.execution import fastest_execution
from controller.fx.engine.plc import FxPlc
from controller.fx.language.reading import load_ladder
from controller.hmi.ladder.live import LivePlc, run_live
from controller.hmi.mitsubishi.mc import DEFAULT_PORT as DEFAULT_MC_PORT
from controller.hmi.mitsubishi.mc import FRAMES, mc_tcp
from controller.hmi.mitsubishi.port_line import programming_port
from controller.hmi.modbus.endpoint import DEFAULT_PORT as DEFAULT_MODBUS_PORT
from controller.hmi.modbus.endpoint import modbus_tcp
from controller.hmi.serving.endpoints import Endpoint, EndpointNames, TcpEndpoint, TcpSettings
from controller.hmi.serving.server import DeviceServer
from controller.io.pace import FASTEST, FLAT_OUT, Pace

_MODBUS_NAMES: Final = EndpointNames(
    "Modbus server", "Modbus", "--host", "--modbus-port", "--allow-remote", "omit --serve-modbus"
)
_MC_NAMES: Final = EndpointNames(
    "MC server", "the MC protocol", "--host", "--mc-port", "--allow-remote", "omit --serve-mc"
)


def add_live_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the live mode."""
    live = parser.add_argument_group("live mode: the program runs until Ctrl-C, all devices can be read and written")
    live.add_argument("--serve-modbus", action="store_true", help="serve Modbus TCP with the addresses of an FX3U")
    live.add_argument("--modbus-port", type=PORT, default=DEFAULT_MODBUS_PORT, help="TCP port; 0 = any free port")
    live.add_argument(
        "--serve-mc", choices=FRAMES, default=None, help="serve the MC protocol: frames 1E (FX3U), or 3E and 4E (FX5U)"
    )
    live.add_argument("--mc-port", type=PORT, default=DEFAULT_MC_PORT, help="TCP port; 0 = any free port")
    live.add_argument(
        "--serve-port", default=None, metavar="DEVICE", help="serve the programming port on a serial line, 9600 7E1"
    )
    live.add_argument("--host", default="127.0.0.1", help="address to listen on")
    live.add_argument("--allow-remote", action="store_true", help="permit an address that other computers can reach")
    live.add_argument(
        "--scan-ms", type=integer(1, 1_000), default=10, help="scan period, ms; M8039 and D8039 can make it longer"
    )
    live.add_argument(
        "--input-filter-ms", type=integer(0, LONGEST_FILTER_MS), default=10, help="input filter of X0-X17, ms; 0 = off"
    )
    live.add_argument(
        "--pace",
        type=integer(1, FASTEST, also=FLAT_OUT),
        default=100,
        metavar="PERCENT",
        help="speed of time: 100 = real time, 65535 = fastest",
    )


def is_live(options: argparse.Namespace) -> bool:
    """Return True if the program runs live.

    Raises:
        InputError: Neither a stimulus nor a server is requested, or both are.
    """
    serves = options.serve_modbus or options.serve_mc is not None or options.serve_port is not None
    of_a_stimulus = {
        "--stimulus": options.stimulus is not None,
        "--json": options.json,
        "--changes": options.changes,
        "--picture": options.picture is not None,
    }
    given = [name for name, is_given in of_a_stimulus.items() if is_given]
    if serves and given:
        raise InputError(f"{' and '.join(given)}: no effect on a live program; omit it, or the --serve options")
    if not serves and options.stimulus is None:
        raise InputError("ladder run: specify --stimulus FILE, or --serve-modbus, --serve-mc or --serve-port")
    return bool(serves)


def run_live_program(options: argparse.Namespace) -> int:
    """Run a program until the request to stop and return the exit code.

    Raises:
        InputError: The program or an option is invalid.
    """
    ladder, peripherals = load_ladder(options.file, cpu_of(options)), peripherals_of(options)
    pace = Pace(options.pace)
    plc = FxPlc(ladder, input_filter_ms=options.input_filter_ms, execution=fastest_execution, peripherals=peripherals)
    live = LivePlc(plc)
    stop: StopRequest = options.stop
    stop.collect()
    with ExitStack() as stack:
        endpoints, ports = _endpoints(live, options)
        stack.enter_context(DeviceServer(endpoints, live.writes))
        served = {name: endpoint.port for name, endpoint in ports.items()}
        scans = run_live(live, pace, scan_ms=options.scan_ms, stop=stop, on_scan=_StateReport(served))
    print(f"stopped after {scans} scans", file=sys.stderr)
    return 0


class _StateReport:
    """Report of the ports after the first scan, from which on reads are answered, and of RUN, STOP and errors."""

    def __init__(self, served: dict[str, int]) -> None:
        self._served: dict[str, int] | None = served
        self._reported = "RUN"

    def __call__(self, live: LivePlc) -> None:
        if self._served is not None:
            print(json.dumps({"event": "serving", **self._served}), flush=True)
            self._served = None
        plc = live.plc
        state = "RUN" if plc.running else "STOP" if plc.error is None else f"STOP, {plc.error}"
        if state != self._reported:
            self._reported = state
            print(state, file=sys.stderr, flush=True)


def _endpoints(live: LivePlc, options: argparse.Namespace) -> tuple[list[Endpoint], dict[str, TcpEndpoint]]:
    """Return all endpoints, and those with a TCP port by the name of the port."""
    ports: dict[str, TcpEndpoint] = {}
    if options.serve_modbus:
        identity = {0: "seedling-transplanter", 1: options.file.name, 2: version()}
        settings = TcpSettings(options.host, options.modbus_port, options.allow_remote)
        ports["modbus_port"] = modbus_tcp(live, identity, settings, _MODBUS_NAMES)
    if options.serve_mc is not None:
        settings = TcpSettings(options.host, options.mc_port, options.allow_remote)
        ports["mc_port"] = mc_tcp(live, options.serve_mc, settings, _MC_NAMES)
    endpoints: list[Endpoint] = list(ports.values())
    if options.serve_port is not None:
        endpoints.append(programming_port(live, options.serve_port, "--serve-port"))
    return endpoints, ports
