"""Gantt chart of a round: both arms, the tray feeder and the carousels, with the critical path lit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from controller.program.tags import SIDES
from plant_sim.bench.study.critical_path import Round, Segment
from plant_sim.bench.study.timeline import ARM, CUPS, FEEDER, Timeline, motion_of
from plant_sim.scope.style import COLOURS, QUIET, seconds

_WIDTH_IN, _HEIGHT_IN = 11.0, 3.4
_LEFT, _RIGHT, _BOTTOM, _TOP = 0.09, 0.985, 0.2, 0.88
_CHARACTER_IN = 0.055  # of the small text in a bar
_BAR = 0.3  # half the height of a bar, in lanes

LANES: Final = (ARM["left"], CUPS["left"], ARM["right"], CUPS["right"], FEEDER)
"""Lanes from the top."""
_COLOUR: Final[Mapping[str, str]] = {
    **{ARM[side]: COLOURS[side] for side in SIDES},
    **{CUPS[side]: COLOURS[side] for side in SIDES},
    FEEDER: COLOURS["supply"],
}
_PATH: Final = "#F0E442"
"""Okabe and Ito's yellow: no lane has it, and whatever is written on it stays legible."""


def gantt_chart(timeline: Timeline, round_: Round) -> Figure:
    """Draw a round.

    Bars are steps, pale where a sequence waits; ticks are cups; what is yellow is the critical path.

    Args:
        timeline: The run it is part of.
        round_: The round.

    Returns:
        The chart; its time begins with the throw before.
    """
    since_ms, until_ms = round_.since.at_ms, round_.throw.at_ms
    figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN))
    axes = figure.add_axes((_LEFT, _BOTTOM, _RIGHT - _LEFT, _TOP - _BOTTOM))
    axes.set_xlim(0.0, (until_ms - since_ms) / 1000)
    axes.set_ylim(len(LANES) - 0.45, -0.55)
    _light(axes, round_.path, since_ms)
    inch_s = axes.get_xlim()[1] / (_WIDTH_IN * (_RIGHT - _LEFT))
    for who in timeline.stretches:
        _draw_steps(axes, timeline, who, (since_ms, until_ms), inch_s)
    for side in SIDES:
        cups_s = [(at_ms - since_ms) / 1000 for at_ms in timeline.cups_ms[side] if since_ms <= at_ms <= until_ms]
        lane = LANES.index(CUPS[side])
        axes.vlines(cups_s, lane - _BAR, lane + _BAR, color=_COLOUR[CUPS[side]], linewidth=1.0)
    _frame(axes, round_)
    return figure


def _light(axes: Axes, path: Iterable[Segment], since_ms: int) -> None:
    """Light the critical path, and draw where it changes from one lane to another."""
    before: Segment | None = None
    for segment in path:
        lane = LANES.index(segment.who)
        from_s, length_s = (segment.from_ms - since_ms) / 1000, segment.length_ms / 1000
        axes.broken_barh([(from_s, length_s)], (lane - 0.47, 0.94), facecolors=_PATH, linewidth=0, zorder=0)
        if before is not None and before.who != segment.who:
            axes.plot([from_s, from_s], [LANES.index(before.who), lane], color="black", linewidth=0.9, zorder=3)
        before = segment


def _draw_steps(axes: Axes, timeline: Timeline, who: str, window_ms: tuple[int, int], inch_s: float) -> None:
    """Draw the steps of a sequence, named where there is room."""
    since_ms, until_ms = window_ms
    lane = LANES.index(who)
    for stretch in timeline.stretches[who]:
        motion = motion_of(who, stretch.step)
        from_s = (max(stretch.from_ms, since_ms) - since_ms) / 1000
        to_s = (min(stretch.to_ms, until_ms) - since_ms) / 1000
        if from_s >= to_s:
            continue
        alpha = 0.08 if motion.kind == "waits" else 0.5
        span, height = [(from_s, to_s - from_s)], (lane - _BAR, 2 * _BAR)
        # white beneath, or the path's yellow would change the colour of the lane
        axes.broken_barh(span, height, facecolors="white", linewidth=0, zorder=0.5)
        axes.broken_barh(span, height, facecolors=_COLOUR[who], alpha=alpha, edgecolors=_COLOUR[who], linewidth=0.6,
                         zorder=1)  # fmt: skip
        if len(motion.name) * _CHARACTER_IN <= (to_s - from_s) / inch_s:
            axes.text((from_s + to_s) / 2, lane, motion.name, ha="center", va="center", fontsize=6, zorder=2)


def _frame(axes: Axes, round_: Round) -> None:
    axes.set_yticks(range(len(LANES)), LANES)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.xaxis.set_major_locator(seconds())
    axes.set_xlabel("time since the throw before, s")
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
