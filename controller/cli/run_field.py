"""Field I/O of the command ``run``: options, link and the wait for its first response."""

from __future__ import annotations

import argparse
import sys

from controller.common.errors import InputError
from controller.common.stop_request import Stop
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.module_profiles import MODULE_PROFILES
from controller.io.output_guard import ModbusOutputGuard, ModuleKind
from controller.iomap.loader import IoMap

RETRY_S = 0.5
"""Interval between attempts to reach the field I/O, s."""
REMIND_S = 5.0
"""Interval between repeated reports that the field I/O does not respond, s."""
IDENTITY_MS = 50
"""Interval at which a module that lends its outputs is asked for refused writes, ms: half of the time within which both
sides must report a second master."""


def add_field_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the field I/O."""
    parser.add_argument("--host", default="127.0.0.1", help="Modbus TCP address of the field I/O")
    parser.add_argument("--port", type=int, default=5020, help="Modbus TCP port of the field I/O")
    parser.add_argument("--unit", type=int, default=1, help="Modbus unit identifier")
    parser.add_argument(
        "--module",
        choices=sorted(MODULE_PROFILES),
        default=None,
        help="I/O module whose write lock is set at the start (default: none)",
    )
    parser.add_argument("--timeout-ms", type=int, default=30, help="timeout of one response of the field I/O, ms")
    parser.add_argument(
        "--link-limit-ms",
        type=int,
        default=100,
        help="longest time until the loss of the field I/O is detected, ms",
    )


def field_link(io_map: IoMap, options: argparse.Namespace) -> ModbusTcpLink:
    """Return the closed link to the field I/O that the options name."""
    return ModbusTcpLink(options.host, options.port, io_map, unit=options.unit, timeout_s=options.timeout_ms / 1000)


def output_guard(link: ModbusTcpLink, options: argparse.Namespace) -> ModbusOutputGuard:
    """Return the detection of another master on the link."""
    return ModbusOutputGuard(link, every=max(1, IDENTITY_MS // options.scan_ms))


def check_field_numbers(options: argparse.Namespace) -> None:
    """Check the numbers of the field I/O.

    Raises:
        InputError: A number is out of range.
    """
    for name, value, least, most in (
        ("--port", options.port, 1, 65_535),
        ("--unit", options.unit, 1, 255),
        ("--timeout-ms", options.timeout_ms, 1, 10_000),
        ("--link-limit-ms", options.link_limit_ms, 1, 10_000),
    ):
        if not least <= value <= most:
            raise InputError(f"{name} {value}: must be {least} to {most}")
    wait_ms = options.timeout_ms + options.scan_ms
    # A response takes no simulated time.
    if options.link_limit_ms <= wait_ms and not options.simulated_time:
        raise InputError(
            f"--link-limit-ms {options.link_limit_ms}: must be more than --timeout-ms plus --scan-ms, {wait_ms} ms"
        )


def wait_for_field(link: ModbusTcpLink, guard: ModbusOutputGuard, options: argparse.Namespace, stop: Stop) -> bool:
    """Wait until the field I/O responds, with periodic reports while it does not; return False if `stop` is set."""
    tries = 0
    while not stop.is_set():
        try:
            link.open()
            link.read_inputs()
            if options.module is not None:
                MODULE_PROFILES[options.module].apply(link)
            kind = guard.identify()
        except OSError as error:
            if tries % round(REMIND_S / RETRY_S) == 0:
                print(f"{error}; retrying", file=sys.stderr, flush=True)
            tries += 1
            stop.wait(RETRY_S)
        else:
            print(f"field I/O at {options.host}:{options.port} responds", file=sys.stderr, flush=True)
            if kind is ModuleKind.BLIND:
                print("its outputs cannot be read back: another master is not detected", file=sys.stderr, flush=True)
            return True
    return False
