"""Study ``campaign``: options, execution and summary."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from typing import TYPE_CHECKING

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.cli.options.study import TIMEOUT_S
from plant_sim.cli.reproduce.origin import provenance_of
from plant_sim.cli.study.progress import study_progress
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.common.provenance.result_files import with_provenance
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.study.errors import StudyError

if TYPE_CHECKING:
    from plant_sim.study.campaign.campaign import CampaignResult
    from plant_sim.study.engines import Engine


def run(options: argparse.Namespace) -> int:
    """Run a campaign and print its summary.

    Raises:
        InputError: An option or a file is invalid, or the campaign was interrupted.
    """
    from plant_sim.study.campaign.campaign import SHARD_RUNS, CampaignOptions, run_campaign  # noqa: PLC0415
    from plant_sim.study.campaign.file import load_campaign  # noqa: PLC0415
    from plant_sim.study.factors import ratings_exceeded  # noqa: PLC0415

    if options.out is None:
        raise StudyError("--out: is missing; specify the folder of the campaign")
    provenance = provenance_of(options)
    engine = _engine(options)
    machine, io_map = load_machine(options.machine or DEFAULT_MACHINE), load_io_map(options.io_map or DEFAULT_IO_MAP)
    campaign = load_campaign(
        options.file, machine, io_map, trials=options.trials, seed=options.seed, seedlings=options.seedlings
    )
    provenance = dataclasses.replace(provenance, seed=campaign.seed)
    for warning in ratings_exceeded(campaign.design.settings, machine):
        _notice(f"warning: {warning}")
    with study_progress("runs") as progress:
        result = run_campaign(
            campaign,
            CampaignOptions(
                folder=options.out,
                machine=machine,
                io_map=io_map,
                engine=engine,
                shard_runs=options.shard or SHARD_RUNS,
                progress=progress,
                notice=_notice,
                provenance=provenance,
            ),
        )
    sys.stdout.write(_json(options, result, provenance, machine) if options.json else _text(options, result, machine))
    return 0


def _engine(options: argparse.Namespace) -> Engine:
    """Return the engine.

    Raises:
        StudyError: An option is missing, invalid or without effect.
    """
    from plant_sim.study.campaign.version import code_version  # noqa: PLC0415
    from plant_sim.study.engines import DaskEngine, ProcessEngine  # noqa: PLC0415

    if options.engine != "dask":
        for name in ("scheduler", "timeout"):
            if getattr(options, name) is not None:
                raise StudyError(f"--{name}: has no effect without --engine dask; omit it, or add --engine dask")
        return ProcessEngine(options.workers)
    if options.workers is not None:
        raise StudyError("--workers: has no effect with --engine dask, whose workers are started separately; omit it")
    if options.scheduler is None or not options.scheduler.startswith("tcp://"):
        given = "is missing" if options.scheduler is None else f"{options.scheduler}: is not an address"
        raise StudyError(f"--scheduler {given}; write tcp://HOST:PORT, as the scheduler prints it")
    return DaskEngine(options.scheduler, options.timeout or TIMEOUT_S, code_version)


def _notice(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def _text(options: argparse.Namespace, result: CampaignResult, machine: Machine) -> str:
    from plant_sim.study.report.origin import origin_parts  # noqa: PLC0415

    origin = "\n".join(origin_parts(machine, options.machine))
    stored = result.runs - result.computed
    incomplete = f"{result.incomplete} trials did not complete and have no rates"
    return (
        f"{origin}\n"
        f"{result.runs} runs in {result.files} files in {options.out / 'runs'}: {result.computed} computed now, "
        f"{stored} stored before\n"
        f"{incomplete if result.incomplete else 'all trials completed'}\n"
        f"version {result.version}\n"
    )


def _json(options: argparse.Namespace, result: CampaignResult, provenance: Provenance, machine: Machine) -> str:
    from plant_sim.study.report.origin import changed_keys, origin_parts  # noqa: PLC0415

    record = {
        "origin": origin_parts(machine, options.machine),
        "changed_parameters": changed_keys(machine),
        "campaign": str(options.file),
        "folder": str(options.out / "runs"),
        "version": result.version,
        "runs": result.runs,
        "computed": result.computed,
        "incomplete": result.incomplete,
        "files": result.files,
    }
    return json.dumps(with_provenance(record, provenance), indent=2, ensure_ascii=False) + "\n"
