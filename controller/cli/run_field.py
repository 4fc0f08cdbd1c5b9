"""Field I/O of the command ``run``: options, link and the wait for its first response."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final

from controller.common.arguments.number_type import REMOTE_PORT, integer
from controller.common.errors import InputError
from controller.common.modbus.io_map import IoMap, OutputRegister, Point
from controller.common.stop_request import Stop
from controller.io.field.field_file import FieldFileError, FieldPlan, load_field, one_device, place_of
from controller.io.field.link import DevicesLink
from controller.io.output_guard import ModbusOutputGuard

RETRY_S = 0.5
"""Interval between attempts to reach the field I/O, s."""
REMIND_S = 5.0
"""Interval between repeated reports that the field I/O does not respond, s."""
IDENTITY_MS = 50
"""Interval at which a module that lends its outputs is asked for refused writes, ms: half of the time within which both
sides must report a second master."""
MODULES: Final = {None: "coils", "beckhoff-ek9000": "beckhoff-ek9000-coils"}
"""Profile by value of ``--module``."""
_OF_ONE_DEVICE: Final = ("host", "port", "unit", "module", "timeout_ms", "watchdog_ms")
"""Options of the field I/O that a field file replaces."""
_RISK: Final = "if this process is killed or suspended, the outputs may keep their last state"
_AT_RISK: Final = f"accept the risk with --allow-no-output-watchdog ({_RISK})"


def add_field_arguments(parser: argparse.ArgumentParser, *, timeout_ms: int = 30) -> None:
    """Add the options of the field I/O; `timeout_ms` is the default timeout of one response."""
    parser.add_argument(
        "--field",
        type=Path,
        default=None,
        metavar="FILE",
        help="field file: devices, their connections and the place of every wire (default: one Modbus TCP device, "
        "given by --host, --port and --unit, with the offsets of the I/O map)",
    )
    parser.add_argument("--host", default="127.0.0.1", help="Modbus TCP address of the field I/O")
    parser.add_argument("--port", type=REMOTE_PORT, default=5020, help="Modbus TCP port of the field I/O")
    parser.add_argument("--unit", type=integer(1, 255), default=1, help="Modbus unit identifier")
    parser.add_argument(
        "--module",
        choices=sorted(filter(None, MODULES)),
        default=None,
        help="I/O module whose write lock is set at every connection (default: none)",
    )
    parser.add_argument(
        "--timeout-ms",
        type=integer(1, 10_000),
        default=timeout_ms,
        help="timeout of one response of the field I/O, ms",
    )
    parser.add_argument(
        "--watchdog-ms",
        type=integer(10, 60_000),
        default=None,
        help="time of the output watchdog of the field I/O, which is set with the tool of the module, ms (the "
        "simulated plant reports its own)",
    )
    parser.add_argument(
        "--allow-no-output-watchdog",
        action="store_true",
        help="permit outputs without a known output watchdog: if this process is killed or suspended, or the "
        "connection is cut, they may keep their last state. Never use this for a machine that moves",
    )
    parser.set_defaults(link_limit_ms=None, one_device={name: parser.get_default(name) for name in _OF_ONE_DEVICE})


def add_link_limit(parser: argparse.ArgumentParser) -> None:
    """Add the time limit of the field link, for a command that bridges short interruptions."""
    parser.add_argument(
        "--link-limit-ms",
        type=integer(1, 10_000),
        default=100,
        help="longest time until the loss of the field I/O is detected, ms",
    )


def field_plan(io_map: IoMap, options: argparse.Namespace) -> FieldPlan:
    """Return the devices of the field file, or the one device that the options name.

    Raises:
        InputError: The field file is invalid, or it does not fit the options.
    """
    if options.field is None:
        return one_device(
            io_map,
            options.host,
            options.port,
            unit=options.unit,
            timeout_ms=options.timeout_ms,
            profile=MODULES[options.module],
            watchdog_ms=options.watchdog_ms,
        )
    for name, default in options.one_device.items():
        if getattr(options, name) != default:
            option = f"--{name.replace('_', '-')}"
            raise InputError(f"{option}: cannot be combined with --field; write it in {options.field}")
    plan = load_field(options.field, io_map)
    _check_times(plan, options)
    if not options.allow_no_output_watchdog:
        _check_watchdogs(plan)
    return plan


def print_places(plan: FieldPlan, io_map: IoMap) -> None:
    """Print the address, tag, device and place of every wire, by address."""
    wires: tuple[Point | OutputRegister, ...] = (*io_map.inputs, *io_map.outputs, *io_map.registers)
    rows = {}
    for device in plan.devices:
        for letter, places in (("X", device.inputs), ("Y", device.outputs), ("D", device.registers)):
            for number, offset in places:
                place = place_of(letter, offset, device.traits)
                if place is not None:
                    rows[letter, number] = (device, place)
    for wire in wires:
        device, (table, offset, bit) = rows[wire.device, wire.number]
        where = f"{table} {offset}" + ("" if bit is None else f" bit {bit}")
        print(f"{wire.address:5} {wire.tag:24} {device.name or 'device':20} unit {device.unit:<4} {where}")


def output_guard(link: DevicesLink, options: argparse.Namespace) -> ModbusOutputGuard:
    """Return the detection of another master on the link."""
    return ModbusOutputGuard(link, every=max(1, IDENTITY_MS // options.scan_ms))


def check_field_times(options: argparse.Namespace) -> None:
    """Check that the times of the field I/O fit each other.

    Raises:
        InputError: A time is too short.
    """
    if options.link_limit_ms is None:
        return
    if options.watchdog_ms is not None and options.watchdog_ms <= options.link_limit_ms + options.scan_ms:
        raise InputError(
            f"--watchdog-ms {options.watchdog_ms}: must be more than --link-limit-ms plus --scan-ms, "
            f"{options.link_limit_ms + options.scan_ms} ms"
        )
    least_ms = options.timeout_ms + options.scan_ms
    # A response takes no simulated time.
    if options.field is None and options.link_limit_ms <= least_ms and not options.simulated_time:
        raise InputError(
            f"--link-limit-ms {options.link_limit_ms}: must be more than --timeout-ms plus --scan-ms, {least_ms} ms"
        )


def require_watchdogs(link: DevicesLink, options: argparse.Namespace) -> None:
    """Require that every identified device that drives something has a known output watchdog, or report the risk.

    Raises:
        InputError: A device has none, and this is not permitted.
    """
    for device in link.devices:
        if device.watchdog_ms is not None or not device.plan.drives:
            continue
        if not options.allow_no_output_watchdog:
            raise InputError(
                f"--watchdog-ms: field I/O {device.label} reports no output watchdog; set it with the tool of the "
                f"module and give its time, or {_AT_RISK}"
            )
        print(
            f"warning: field I/O {device.label} has no known output watchdog: {_RISK}",
            file=sys.stderr,
            flush=True,
        )


def wait_for_field(link: DevicesLink, guard: ModbusOutputGuard, stop: Stop) -> bool:
    """Wait until the field I/O responds, with periodic reports while it does not; return False if `stop` is set."""
    tries = 0
    while not stop.is_set():
        try:
            link.open()
            link.read_inputs()
            guard.identify()
        except OSError as error:
            if tries % round(REMIND_S / RETRY_S) == 0:
                print(f"{error}; retrying", file=sys.stderr, flush=True)
            tries += 1
            stop.wait(RETRY_S)
        else:
            for device in link.devices:
                model = f", model {' '.join(map(str, device.model))}" if device.model else ""
                print(f"field I/O {device.label} responds{model}", file=sys.stderr, flush=True)
            for label in guard.blind:
                print(
                    f"outputs of field I/O {label} cannot be read back: another master is not detected",
                    file=sys.stderr,
                    flush=True,
                )
            return True
    return False


def _check_times(plan: FieldPlan, options: argparse.Namespace) -> None:
    """Check that a loss is detected in time, and that the output watchdogs do not trip before.

    Without a limit of the link, the first missing answer is a loss.
    """
    least_ms = plan.wait_ms + options.scan_ms
    limit_ms = least_ms if options.link_limit_ms is None else options.link_limit_ms
    if options.link_limit_ms is not None and limit_ms <= least_ms and not options.simulated_time:
        device = max(plan.devices, key=lambda device: device.timeout_ms)
        raise FieldFileError(
            f"{plan.path}:{device.file_line}: {device.name}.timeout_ms: the timeouts plus --scan-ms are {least_ms} ms "
            f"(added on a serial line), not less than --link-limit-ms {limit_ms}; shorten timeout_ms or "
            "give a longer --link-limit-ms"
        )
    for device in plan.devices:
        longest_ms = limit_ms + device.poll_every * options.scan_ms
        limit = "the timeouts" if options.link_limit_ms is None else "--link-limit-ms"
        if device.watchdog_ms is not None and device.watchdog_ms <= longest_ms:
            raise FieldFileError(
                f"{plan.path}:{device.file_line}: {device.name}.watchdog_ms: {device.watchdog_ms} ms is not longer "
                f"than {limit} plus the polling interval, {longest_ms} ms; write a longer time"
            )


def _check_watchdogs(plan: FieldPlan) -> None:
    """Check that every device that drives something switches its outputs off when nobody writes.

    Raises:
        FieldFileError: A device has no output watchdog, or its time is not stated.
    """
    for device in plan.devices:
        if device.watchdog_ms is not None or not device.drives:
            continue
        if device.traits.watchdog == "none":
            fault = "watchdog: none switches the outputs off when nobody writes; use a module with an output watchdog"
        else:
            fault = "watchdog_ms: is missing; write the time of the output watchdog that the tool of the module has set"
        raise FieldFileError(f"{plan.path}:{device.file_line}: {device.name}.{fault}, or {_AT_RISK}")
