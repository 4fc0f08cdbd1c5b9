"""Options of ``study analyse`` and ``study plan``."""

from __future__ import annotations

import argparse
from typing import Final

from controller.common.arguments.number_type import integer, number

ANALYSE: Final = (
    *(
        "response",
        "counts",
        "total",
        "factors",
        "categorical",
        "blocks",
        "whole_plots",
        "hard",
        "best",
        "model",
        "link",
    ),
)
"""Options of ``analyse``, as attributes."""
PLAN: Final = (
    *("difference", "power", "correlation", "design", "factors", "blocks", "centres", "axial", "sd", "effect"),
    *("model", "trials", "seed", "seedlings"),
)
"""Options of ``plan``, as attributes."""
MODELS: Final = ("linear", "interactions", "squares", "quadratic")
"""Polynomials; squares has no products."""


def add_experiment_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of experiments with real seedlings: their table, and their plan."""
    parser.add_argument("--response", metavar="COLUMN", help="with analyse: column of a measured value")
    parser.add_argument("--counts", metavar="COLUMN", help="with analyse: column of counted (lost) seedlings")
    parser.add_argument(
        "--total", metavar="COLUMN|N", help="with analyse and --counts: column of all seedlings, or their number"
    )
    parser.add_argument(
        "--factors",
        metavar="LIST",
        help="with analyse: columns, separated by commas; with plan: ranges, e.g. 'foam (mm)=8..16, age (d)=45..55'",
    )
    parser.add_argument(
        "--categorical",
        metavar="LIST",
        help="with analyse: factors whose levels are names, if these are numbers, such as types 1, 2, 3",
    )
    parser.add_argument(
        "--blocks",
        metavar="LIST|N",
        help="with analyse: columns of blocks, such as date, or none; with plan: number of blocks",
    )
    parser.add_argument(
        "--whole-plots",
        metavar="COLUMN",
        help="with analyse: column that numbers the whole plots, within which factors hard to change stay the same",
    )
    parser.add_argument(
        "--hard", metavar="LIST", help="with analyse: factors hard to change, if no column numbers their whole plots"
    )
    parser.add_argument(
        "--best", choices=("high", "low"), help="with analyse: good response (default: low for counts, else high)"
    )
    parser.add_argument(
        "--model", choices=MODELS, help="with analyse and plan: polynomial (default: the richest, with plan quadratic)"
    )
    parser.add_argument(
        "--link", choices=("identity", "logit"), help="with analyse and --counts: link function (default: logit)"
    )
    parser.add_argument("--difference", metavar="P,Q", help="with plan: two shares to tell apart, %%, e.g. 93,95")
    parser.add_argument(
        "--power", type=number(0.1, 0.999), metavar="SHARE", help="with plan: power of the comparison (default: 0.8)"
    )
    parser.add_argument(
        "--correlation",
        type=number(0, 1),
        metavar="RHO",
        help="with plan: correlation between the seedlings of a trial (default: 0, 0.01 and 0.03)",
    )
    parser.add_argument(
        "--design",
        metavar="DESIGN",
        help="with plan: factorial, fraction-RUNS, composite, box-behnken, latin-RUNS, or an array such as L9",
    )
    parser.add_argument(
        "--centres", type=integer(0, 1000), metavar="N", help="with plan: centre trials of all blocks (default: 6)"
    )
    parser.add_argument(
        "--axial", type=number(0.1, 10), metavar="LEVEL", help="with plan: axial level (default: rotatable)"
    )
    parser.add_argument(
        "--sd", type=number(0.0001, 1_000_000), metavar="VALUE", help="with plan: standard deviation of one trial"
    )
    parser.add_argument(
        "--effect",
        type=number(0.0001, 1_000_000),
        metavar="VALUE",
        help="with plan: change of the response from level -1 to 1 to detect (default: the difference)",
    )
