"""Shapes and labels shared by the figures of the planter."""

from __future__ import annotations

from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from plant_sim.common.figure_style import COLOURS, QUIET, SERIES
from plant_sim.planter.chain import ChainSpec, Offset

POINTS: Final = {"hinge": COLOURS["machine"], "tip": COLOURS["left"], "guide plate": COLOURS["right"]}
"""Colour of each point of a planter."""
MARK: Final[dict[str, Any]] = {
    "linestyle": "none",
    "color": COLOURS["alarms"],
    "markeredgecolor": "white",
    "markersize": 6,
    "zorder": 5,
}
SOIL: Final = SERIES[3]

_OPENING_M = 0.045
"""Opening of the plates, m. Source: cabbage paper, 2.2.1."""
_PLATE_M = 0.09
"""Height of the plates, m, assumed."""


def offsets_of(chain: ChainSpec) -> dict[str, Offset]:
    """Return the offset of each point in `POINTS`."""
    return {"hinge": (0.0, 0.0), "tip": chain.tip, "guide plate": chain.guide}


def planter_lines(axes: Axes, *, alpha: float = 1.0) -> list[Line2D]:
    """Add empty lines for hanger, plates and guide plate to the axes and return them; see `place_planter`."""
    colours = (COLOURS["machine"], POINTS["tip"], POINTS["guide plate"])
    lines = [Line2D([], [], color=colour, linewidth=1.0, alpha=alpha, zorder=3) for colour in colours]
    for line in lines:
        axes.add_line(line)
    return lines


def place_planter(lines: list[Line2D], chain: ChainSpec, hinge_m: Offset, tip_m: Offset) -> None:
    """Move the lines of a planter to a position.

    Args:
        lines: Lines from `planter_lines`.
        chain: Parameters of the planter.
        hinge_m: Position of the hinge, m.
        tip_m: Position of the tip, m; the plates and the guide plate are drawn relative to it.
    """
    x_m, y_m = tip_m
    top_m = y_m + _PLATE_M
    guide_x_m, guide_y_m = x_m - chain.guide_behind_m, y_m + chain.guide_above_m
    half_m = _OPENING_M / 2
    hanger, plates, guide = lines
    hanger.set_data([hinge_m[0], x_m, x_m], [hinge_m[1], hinge_m[1], top_m])
    plates.set_data([x_m - half_m, x_m + half_m, x_m, x_m - half_m], [top_m, top_m, y_m, top_m])
    guide.set_data([guide_x_m, guide_x_m], [guide_y_m, guide_y_m + _PLATE_M])


def draw_soil(axes: Axes, chain: ChainSpec) -> None:
    """Draw the soil surface."""
    axes.axhline(-chain.axle_height_m, color=SOIL, linewidth=1.4, label="soil surface", zorder=1)


def note_origin(figure: Figure) -> None:
    """Add the source of the geometry below a figure."""
    figure.supxlabel(
        "own drawing; l, h, guide plate and soil level are assumed (plant_sim/planter.yaml)",
        x=0.99,
        ha="right",
        fontsize=6.5,
        color=QUIET,
    )
