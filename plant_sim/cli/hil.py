"""Command ``hil``: judge any controller of the machine on the simulated plant."""

from __future__ import annotations

import argparse
import asyncio
import sys
from pathlib import Path

from controller.common.errors import InputError
from controller.common.modbus.address import listening_remedy
from controller.iomap.loader import IoMap, load_io_map
from plant_sim.cli.network import add_network_arguments, check_port
from plant_sim.cli.options import add_machine_arguments, check_machine_arguments, machine_of
from plant_sim.hil.bench import Bench, BenchLimits
from plant_sim.hil.delaying_module import DelayingModule
from plant_sim.hil.report import junit, line, page, summary, write
from plant_sim.hil.session import FIRST_GROUPS, GROUPS, CaseResult, Session, Verdict
from plant_sim.hil.timing_picture import timing_picture
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.serve import serve
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.trial import run_trial

TRAYS = 60
"""Trays in the magazine, enough for all cases with the reference program."""
ABOUT = "Controller on the simulated transplanter"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``hil``."""
    add_machine_arguments(parser)
    parser.set_defaults(trays=TRAYS)
    add_network_arguments(parser)
    parser.add_argument("--allow-remote", action="store_true", help="permit a --host that other computers can reach")
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
        "--cases",
        action="append",
        choices=GROUPS,
        default=None,
        metavar="GROUP",
        help=f"groups to run after the first ones ({', '.join(FIRST_GROUPS)}), which always run; may be repeated; "
        f"one of {', '.join(GROUPS[len(FIRST_GROUPS) :])} (default: all)",
    )
    parser.add_argument(
        "--stop-ms", type=int, default=BenchLimits().stop_ms, help="longest time from emergency stop to outputs off"
    )
    parser.add_argument(
        "--margin-ms", type=int, default=BenchLimits().margin_ms, help="least increase of the scan time to be tolerated"
    )
    parser.add_argument(
        "--no-reference",
        action="store_true",
        help="do not compare the losses of the trial with those of the machine's own program",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for hil.xml (JUnit) and hil.html")


def run(options: argparse.Namespace) -> int:
    """Run the cases; return 0 if none failed and every requested one was run.

    Raises:
        InputError: An option or a file is invalid, or the port is in use.
    """
    check_machine_arguments(options)
    check_port(options)
    io_map, machine = load_io_map(options.io_map), machine_of(options)
    try:
        module = DelayingModule(
            Plant(io_map, machine, seed=options.seed, trays=options.trays), io_map, watchdog_ms=options.watchdog_ms
        )
        server = PlantServer(
            module,
            host=options.host,
            port=options.port,
            lock_step_ms=options.lock_step_ms,
            allow_remote=options.allow_remote,
        )
    except ValueError as error:
        raise InputError(str(error)) from error
    _check_folder(options.out)
    bench = Bench(module, machine, BenchLimits(stop_ms=options.stop_ms, margin_ms=options.margin_ms))
    session = Session(
        bench,
        groups=options.cases or GROUPS,
        reference_lost=None if options.no_reference else _reference_lost(options.seed, io_map, machine),
        report=lambda result: print(line(result), flush=True),
    )

    def listening(port: int) -> None:
        print(f"plant listening on {options.host}:{port}; start the controller", flush=True)
        bench.play(session.story(), ended=server.end)

    try:
        asyncio.run(serve(server, options.stop, listening=listening))
    except OSError as error:
        reason = error.strerror or str(error)
        text = f"cannot listen on {options.host}:{options.port}: {reason}; {listening_remedy(error)}"
        raise InputError(text) from error
    return _finish(session, bench, options)


def _finish(session: Session, bench: Bench, options: argparse.Namespace) -> int:
    """Write the reports and return the exit code."""
    results = session.results
    time_base = f"lock step, {options.lock_step_ms} ms" if options.lock_step_ms else "real time"
    facts = (f"machine {options.machine}, seed {options.seed}, {options.trays} trays", time_base)

    def picture(result: CaseResult) -> str:
        title = f"{result.group}: {result.name}"
        return timing_picture(bench.trace, bench.module.io_map, result.mark_ms, title=title, to_ms=result.to_ms)

    paths = write(
        options.out,
        junit(results, about=ABOUT),
        page(results, about=ABOUT, facts=facts, picture=picture),
    )
    print(summary(results), *paths, sep="\n")
    if not session.is_complete:
        print("stopped before the last case", file=sys.stderr)
        return 1
    return 1 if any(each.verdict is Verdict.FAILED for each in results) else 0


def _reference_lost(seed: int, io_map: IoMap, machine: Machine) -> int:
    """Return the seedlings that the machine's own program loses in the same trial in lock step."""
    report = run_trial(seed=seed, io_map=io_map, parameters=machine)
    return report.P + report.D + report.T


def _check_folder(folder: Path) -> None:
    """Report a folder that cannot be written before the session, not after it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}: {error.strerror}; choose another folder") from error
