"""Windows of the release compared by full contact: rising and falling part of the loop, and late openers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from matplotlib.figure import Figure

from controller.common.document.parts import Cell, Heading, Part, Picture, Table
from plant_sim.common.figure_style import SERIES, draw_proportions, drawing
from plant_sim.common.proportion import Proportion
from plant_sim.planter.falls import FREQUENCY_PER_MIN, motion_at
from plant_sim.planter.parameters import Planter
from plant_sim.planter.ratio import zero_speed_points
from plant_sim.planter.verdict import FallVerdict
from plant_sim.study.planter.verdicts import FallPoint, VerdictCount

PITCHES_DEG: Final = (0.0, 3.0, 6.0)
"""Assumed largest pitch of a block; its pitch is uniform up to it, degrees."""
LOOP_RATIOS: Final = (1.1, 1.17, 1.3)
"""Ratios with a loop."""
LATE_RATIOS: Final = (0.85, 1.0, 1.17, 1.45)
"""Ratios of the late openers."""
LATE_DEG: Final = (120.0, 135.0, 150.0)
"""Late positions of the opener, degrees."""
LOOP_FACTOR: Final = 3
"""Falls at each point of a loop, as a multiple of those at the other points."""
GOOD: Final = 0.9
"""Smallest share of clean and upright falls inside a window."""

_PITCH = "scatter.pitch_deg"
_LOWEST_DEG = 90.0
_PARTS = (0.25, 0.5, 0.75)
_COLOUR_BY_PITCH: Final = dict(zip(PITCHES_DEG, SERIES, strict=False))


@dataclass(frozen=True)
class LoopComparison:
    """Clean falls on both parts of the loop.

    Attributes:
        ratio: Ratio lambda.
        pitch_deg: Assumed largest pitch, degrees.
        falling: Openers between the first point of zero speed and the lowest point.
        rising: Openers between the lowest point and the second point of zero speed.
    """

    ratio: float
    pitch_deg: float
    falling: Proportion
    rising: Proportion

    @property
    def better(self) -> str:
        """Part with more clean falls: ``rising``, ``falling``, or ``undecided`` if the intervals overlap."""
        if self.rising.interval[0] > self.falling.interval[1]:
            return "rising"
        return "falling" if self.falling.interval[0] > self.rising.interval[1] else "undecided"


@dataclass(frozen=True)
class LateOpeners:
    """Clean falls with late openers at one assumed pitch.

    Attributes:
        pitch_deg: Assumed largest pitch, degrees.
        points: Clean falls by ratio and position of the opener.
    """

    pitch_deg: float
    points: dict[tuple[float, float], Proportion]

    @property
    def worst(self) -> tuple[float, float]:
        """Ratio and position of the opener with the smallest share of clean falls."""
        return min(self.points, key=lambda at: self.points[at].share)


def window_points(planter: Planter, draws: int) -> list[FallPoint]:
    """Return the points to simulate on rigid ground, in the order that `windows_of` expects.

    Args:
        planter: Parameters of the planter.
        draws: Random falls at each point.
    """
    loops = [(ratio, deg, LOOP_FACTOR * draws) for ratio in LOOP_RATIOS for deg in _loop_deg(planter, ratio)]
    late = [(ratio, deg, draws) for ratio, deg in itertools.product(LATE_RATIOS, LATE_DEG)]
    return [
        FallPoint(ratio, opener_deg, number, ((_PITCH, pitch_deg),), frequency_per_min=FREQUENCY_PER_MIN)
        for pitch_deg in PITCHES_DEG
        for ratio, opener_deg, number in (*loops, *late)
    ]


def windows_of(counts: Sequence[VerdictCount]) -> tuple[list[LoopComparison], list[LateOpeners]]:
    """Return the comparisons of the loops and the late openers from the verdicts at the points."""
    loops, late = [], []
    remaining: Iterator[VerdictCount] = iter(counts)
    for pitch_deg in PITCHES_DEG:
        for ratio in LOOP_RATIOS:
            falling, rising = (_pooled(itertools.islice(remaining, len(_PARTS))) for _ in range(2))
            loops.append(LoopComparison(ratio, pitch_deg, falling, rising))
        points = itertools.islice(remaining, len(LATE_RATIOS) * len(LATE_DEG))
        late.append(
            LateOpeners(pitch_deg, {(each.point.ratio, each.point.opener_deg): _pooled([each]) for each in points})
        )
    return loops, late


def window_parts(loops: Sequence[LoopComparison], late: Sequence[LateOpeners]) -> list[Part]:
    """Return the comparison of the parts of the loop and of the late openers."""
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            f"{each.ratio:.2f}",
            each.pitch_deg,
            each.falling.percent,
            *each.falling.interval_percent,
            each.rising.percent,
            *each.rising.interval_percent,
            each.better,
        )
        for each in loops
    )
    late_rows: tuple[tuple[Cell, ...], ...] = tuple(
        (f"{ratio:.2f}", opener_deg, *(each.points[ratio, opener_deg].percent for each in late))
        for ratio, opener_deg in itertools.product(LATE_RATIOS, LATE_DEG)
    )
    return [
        Heading("Parts of the loop, by assumed pitch"),
        f"Full contact on rigid ground at {FREQUENCY_PER_MIN:g} plants per minute, {loops[0].rising.draws} random "
        "falls on each part: the opener at a quarter, half and three quarters of the way between a point of zero speed "
        "and the lowest point. The pitch of the block is uniform up to the assumed one. A part is better if the exact "
        "95 % intervals do not overlap.",
        Table(
            "loops",
            "Share of clean falls on the two parts of the loop, %",
            ("λ", "largest pitch, °", "falling", "from", "to", "rising", "from", "to", "better"),
            rows,
            digits=1,
        ),
        Picture(
            "loops",
            "Share of clean falls on rigid ground with exact 95 % intervals, side by side at each ratio: filled, "
            "rising part; open, falling part",
            _chart(loops),
        ),
        _loop_sentence(loops),
        Heading("Late openers, by assumed pitch"),
        Table(
            "late",
            "Share of clean falls with a late opener, %, by the assumed largest pitch",
            ("λ", "opener, °", *(f"{each.pitch_deg:g}°" for each in late)),
            late_rows,
            digits=1,
        ),
        *(_late_sentence(each) for each in late),
    ]


def window_record(loops: Sequence[LoopComparison], late: Sequence[LateOpeners]) -> dict[str, object]:
    """Return the figures of `window_parts` by name."""
    return {
        "loops": [
            {
                "ratio": each.ratio,
                "pitch_deg": each.pitch_deg,
                "falling": each.falling.share,
                "rising": each.rising.share,
                "better": each.better,
            }
            for each in loops
        ],
        "late": [
            {"ratio": ratio, "opener_deg": opener_deg, "pitch_deg": each.pitch_deg, "clean": count.share}
            for each in late
            for (ratio, opener_deg), count in each.points.items()
        ],
    }


def _loop_deg(planter: Planter, ratio: float) -> list[float]:
    """Return positions of the opener on the falling and on the rising part of a loop, degrees."""
    first, second = (point.phase_deg for point in zero_speed_points(motion_at(planter, ratio)))
    falling = [first + part * (_LOWEST_DEG - first) for part in _PARTS]
    return [*falling, *(_LOWEST_DEG + part * (second - _LOWEST_DEG) for part in _PARTS)]


def _pooled(counts: Iterator[VerdictCount] | Sequence[VerdictCount]) -> Proportion:
    every = [count.proportion(FallVerdict.CLEAN) for count in counts]
    return Proportion(*(sum(column) for column in zip(*every, strict=True)))


def _loop_sentence(loops: Sequence[LoopComparison]) -> str:
    """Return what the comparison says about the recommendation of the paper."""
    found = {each.better for each in loops} - {"undecided"}
    if len(found) > 1:
        verdict = "depends on λ and on the pitch"
    elif found:
        verdict = f"{'confirmed' if 'rising' in found else 'not confirmed'} where the parts differ"
    else:
        verdict = "undecided"
    parts = (
        f"{each.better} at λ {each.ratio:.2f} with {each.pitch_deg:g}°" for each in loops if each.better != "undecided"
    )
    return (
        f"The paper recommends the rising part of the loop. On rigid ground: {verdict}. Better part: "
        f"{'; '.join(parts) or 'none'}; otherwise undecided."
    )


def _late_sentence(late: LateOpeners) -> str:
    ratio, opener_deg = late.worst
    count = late.points[late.worst]
    limit = "at least" if count.share >= GOOD else "less than"
    return (
        f"With an opener at {LATE_DEG[0]:g}° or later and an assumed pitch of up to {late.pitch_deg:g}°, the smallest "
        f"share of clean falls at {FREQUENCY_PER_MIN:g} plants per minute is {count.text(decimals=0)}, at "
        f"λ {ratio:.2f} and {opener_deg:g}°: {limit} {100 * GOOD:g} %."
    )


def _chart(loops: Sequence[LoopComparison]) -> Figure:
    with drawing():
        figure = Figure(figsize=(7.0, 3.4), layout="constrained")
        axes = figure.add_subplot()
        for index, pitch_deg in enumerate(PITCHES_DEG):
            points = [each for each in loops if each.pitch_deg == pitch_deg]
            for part, shift, face in (("falling", -0.003, "white"), ("rising", 0.003, None)):
                counts: list[Proportion] = [getattr(each, part) for each in points]
                draw_proportions(
                    axes,
                    [each.ratio + shift + 0.015 * (index - 1) for each in points],
                    counts,
                    fmt="o",
                    color=_COLOUR_BY_PITCH[pitch_deg],
                    markerfacecolor=face,
                    capsize=2,
                    label=f"{part}, pitch up to {pitch_deg:g}°",
                )
        axes.set_ylim(0, 103)
        axes.set_xlabel("ratio λ of chain speed to machine speed")
        axes.set_ylabel("share of clean falls, %")
        axes.grid()
        figure.legend(fontsize=7, loc="outside right upper")
    return figure
