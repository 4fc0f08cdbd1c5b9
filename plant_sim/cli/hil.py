"""Command ``hil``: judge any controller of the machine on the simulated plant."""

from __future__ import annotations

import argparse
import asyncio
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

from controller.common.errors import InputError
from controller.common.stop_request import INTERRUPTED
from plant_sim.cli import connect, serve
from plant_sim.cli.reproduce.origin import provenance_of
from plant_sim.cli.serving import build
from plant_sim.cli.settings import faults_of
from plant_sim.hil.bench import Bench, ControllerSupply
from plant_sim.hil.bench_module import BenchModule
from plant_sim.hil.bench_run import BenchRun, CaseResult, CaseVerdict
from plant_sim.hil.own_program import drive
from plant_sim.hil.own_trial import OwnTrialError, measure
from plant_sim.hil.random_operator import SECONDS_PER_TRAY
from plant_sim.hil.reference import TrialQuantities
from plant_sim.hil.reporting.report import junit, line, page, summary, write
from plant_sim.hil.reporting.timing_picture import timing_picture
from plant_sim.hil.selection import GROUPS, SHORT_GROUPS, BenchLimits
from plant_sim.links.in_process import InProcessLink
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import set_points_of

ABOUT: Final = "Controller on the simulated transplanter"
STOPPED: Final = "stopped before the last case"


def run(options: argparse.Namespace) -> int:
    """Run the cases; return 0 if none failed, 1 if one failed or nothing is written, `INTERRUPTED` if stopped.

    Raises:
        InputError: An option or a file is invalid, or a port cannot be opened.
    """
    judge = {"serve": _judge_client, "connect": _judge_plc, "program": _judge_program}[options.way]
    return judge(options)


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
    ended, supply = threading.Event(), ControllerSupply()
    judgement.bench.supply = supply
    judgement.play(ended.set)
    drive(
        InProcessLink(judgement.module),
        supply,
        until=lambda: ended.is_set() or options.stop.is_set(),
        set_points=set_points_of(judgement.machine),
    )
    return judgement.finish()


class _Judgement:
    """Plant, bench and cases of one run of the command.

    Attributes:
        module: I/O module.
        machine: Parameters of the machine.
        bench: Bench.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._provenance = provenance_of(options)
        self._silent = False
        if options.random_operator and not options.lock_step_ms:
            raise InputError("--random-operator: only in lock step; add --lock-step-ms 10")
        if options.short and options.cases:
            raise InputError("--short: selects the groups itself; omit it, or --cases")
        options.trays += options.random_operator // SECONDS_PER_TRAY
        self.module, self.machine = build(options, BenchModule)
        self.bench = Bench(self.module, self.machine, BenchLimits(stop_ms=options.stop_ms, margin_ms=options.margin_ms))
        self._run = BenchRun(
            self.bench,
            groups=options.cases or (SHORT_GROUPS if options.short else GROUPS),
            only=options.only,
            reference=None if options.no_reference else _reference(options, self.module, self.machine),
            random_s=options.random_operator,
            random_seed=options.random_seed,
            report=lambda result: print(line(result), flush=True),
        )
        _check_folder(options.out)

    def begin(self, server: PlantServer) -> None:
        """Begin the run; the server ends with it, and in lock step also if the controller writes nothing more."""
        self.play(server.end)
        if self._options.lock_step_ms:
            self._watch(server, -1)

    def _watch(self, server: PlantServer, writes: int) -> None:
        """End the server if no output has been written since the last call."""
        if self.module.block_writes == writes:
            self._silent = True
            server.end()
        else:
            loop = asyncio.get_running_loop()
            loop.call_later(self._options.wait_s, self._watch, server, self.module.block_writes)

    def play(self, ended: Callable[[], None]) -> None:
        """Begin the run; `ended` is called after its end."""
        self.bench.play(self._run.procedure(), ended=ended)

    def finish(self) -> int:
        """Write the reports and return the exit code."""
        options, results = self._options, self._run.results
        time_base = f"lock step, {options.lock_step_ms} ms" if options.lock_step_ms else "real time"
        facts = (f"machine {options.machine.name}, seed {options.seed}, {options.trays} trays", time_base)
        timing = self.module.timing.lines()
        ended = f"{STOPPED}: no output was written for {options.wait_s} s" if self._silent else STOPPED
        about = ABOUT if self._run.is_complete else f"{ABOUT} ({ended})"
        xml = junit(results, about=about, provenance=self._provenance)
        html = page(
            results,
            about=about,
            facts=[*facts, *timing],
            picture=self._draw,
            provenance=self._provenance,
        )
        interrupted = not self._run.is_complete
        print(summary(results), *write(options.out, xml, html, self._provenance, interrupted=interrupted), sep="\n")
        if interrupted:
            print(ended, file=sys.stderr)
            return 1 if self._silent else INTERRUPTED
        return 1 if any(each.verdict is CaseVerdict.FAILED for each in results) else 0

    def _draw(self, result: CaseResult) -> str:
        title = f"{result.group}: {result.name}"
        trace, io_map = self.bench.trace, self.module.io_map
        return timing_picture(trace, io_map, result.mark_ms, title=title, to_ms=result.to_ms)


def _reference(options: argparse.Namespace, module: IoModule, machine: Machine) -> TrialQuantities:
    """Return the quantities of the same trial with the machine's own program, in lock step.

    Raises:
        InputError: The program does not complete the trial, so that there is nothing to compare with.
    """
    plant = Plant(module.io_map, machine, seed=options.seed, trays=options.trays, faults=faults_of(options))
    try:
        return measure(plant, module.io_map, machine)
    except OwnTrialError as error:
        raise InputError(f"{error}; add --no-reference") from error


def _check_folder(folder: Path) -> None:
    """Report a folder that cannot be written before the run, not after it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}: {error.strerror}; choose another folder") from error
