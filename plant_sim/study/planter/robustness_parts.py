"""Parts of the report of ``planter-verdicts`` on all ranges: robustness over the assumed pitch, and what decides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from matplotlib.figure import Figure

from controller.common.document.parts import Cell, Heading, Part, Picture, Table
from plant_sim.common.figure_style import QUIET, SERIES, draw_proportions, drawing
from plant_sim.study.planter.verdict_robustness import (
    LEAST_BOUND,
    LEAST_SHARE,
    PITCHES_DEG,
    Robustness,
    robust_up_to_deg,
)
from plant_sim.study.planter.verdict_sensitivity import MATTERS, SampleSize, Sensitivity
from plant_sim.study.planter.verdict_space import VerdictSpace
from plant_sim.study.planter.verdicts import CASES, SimulatedCase

_MARKERS: Final = "os^"
_LISTED: Final = 3
"""Number of parameters that a sentence names."""


def robustness_parts(
    space: VerdictSpace, shares: Sequence[Robustness], influences: Sequence[Sensitivity], size: SampleSize
) -> list[Part]:
    """Return the verdicts over all ranges.

    Args:
        space: Space of the falls.
        shares: Shares of the draws by case and pitch.
        influences: Sensitivity of each case.
        size: Size of the samples of the sensitivities.
    """
    rows: list[tuple[Cell, ...]] = [
        (
            f"{each.case.printed:g}",
            each.case.verdict.value,
            each.pitch_deg,
            each.agreeing.percent,
            *each.agreeing.interval_percent,
            "yes" if each.is_robust else "no",
        )
        for each in shares
    ]
    draws = shares[0].agreeing.draws
    return [
        "What was fitted to what: nothing in this study. The constants are assumed, and their defaults were set with "
        "the three verdicts of the paper known: agreement at the defaults is in-sample. The question is therefore how "
        "far the verdicts depend on the assumptions.",
        Heading("Verdicts over all ranges"),
        f"{draws} draws for each case and each assumed pitch, on rigid ground. Each draw has its own values "
        f"of all {len(space.parameters)} parameters of chain, planter, block, grip and ground that the paper does not "
        "print, uniform over the ranges of planter.yaml, its own largest deviations of opener, place, roll, plates and "
        "slope, and its own deviations up to these. The pitch of the block is uniform up to the assumed one, in both "
        f"directions. A verdict is robust if at least {100 * LEAST_SHARE:g} % of the draws have it and the exact 95 % "
        f"interval of this share begins at {100 * LEAST_BOUND:g} % or more. A share of draws describes the "
        "assumptions, not a field.",
        Table(
            "robustness",
            "Share of the draws with the verdict of the paper",
            ("λ", "verdict of the paper", "largest pitch, °", "share, %", "from", "to", "robust"),
            tuple(rows),
            digits=1,
        ),
        Picture(
            "robustness",
            "Share of the draws over all ranges that have the verdict of the paper, over the assumed largest pitch, "
            f"with exact 95 % intervals; dashed: {100 * LEAST_SHARE:g} %",
            _chart(shares),
        ),
        *(_sentence(case, _of(shares, case), each) for case, each in zip(CASES, influences, strict=True)),
        Heading("What the verdicts depend on"),
        "The signed distance of a fall from the limits of its verdict, as a share of the limits, from -1 to 1: first "
        f"the mean absolute effect of each parameter over its whole range ({size.trajectories} trajectories of "
        f"Morris), then the Sobol indices of the parameters with the largest effects (two samples of {size.base} "
        "points), with bootstrap 95 % intervals. The other parameters have their default values. A verdict depends on "
        f"a parameter if the interval of its total index begins at {MATTERS:g} or more. All deviations are varied up "
        "to the largest plausible ones.",
        *(_influence_table(each) for each in influences),
    ]


def robustness_record(shares: Sequence[Robustness], influences: Sequence[Sensitivity]) -> dict[str, object]:
    """Return the figures of `robustness_parts` by name."""
    return {
        "robustness": [
            {
                "ratio": each.case.printed,
                "pitch_deg": each.pitch_deg,
                "draws": each.agreeing.draws,
                "hits": each.agreeing.hits,
                "interval": each.agreeing.interval,
                "robust": each.is_robust,
            }
            for each in shares
        ],
        "sensitivity": [
            {
                "ratio": each.case.printed,
                "effects": each.effects,
                "indices": {one.name: {"first": one.first, "total": one.total} for one in each.influences},
                "depends_on": each.depends_on,
            }
            for each in influences
        ],
    }


def _of(shares: Sequence[Robustness], case: SimulatedCase) -> list[Robustness]:
    return [each for each in shares if each.case is case]


def _sentence(case: SimulatedCase, shares: Sequence[Robustness], sensitivity: Sensitivity) -> str:
    """Return the conclusion on one case."""
    limit_deg, last_deg = robust_up_to_deg(shares), PITCHES_DEG[-1]
    verdict = f"The verdict {case.verdict.value} at λ {case.printed:g}"
    if limit_deg == last_deg:
        return f"{verdict} is robust for every assumed pitch up to {last_deg:g}°."
    names = sensitivity.depends_on[:_LISTED]
    depends = f"It depends on {', '.join(names)}." if names else "No single parameter decides."
    range_text = (
        f"{shares[0].agreeing.percent:.0f} % of the draws without pitch and {shares[-1].agreeing.percent:.0f} % with "
    )
    shown = f"{range_text}up to {last_deg:g}° have it"
    robust = "is not robust" if limit_deg is None else f"is robust only up to an assumed pitch of {limit_deg:g}°"
    return f"{verdict} {robust}: {shown}. {depends}"


def _influence_table(sensitivity: Sensitivity) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (each.name, each.effect, *each.first, *each.total, "yes" if each.matters else "no")
        for each in sensitivity.influences
    ]
    case = sensitivity.case
    heading = ("parameter", "effect", "first", "from", "to", "total", "from", "to", "depends")
    name = f"influence-{round(100 * case.printed)}"
    return Table(name, f"Effect and Sobol indices at λ {case.printed:g}: {case.verdict.value}", heading, tuple(rows))


def _chart(shares: Sequence[Robustness]) -> Figure:
    with drawing():
        figure = Figure(figsize=(7.0, 3.6), layout="constrained")
        axes = figure.add_subplot()
        for index, (case, colour, marker) in enumerate(zip(CASES, SERIES, _MARKERS, strict=False)):
            points = _of(shares, case)
            draw_proportions(
                axes,
                [each.pitch_deg + 0.06 * (index - 1) for each in points],
                [each.agreeing for each in points],
                fmt=f"{marker}-",
                color=colour,
                markersize=4,
                capsize=2,
                label=f"λ {case.printed:g}: {case.verdict.value}",
            )
        axes.axhline(100 * LEAST_SHARE, color=QUIET, linewidth=0.8, linestyle="--")
        axes.set_ylim(0, 103)
        axes.set_xlabel("assumed largest pitch of a block in the plates, °")
        axes.set_ylabel("share of the draws with the verdict, %")
        axes.grid()
        figure.legend(fontsize=7, loc="outside upper center", ncols=3)
    return figure
