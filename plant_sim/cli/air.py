"""Command ``air``: air consumption of a recording or a trial, compared with Table 1 of the paper."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from controller.iomap.loader import load_io_map
from plant_sim.cli.reproduce.origin import print_json, provenance_of
from plant_sim.cli.settings import machine_of
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.scope.store import Recording
from plant_sim.study.air_consumption import air_of
from plant_sim.twin.trial import run_trial


def run(options: argparse.Namespace) -> int:
    """Print the comparison for a recording, or for a new trial if no recording is given.

    Returns:
        0; 1 if the trial did not complete.

    Raises:
        RecordingError: The recording is invalid.
        IoMapError: The I/O map is invalid.
        MachineError: The machine parameters are invalid.
    """
    provenance = provenance_of(options)
    if options.recording is not None:
        _print(Recording(options.recording), provenance, as_json=options.json)
        return 0
    machine = machine_of(options)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.parquet"
        report = run_trial(
            seed=options.seed,
            trays=options.trays,
            io_map=load_io_map(options.io_map),
            parameters=machine,
            record=path,
        )
        _print(Recording(path), provenance, as_json=options.json)
    if report.reason:
        print(f"the trial did not complete: {report.reason}", file=sys.stderr)
    return 0 if report.completed else 1


def _print(recording: Recording, provenance: Provenance, *, as_json: bool) -> None:
    report = air_of(recording)
    if as_json:
        print_json(report.record(), provenance)
    else:
        print(report.text())
