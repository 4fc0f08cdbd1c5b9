"""Command ``hil``: judge any controller of the machine on the simulated plant."""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

from controller.common.errors import InputError
from controller.common.stop_request import INTERRUPTED
from plant_sim.cli import connect, serve
from plant_sim.cli.options import add_air_argument, add_fault_arguments, add_machine_arguments, faults_of
from plant_sim.cli.serving import add_frequency_argument, build
from plant_sim.hil.bench import Bench, BenchLimits
from plant_sim.hil.bench_run import FIRST_GROUPS, GROUPS, BenchRun, CaseResult, CaseVerdict
from plant_sim.hil.delaying_module import DelayingModule
from plant_sim.hil.report import junit, line, page, summary, write
from plant_sim.hil.timing_picture import timing_picture
from plant_sim.links.in_process import InProcessLink
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.machine.parameters import Machine
from plant_sim.twin.commissioning import set_points_of
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.own_program import drive
from plant_sim.twin.trial import run_trial

TRAYS: Final = 60
"""Trays in the magazine, enough for all cases with the reference program."""
MOST_MS: Final = 10_000
"""Largest limit that can be given, ms."""
NO_LINK: Final = {"watchdog_ms": 100, "real_time_priority": None, "real_time_cpu": None}
"""Options that have no effect on a controller in the same process."""
ABOUT: Final = "Controller on the simulated transplanter"
STOPPED: Final = "stopped before the last case"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the ways to the controller with their options."""
    ways = parser.add_subparsers(required=True, metavar="WAY")
    server = ways.add_parser("serve", help="the controller is a Modbus client of the plant, as with 'serve'")
    serve.add_arguments(server)
    _add_judge(server)
    server.set_defaults(judge=_judge_client)
    client = ways.add_parser("connect", help="the plant is a client of the PLC, as with 'connect'")
    connect.add_arguments(client)
    _add_judge(client)
    client.set_defaults(judge=_judge_plc)
    own = ways.add_parser("program", help="the controller is the machine's own program, in this process")
    add_machine_arguments(own)
    add_frequency_argument(own)
    add_air_argument(own)
    add_fault_arguments(own)
    _add_judge(own)
    own.set_defaults(judge=_judge_program, lock_step_ms=SCAN_MS, **NO_LINK)


def run(options: argparse.Namespace) -> int:
    """Run the cases; return 0 if none failed, 1 if one failed, and `INTERRUPTED` before the last case.

    Raises:
        InputError: An option or a file is invalid, or a port cannot be opened.
    """
    code: int = options.judge(options)
    return code


def _add_judge(parser: argparse.ArgumentParser) -> None:
    """Add the options of the judgement."""
    limits = BenchLimits()
    judge = parser.add_argument_group("judgement")
    judge.add_argument(
        "--cases",
        action="append",
        choices=GROUPS,
        default=None,
        metavar="GROUP",
        help=f"group of cases to run: {', '.join(GROUPS)}; may be repeated (default: all); {', '.join(FIRST_GROUPS)} "
        "always run",
    )
    judge.add_argument("--only", default="", metavar="TEXT", help="run the further cases whose names contain this text")
    judge.add_argument(
        "--stop-ms", type=int, default=limits.stop_ms, help="longest time from emergency stop to outputs off"
    )
    judge.add_argument(
        "--margin-ms", type=int, default=limits.margin_ms, help="least increase of the scan time to be tolerated"
    )
    judge.add_argument(
        "--no-reference",
        action="store_true",
        help="do not compare the losses of the trial with those of the machine's own program",
    )
    judge.add_argument("--out", type=Path, required=True, help="folder for hil.xml (JUnit) and hil.html")
    parser.set_defaults(trays=TRAYS)


def _judge_client(options: argparse.Namespace) -> int:
    serve.check(options)
    judgement = _Judgement(options)
    serve.operate_server(options, judgement.module, judgement.machine, judgement.begin)
    return judgement.finish()


def _judge_plc(options: argparse.Namespace) -> int:
    connect.check(options)
    judgement = _Judgement(options)
    connect.operate_client(options, judgement.module, judgement.machine, judgement.begin)
    return judgement.finish()


def _judge_program(options: argparse.Namespace) -> int:
    judgement = _Judgement(options)
    ended = threading.Event()
    judgement.play(ended.set)
    drive(
        InProcessLink(judgement.module),
        until=lambda: ended.is_set() or options.stop.is_set(),
        set_points=set_points_of(judgement.machine),
    )
    return judgement.finish()


class _Judgement:
    """Plant, bench and cases of one run of the command.

    Attributes:
        module: I/O module.
        machine: Parameters of the machine.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        for name in ("stop_ms", "margin_ms"):
            if not 0 <= getattr(options, name) <= MOST_MS:
                raise InputError(f"--{name.replace('_', '-')} {getattr(options, name)}: must be 0 to {MOST_MS}")
        self.module, self.machine = build(options, DelayingModule)
        self._bench = Bench(
            self.module, self.machine, BenchLimits(stop_ms=options.stop_ms, margin_ms=options.margin_ms)
        )
        self._run = BenchRun(
            self._bench,
            groups=options.cases or GROUPS,
            only=options.only,
            reference_lost=None if options.no_reference else _reference_lost(options, self.module, self.machine),
            report=lambda result: print(line(result), flush=True),
        )
        _check_folder(options.out)

    def begin(self, server: PlantServer) -> None:
        """Begin the run; the server ends with it."""
        self.play(server.end)

    def play(self, ended: Callable[[], None]) -> None:
        """Begin the run; `ended` is called after its end."""
        self._bench.play(self._run.procedure(), ended=ended)

    def finish(self) -> int:
        """Write the reports and return the exit code."""
        options, results = self._options, self._run.results
        time_base = f"lock step, {options.lock_step_ms} ms" if options.lock_step_ms else "real time"
        facts = (f"machine {options.machine}, seed {options.seed}, {options.trays} trays", time_base)
        timing = self.module.timing.lines()
        about = ABOUT if self._run.is_complete else f"{ABOUT} ({STOPPED})"
        xml, html = junit(results, about=about), page(results, about=about, facts=[*facts, *timing], picture=self._draw)
        print(summary(results), *write(options.out, xml, html), sep="\n")
        if not self._run.is_complete:
            print(STOPPED, file=sys.stderr)
            return INTERRUPTED
        return 1 if any(each.verdict is CaseVerdict.FAILED for each in results) else 0

    def _draw(self, result: CaseResult) -> str:
        title = f"{result.group}: {result.name}"
        trace, io_map = self._bench.trace, self.module.io_map
        return timing_picture(trace, io_map, result.mark_ms, title=title, to_ms=result.to_ms)


def _reference_lost(options: argparse.Namespace, module: IoModule, machine: Machine) -> int:
    """Return the seedlings that the machine's own program loses in the same trial in lock step.

    Raises:
        InputError: The program does not complete the trial, so that there is nothing to compare with.
    """

    def prepare(twin: Twin) -> None:
        twin.plant.planting_frequency_per_min = module.plant.planting_frequency_per_min

    report = run_trial(
        seed=options.seed,
        io_map=module.io_map,
        parameters=machine,
        faults=faults_of(options),
        prepare=prepare,
    )
    if not report.completed:
        raise InputError("the machine's own program does not complete this trial; add --no-reference")
    return report.P + report.D + report.T


def _check_folder(folder: Path) -> None:
    """Report a folder that cannot be written before the run, not after it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}: {error.strerror}; choose another folder") from error
