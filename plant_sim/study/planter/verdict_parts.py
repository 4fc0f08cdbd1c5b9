"""Parts of the report of ``planter-verdicts`` on the default parameters: the paper's cases, the sweep, and limits."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from controller.common.document.parts import Cell, Heading, Part, Picture, Table
from plant_sim.common.figure_style import COLOURS, QUIET, SERIES, draw_proportions, drawing
from plant_sim.planter.contact import drop
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter
from plant_sim.planter.verdict import PUSHED_M, FallVerdict
from plant_sim.study.doe.design import to_natural
from plant_sim.study.paper_tables import CABBAGE_FACTORS, cabbage_experiment
from plant_sim.study.planter.verdicts import CASES, VerdictCount, crossings

_KM_H: Final = 3.6


@dataclass(frozen=True)
class VerdictSweep:
    """Verdicts on simulated falls with the default parameters.

    Attributes:
        planter: Parameters of the planter.
        cases: Verdicts at the paper's cases.
        sweep: Verdicts over the ratio.
    """

    planter: Planter
    cases: Sequence[VerdictCount]
    sweep: Sequence[VerdictCount]

    def switches(self) -> Mapping[str, list[float]]:
        """Return the ratios at which tipping ends and at which clean falls begin."""
        points = sorted((*self.cases, *self.sweep), key=lambda each: each.point.ratio)
        ratios = [each.point.ratio for each in points]
        return {
            "tipped to pushed": crossings(
                ratios, np.array([each.proportion(FallVerdict.FORWARD).share for each in points])
            ),
            "pushed to clean": crossings(
                ratios, np.array([each.proportion(FallVerdict.CLEAN).share for each in points])
            ),
        }


def sweep_parts(result: VerdictSweep) -> list[Part]:
    """Return the shares of the verdicts at the paper's cases and over the ratio."""
    planter, scatter = result.planter, result.planter.scatter
    cases: list[tuple[Cell, ...]] = []
    for case, count in zip(CASES, result.cases, strict=True):
        found = count.proportion(case.verdict)
        fall = drop(planter, planter.rigid_ground, case.motion(planter), opener_deg=planter.chain.release_deg)
        head: tuple[Cell, ...] = (case.speed_km_h, f"{count.point.ratio:.4f}", case.verdict.value)
        cases.append((*head, found.percent, *found.interval_percent, fall.landed_deg))
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (f"{count.point.ratio:.2f}", *(count.proportion(verdict).percent for verdict in FallVerdict))
        for count in result.sweep
    )
    texts = [
        f"{name} at λ = {', '.join(f'{at:.3f}' for at in found) or '-'}" for name, found in result.switches().items()
    ]
    return [
        Heading("Default parameters"),
        f"{result.cases[0].point.draws} random blocks in each case of the paper, {result.sweep[0].point.draws} at each "
        f"other ratio, released at {planter.chain.release_deg:g}°, with the default machine. Masses, coefficients, "
        f"place and release vary from block to block, and so do the pitch, up to {scatter.pitch_deg:g}°, the slope of "
        f"the furrow, up to {scatter.slope_deg:g}°, and the delay of the second plate, up to "
        f"{1000 * scatter.uneven_s:g} ms. First contact: phase at which the default block touches the ground. In free "
        "flight, the motion relative to the planter does not depend on the speed of the machine, so that only the "
        "contact with the ground distinguishes the cases.",
        Table(
            "cases",
            "Share of the falls with the verdict of the paper",
            ("km/h", "λ", "verdict of the paper", "share, %", "from", "to", "first contact, °"),
            tuple(cases),
        ),
        f"The share crosses 50 %, by linear interpolation, from {'; from '.join(texts)}.",
        Table(
            "sweep", "Shares of the verdicts over λ, %", ("λ", *(each.value for each in FallVerdict)), rows, digits=1
        ),
        Picture(
            "verdicts",
            "Shares of the verdicts over λ with exact 95 % intervals; dashed: switches; triangles: the paper's cases",
            _chart(result),
        ),
    ]


def limit_parts(planter: Planter) -> list[Part]:
    """Return the limits of the study and the contradiction between the simulation and the bench of the paper."""
    experiment = cabbage_experiment("reconciled")
    settings = to_natural(CABBAGE_FACTORS, experiment.coded)
    ratios = np.array(
        [Motion(planter.chain, speed_m_s=v / _KM_H, frequency_per_min=f).ratio for v, f, _ in settings.tolist()]
    )
    lodging = experiment.responses["Y1"]
    slow, fast = int(ratios.argmin()), int(ratios.argmax())
    near = np.abs(ratios - CASES[0].printed) < 0.03
    return [
        Heading("Limits"),
        f"A block is pushed if it moves more than {1000 * PUSHED_M:g} mm on the ground; the limits of the verdicts "
        "are assumptions, since the paper states none. The guide plate is assumed to be a fork "
        f"{1000 * (planter.chain.guide_behind_m - planter.block.edge_m / 2):.0f} mm behind the block. The roll of a "
        "block is simulated across the row, apart from the guide plate; a push on a block that stands on one edge is "
        "not simulated.",
        "The paper contradicts itself: its simulation always tips at 0.87, but on the bench, with ratios of "
        f"{ratios.min():.2f} to {ratios.max():.2f}, lodging is {lodging.min():g} to {lodging.max():g} % (Table 2, "
        f"reconciled): {lodging[slow]:g} % at the smallest ratio, {lodging[near].min():g} to {lodging[near].max():g} % "
        f"within 0.03 of 0.87, and {lodging[fast]:g} % at the largest. No setting of the bench tips always. The study "
        "planter-lodging treats the bench, with soil below the tip and around the block.",
    ]


def _chart(result: VerdictSweep) -> Figure:
    points = sorted((*result.cases, *result.sweep), key=lambda each: each.point.ratio)
    ratios = [each.point.ratio for each in points]
    with drawing():
        figure = Figure(figsize=(7.0, 3.8), layout="constrained")
        axes = figure.add_subplot()
        for verdict, colour in zip(FallVerdict, SERIES, strict=False):
            draw_proportions(
                axes,
                ratios,
                [each.proportion(verdict) for each in points],
                fmt="o-",
                color=colour,
                markersize=3,
                capsize=1.5,
                label=verdict.value,
            )
        for at in itertools.chain.from_iterable(result.switches().values()):
            axes.axvline(at, color=QUIET, linewidth=0.8, linestyle="--")
            axes.annotate(f"{at:.3f}", (at, 52), fontsize=7, color=QUIET, xytext=(3, 0), textcoords="offset points")
        at_cases = [count.point.ratio for count in result.cases]
        axes.plot(at_cases, [-6] * len(at_cases), "^", color=COLOURS["right"], clip_on=False, markersize=5)
        axes.set_ylim(-6, 104)
        axes.set_xlabel("ratio λ of chain speed to machine speed")
        axes.set_ylabel("share of the falls, %")
        figure.legend(fontsize=7, loc="outside upper center", ncols=3)
        axes.grid()
    return figure
