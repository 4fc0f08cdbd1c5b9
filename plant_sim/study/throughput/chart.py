"""Gantt chart of a round: both arms, the tray feeder and the carousels, with the critical path highlighted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from controller.program.tags import SIDES
from plant_sim.common.figure_style import COLOURS, QUIET
from plant_sim.scope.style import seconds
from plant_sim.study.throughput.critical_path import Round, Segment
from plant_sim.study.throughput.timeline import ARM, CUPS, FEEDER, Timeline, motion_of

_WIDTH_IN, _HEIGHT_IN = 11.0, 3.4
_LEFT, _RIGHT, _BOTTOM, _TOP = 0.09, 0.985, 0.2, 0.88
_CHARACTER_IN = 0.055
"""Width of a character of the text in a bar, inches."""
_BAR = 0.3
"""Half the height of a bar, in lanes."""

LANES: Final = (ARM["left"], CUPS["left"], ARM["right"], CUPS["right"], FEEDER)
"""Lanes, from the top."""
_COLOUR: Final[Mapping[str, str]] = {
    **{ARM[side]: COLOURS[side] for side in SIDES},
    **{CUPS[side]: COLOURS[side] for side in SIDES},
    FEEDER: COLOURS["supply"],
}
_PATH: Final = "#F0E442"
"""Yellow of the Okabe-Ito palette, which no lane uses and on which text is legible."""


def gantt_chart(timeline: Timeline, round_: Round) -> Figure:
    """Draw the Gantt chart of a round.

    Bars represent steps (pale for waits), ticks represent cups, and the critical path is yellow.

    Args:
        timeline: Timeline of the run.
        round_: The round.

    Returns:
        Chart with time zero at the previous throw.
    """
    since_ms, until_ms = round_.since.at_ms, round_.throw.at_ms
    figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN))
    axes = figure.add_axes((_LEFT, _BOTTOM, _RIGHT - _LEFT, _TOP - _BOTTOM))
    axes.set_xlim(0.0, (until_ms - since_ms) / 1000)
    axes.set_ylim(len(LANES) - 0.45, -0.55)
    _highlight(axes, round_.path, since_ms)
    inch_s = axes.get_xlim()[1] / (_WIDTH_IN * (_RIGHT - _LEFT))
    for sequence in timeline.intervals:
        _draw_steps(axes, timeline, sequence, (since_ms, until_ms), inch_s)
    for side in SIDES:
        cups_s = [(at_ms - since_ms) / 1000 for at_ms in timeline.cups_ms[side] if since_ms <= at_ms <= until_ms]
        lane = LANES.index(CUPS[side])
        axes.vlines(cups_s, lane - _BAR, lane + _BAR, color=_COLOUR[CUPS[side]], linewidth=1.0)
    _frame(axes, round_)
    return figure


def _highlight(axes: Axes, path: Iterable[Segment], since_ms: int) -> None:
    """Highlight the critical path and draw its transitions between lanes."""
    before: Segment | None = None
    for segment in path:
        lane = LANES.index(segment.sequence)
        from_s, length_s = (segment.from_ms - since_ms) / 1000, segment.length_ms / 1000
        axes.broken_barh([(from_s, length_s)], (lane - 0.47, 0.94), facecolors=_PATH, linewidth=0, zorder=0)
        if before is not None and before.sequence != segment.sequence:
            axes.plot([from_s, from_s], [LANES.index(before.sequence), lane], color="black", linewidth=0.9, zorder=3)
        before = segment


def _draw_steps(axes: Axes, timeline: Timeline, sequence: str, window_ms: tuple[int, int], inch_s: float) -> None:
    """Draw the steps of a sequence, with names where they fit."""
    since_ms, until_ms = window_ms
    lane = LANES.index(sequence)
    for interval in timeline.intervals[sequence]:
        motion = motion_of(sequence, interval.step)
        from_s = (max(interval.from_ms, since_ms) - since_ms) / 1000
        to_s = (min(interval.to_ms, until_ms) - since_ms) / 1000
        if from_s >= to_s:
            continue
        alpha = 0.08 if motion.kind == "waits" else 0.5
        span, height = [(from_s, to_s - from_s)], (lane - _BAR, 2 * _BAR)
        # white background, so that the yellow of the path does not change the colour of the lane
        axes.broken_barh(span, height, facecolors="white", linewidth=0, zorder=0.5)
        axes.broken_barh(
            span,
            height,
            facecolors=_COLOUR[sequence],
            alpha=alpha,
            edgecolors=_COLOUR[sequence],
            linewidth=0.6,
            zorder=1,
        )
        if len(motion.name) * _CHARACTER_IN <= (to_s - from_s) / inch_s:
            axes.text((from_s + to_s) / 2, lane, motion.name, ha="center", va="center", fontsize=6, zorder=2)


def _frame(axes: Axes, round_: Round) -> None:
    axes.set_yticks(range(len(LANES)), LANES)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.xaxis.set_major_locator(seconds())
    axes.set_xlabel("time since the previous throw, s")
    axes.set_title(
        f"{round_.throw.side} arm, from row {round_.since.row} to row {round_.throw.row}: "
        f"{(round_.throw.at_ms - round_.since.at_ms) / 1000:.2f} s",
        loc="left",
        fontsize=9,
        fontweight="bold",
    )
    meanings = [
        Patch(facecolor=_PATH, label="critical path"),
        Patch(facecolor=QUIET, alpha=0.5, label="moves or dwells"),
        Patch(facecolor=QUIET, alpha=0.1, label="waits"),
    ]
    axes.legend(handles=meanings, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=7, borderpad=0.0)
