"""Options of the command ``planter``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from controller.common.arguments.number_type import integer, number
from plant_sim.common.defaults import DEFAULT_PLANTER
from plant_sim.common.picture_form import DPI, LEAST_DPI, MOST_DPI
from plant_sim.planter.motion_model import MotionModel

SPEED_KM_H: Final = 1.4
FREQUENCY_PER_MIN: Final = 56.0
"""Default planting frequency, with `SPEED_KM_H` the third simulated case of the cabbage paper, 2.2.2."""
FIGURE_SPEEDS_KM_H: Final[Mapping[int, float]] = {7: 1.9, 8: 1.65, 9: 1.4}
"""Machine speed of each figure that shows a simulated case, at `FREQUENCY_PER_MIN`. Source: cabbage paper, 2.2.2."""
SCHEME: Final = 3
REGIMES: Final = 4
"""Figures of the paper that show no simulated case."""
_LEAST = 0.001
_FASTEST_KM_H = 36.0
_MOST_PER_MIN = 1000.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``planter``."""
    parser.add_argument("--planter", type=Path, default=DEFAULT_PLANTER, metavar="FILE", help="parameters")
    parser.add_argument(
        "--speed",
        type=number(_LEAST, _FASTEST_KM_H),
        metavar="KM_H",
        help=f"speed of the machine, km/h (default: {SPEED_KM_H:g})",
    )
    parser.add_argument(
        "--frequency",
        type=number(_LEAST, _MOST_PER_MIN),
        metavar="PER_MIN",
        help=f"plants per minute (default: {FREQUENCY_PER_MIN:g})",
    )
    parser.add_argument(
        "--release",
        type=number(0, 180),
        metavar="DEG",
        help="phase of the release on the bottom arc, degrees, 90 at its lowest point (default: that of the file)",
    )
    parser.add_argument(
        "--model",
        choices=[model.value for model in MotionModel],
        default=MotionModel.RIGID.value,
        help="equations as printed, equations with corrections, or a planter that only translates",
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw to FILE.png, FILE.svg, FILE.pdf or FILE.gif")
    parser.add_argument(
        "--dpi",
        type=integer(LEAST_DPI, MOST_DPI),
        metavar="N",
        help=f"with --plot FILE.png: resolution, dots per inch (default: {DPI})",
    )
    parser.add_argument(
        "--figure",
        type=int,
        choices=(SCHEME, REGIMES, *FIGURE_SPEEDS_KM_H),
        metavar="N",
        help="figure of the paper to draw: 3 scheme, 4 three paths, 7 to 9 falls at the paper's speeds "
        "(default: motion at --speed)",
    )
    parser.add_argument(
        "--falls",
        type=Path,
        metavar="DIR",
        help="only simulate the tables of falls for these parameters, which takes minutes, and write them to DIR",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
