"""Command ``check-io``: check the wire of every point, with a report to sign."""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path

from controller.cli.machine import add_io_map
from controller.cli.run_field import (
    add_field_arguments,
    check_field_times,
    field_plan,
    output_guard,
    require_watchdogs,
)
from controller.commissioning.checked_field import PERIOD_S, CheckedField
from controller.commissioning.report import CheckReport, write_report
from controller.commissioning.terminal import single_keys
from controller.commissioning.texts import PROMPTS, said
from controller.commissioning.wire_check import WireCheck
from controller.common.command_line import version
from controller.common.errors import InputError
from controller.common.modbus.io_map import IoMap, Point
from controller.common.suggestion import suggestion
from controller.core.clock import MonotonicClock, utc_ms
from controller.io.field.link import DevicesLink
from controller.iomap.loader import load_io_map


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``check-io``."""
    add_io_map(parser)
    # One late answer ends the check, so that it waits longer than the scan of a running machine would.
    add_field_arguments(parser, timeout_ms=100)
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="POINT",
        help="check only this point, by tag or address, or 'inputs' or 'outputs'; may be repeated",
    )
    parser.add_argument("--language", choices=("en", "zh"), default="en", help="language of the texts and the report")
    parser.add_argument("--machine-name", default="-", help="name of the machine in the report")
    parser.add_argument("--tester", default="", help="name of the person in the report (default: filled in by hand)")
    parser.add_argument("--out", type=Path, default=Path("var"), metavar="FOLDER", help="folder of the report")
    parser.set_defaults(scan_ms=round(1_000 * PERIOD_S), simulated_time=False)


def run(options: argparse.Namespace) -> int:
    """Check the points; return 0 if all are correct, otherwise 1.

    Raises:
        InputError: An option is invalid, the field I/O does not respond, its outputs are in use, or standard input is
            not a terminal.
    """
    check_field_times(options)
    io_map = load_io_map(options.io_map)
    link = DevicesLink(field_plan(io_map, options), io_map)
    report = CheckReport(
        io_map,
        chosen(io_map, options.only),
        options.machine_name,
        ", ".join(device.label for device in link.devices),
        f"seedling-transplanter {version()}",
        options.tester,
        utc_ms(),
    )
    _check_folder(options.out)
    with contextlib.closing(link), single_keys(options.stop) as terminal:
        try:
            link.open()
            guard = output_guard(link, options)
            guard.identify()
            holder = guard.holder(io_map.safe_outputs())
        except OSError as error:
            raise InputError(f"check-io: {error}") from error
        require_watchdogs(link, options)
        if holder:
            raise InputError(f"check-io: outputs are in use: {holder}; stop the other controller first")
        field = CheckedField(link, io_map, terminal, MonotonicClock(), options.stop)
        WireCheck(field, report, options.language, utc_ms).run()
    path = write_report(report, options.out, options.language)
    with contextlib.suppress(OSError):  # the terminal may have been closed
        print(said(PROMPTS["report"], options.language, path=str(path)), flush=True)
    return 0 if report.is_clean else 1


def chosen(io_map: IoMap, names: list[str]) -> list[Point]:
    """Return the points to check, in the order of the map.

    Raises:
        InputError: A name is unknown.
    """
    points = [*io_map.inputs, *io_map.outputs]
    groups = {"inputs": [*io_map.inputs], "outputs": [*io_map.outputs]}
    wanted: list[Point] = []
    for name in names:
        found = groups.get(name) or [point for point in points if name in (point.tag, point.address)]
        if not found:
            known = [*groups, *(word for point in points for word in (point.tag, point.address))]
            raise InputError(f"--only {name}: no such point in {io_map.path}; {suggestion(name, known)}")
        wanted += found
    return [point for point in points if point in wanted or not names]


def _check_folder(folder: Path) -> None:
    """Report a folder that cannot be written before anything is checked; the report creates it."""
    try:
        existing = next(each for each in (folder, *folder.parents) if each.exists())
        probe = existing / ".check-io"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(f"--out {folder}: {error.strerror}; choose a writable folder") from error
