"""Options of the command ``study``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from controller.common.arguments.number_type import integer, number
from plant_sim.cli.options.shared import add_picture_arguments
from plant_sim.cli.study.experiment_options import add_experiment_arguments
from plant_sim.common.capacity import MOST_SEEDLINGS

STUDIES: Final[Mapping[str, str]] = {
    "pepper-single": "single-factor tests of the pepper paper",
    "pepper-rsm": "the pepper paper's response surface and optimum",
    "cabbage-rsm": "the cabbage paper's regression, from its published tables",
    "calibration": "calibration of the seedling constants",
    "throughput": "limits of the planting rate of the machine",
    "planter-verdicts": "verdicts of the simulated falls of the planter",
    "planter-release": "place of the release of the planter",
    "planter-lodging": "lodging and injury on the cabbage paper's bench",
    "line-slip": "spacing of the plants over the slip of the ground wheel",
    "own": "a custom study",
    "analyse": "a table of trials of your own (CSV), which never saw the twin",
    "plan": "trials that a difference needs, or the runs of a design and the power of its tests",
    "campaign": "runs over factors, faults and seeds, stored in --out and resumed there",
}
"""One-line description of each study, by its name."""
TIMEOUT_S: Final = 600.0
"""Default of the longest wait for a Dask cluster, s."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``study``."""
    names = "; ".join(f"{name}: {about}" for name, about in STUDIES.items())
    parser.add_argument("name", choices=tuple(STUDIES), metavar="NAME", help=names)
    parser.add_argument(
        "file",
        nargs="?",
        type=Path,
        metavar="FILE",
        help="with own and campaign: the YAML file of the study; with analyse: the CSV table",
    )
    parser.add_argument(
        "--data",
        metavar="SET",
        help="published data set to use instead of the twin: paper (pepper-rsm), printed or reconciled (cabbage-rsm)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="new folder for report, tables and pictures; with campaign: folder of the results, which may exist",
    )
    parser.add_argument(
        "--trials",
        type=integer(1),
        metavar="N",
        help="trials per design point; random blocks per point with planter-...",
    )
    parser.add_argument("--seed", type=integer(0), metavar="N", help="seed of all random numbers")
    parser.add_argument(
        "--seedlings",
        type=integer(1, MOST_SEEDLINGS),
        metavar="N",
        help="seedlings per trial (default: 144; planter-lodging: 120)",
    )
    parser.add_argument("--spacing", metavar="LENGTH", help="with throughput: plant spacing in a row, e.g. 35cm")
    parser.add_argument(
        "--frequencies",
        metavar="LIST",
        help="with throughput: planting frequencies, plants per minute per row, e.g. 20..90/10 or 20,30,45",
    )
    parser.add_argument("--workers", type=integer(1), metavar="N", help="parallel processes (default: one per core)")
    add_experiment_arguments(parser)
    add_picture_arguments(parser)
    _add_campaign(parser)
    parser.add_argument("--machine", type=Path, metavar="FILE", help="parameters of the machine")
    parser.add_argument("--io-map", type=Path, metavar="FILE", help="I/O map of the machine")


def _add_campaign(parser: argparse.ArgumentParser) -> None:
    """Add the options that only a campaign has."""
    parser.add_argument(
        "--engine",
        choices=("processes", "dask"),
        help="with campaign: processes of this computer (default), or the workers of a Dask cluster",
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="with --engine dask: address of the scheduler, e.g. tcp://127.0.0.1:8786"
    )
    parser.add_argument(
        "--timeout",
        type=number(1, 86_400),
        metavar="SECONDS",
        help=f"with --engine dask: longest wait for workers or for the next result (default: {TIMEOUT_S:g})",
    )
    parser.add_argument(
        "--shard",
        type=integer(1),
        metavar="N",
        help="with campaign: maximum number of runs per Parquet file (default: 200)",
    )
