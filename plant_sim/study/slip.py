"""Study ``line-slip``: plant spacing over the slip of the ground wheel, with a ground wheel and with a motor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from controller.common.document.parts import Heading, Picture, Table
from plant_sim.common.figure_style import COLOURS, drawing
from plant_sim.line.file import DriveEntry, LineFile, SlipEntry, find_line, load_line
from plant_sim.line.indices import planting_rates, spacing_indices
from plant_sim.line.planting import ChainPlanter
from plant_sim.line.run import run_line
from plant_sim.machine.parameters import Machine
from plant_sim.planter.falls import default_table
from plant_sim.planter.scatter import Ground
from plant_sim.study.report.study import Study

LINE: Final = "cabbage"
MEANS: Final = (0.0, 0.05, 0.10, 0.15)
"""Mean slips, as fractions; the gear of the line is set for 5 %."""
SDS: Final = (0.0, 0.01, 0.02, 0.03, 0.05)
"""Standard deviations of the slip between patches of soil, as fractions."""
METRES: Final = 1_000.0
LAG_S: Final = 0.5
"""Lag of the motor, s, assumed."""


@dataclass(frozen=True, slots=True)
class SlipPoint:
    """Results of a row planted at one slip.

    Attributes:
        drive: ``ground wheel`` or ``motor``.
        mean: Mean slip.
        sd: Standard deviation of the slip between patches.
        spacing_m: Mean spacing in the quality of feed, m.
        precision: Standard deviation of the spacings in the quality of feed, divided by the set spacing.
        expected: `precision` from the closed form.
        ratio_low: 5th percentile of lambda at the release.
        ratio_high: 95th percentile of lambda at the release.
        lodged_percent: Lodged plants, percent.
        scraped_percent: Plants touched by the guide plate on the ground, percent.
    """

    drive: str
    mean: float
    sd: float
    spacing_m: float
    precision: float
    expected: float
    ratio_low: float
    ratio_high: float
    lodged_percent: float
    scraped_percent: float


def slip_study(machine: Machine, *, seed: int, metres: float = METRES) -> Study:
    """Return the study ``line-slip``.

    Args:
        machine: Parameters of the machine; they have no effect, because the cabbage line has no arms.
        seed: Seed of all random numbers.
        metres: Length of each row, m.
    """
    line = load_line(find_line(LINE)).values
    points = [slip_point(line, machine, mean=mean, sd=sd, seed=seed, metres=metres) for mean in MEANS for sd in SDS]
    motor = line.model_copy(update={"drive": DriveEntry.model_validate({"kind": "own_motor", "lag": f"{LAG_S} s"})})
    points += [slip_point(motor, machine, mean=0.05, sd=sd, seed=seed, metres=metres) for sd in (SDS[0], SDS[-1])]
    return Study(
        name="line-slip",
        title="Spacing of the plants over the slip of the ground wheel",
        command=f"python -m plant_sim study line-slip --seed {seed}",
        parts=(
            f"Cabbage line, rows of {metres:g} m at {_speed_km_h(line):g} km/h, set spacing {100 * line.spacing:g} cm, "
            f"seed {seed}. Slip is constant within patches of {_slip(line).patch:g} m; its values are assumed.",
            "What was fitted to what: the mean clearance of the block and the share of blocks that stick are fitted "
            "to part of Table 2 of the cabbage paper (study planter-lodging); spacing and slip are not fitted.",
            Heading("Rows"),
            _table(points, line),
            _picture(points),
            "With a ground wheel, the spacing increases with the mean slip as 1/(1 - slip) and λ decreases: "
            "both depend on the chain speed. Scatter of the slip becomes scatter of the spacing. A motor that "
            "follows the true ground speed is independent of slip, and only the scatter of the falls remains.",
            "The closed form adds the variances of slip and falls. A spacing s in patches of length L averages over "
            "neighbouring patches, which leaves the fraction 1 - s/(3L) of the variance of the slip.",
        ),
        record={"metres": metres, "seed": seed, "points": [_record(point) for point in points]},
    )


def slip_point(line: LineFile, machine: Machine, *, mean: float, sd: float, seed: int, metres: float) -> SlipPoint:
    """Plant one row and return its results.

    Args:
        line: Line with a chain planter.
        machine: Parameters of the machine.
        mean: Mean slip.
        sd: Standard deviation of the slip between patches.
        seed: Seed of all random numbers.
        metres: Length of the row, m.
    """
    slip = SlipEntry.model_construct(mean=mean, sd=sd, patch=_slip(line).patch)
    values = line.model_copy(update={"ground": line.ground.model_copy(update={"slip": slip})})
    assert values.planter is not None  # noqa: S101 - the cabbage line has a planter
    table = default_table(Ground(values.planter.soil))
    clamp_n = table.planter.grip.clamp_n if values.planter.clamp is None else values.planter.clamp
    planter = ChainPlanter(table, clamp_n, values.planter.unreleased, None)
    row = run_line(values, metres=metres, seed=seed, machine=machine, planter=planter).rows[0]
    indices = spacing_indices([row.plants_m], line.spacing)
    low, high = np.percentile(row.ratio, (5, 95))
    has_wheel = line.drive.lag is None
    ratio = float(np.median(row.ratio))
    frequency_per_min = 60 * float(np.median(row.speed_m_s)) * ratio / planter.pitch_m
    falls = planter.draw(np.full(4_000, ratio), np.random.default_rng(seed), frequency_per_min=frequency_per_min)
    falls_m = float(falls.along_m.std())
    return SlipPoint(
        drive="ground wheel" if has_wheel else "motor",
        mean=mean,
        sd=sd,
        spacing_m=indices.regular_mean_m,
        precision=indices.precision,
        expected=_expected(line, indices.regular_mean_m, mean, sd if has_wheel else 0.0, falls_m),
        ratio_low=float(low),
        ratio_high=float(high),
        lodged_percent=planting_rates([row])["lodged"].percent,
        scraped_percent=100 * float(row.scraped[row.planted].mean()),
    )


def _expected(line: LineFile, spacing_m: float, mean: float, sd: float, falls_m: float) -> float:
    """Return the standard deviation of the spacing from the closed form, divided by the set spacing."""
    within = 1 - spacing_m / (3 * _slip(line).patch)
    slip_m = spacing_m * sd / (1 - mean) * math.sqrt(within)
    return math.hypot(slip_m, math.sqrt(2) * falls_m) / line.spacing


def _slip(line: LineFile) -> SlipEntry:
    assert line.ground.slip is not None  # noqa: S101 - the included line has a slip
    return line.ground.slip


def _speed_km_h(line: LineFile) -> float:
    return 3.6 * (line.ground.segments[0].speed or 0.0)


def _table(points: Sequence[SlipPoint], line: LineFile) -> Table:
    rows = tuple(
        (
            point.drive,
            100 * point.mean,
            100 * point.sd,
            100 * point.spacing_m,
            100 * point.precision,
            100 * point.expected,
            f"{point.ratio_low:.3f} to {point.ratio_high:.3f}",
            point.scraped_percent,
            point.lodged_percent,
        )
        for point in points
    )
    return Table(
        "slip",
        f"Spacings in the quality of feed; CV relative to the set spacing of {100 * line.spacing:g} cm; λ from the 5th "
        "to the 95th percentile",
        (
            "drive",
            "mean slip, %",
            "SD of the slip, %",
            "spacing, cm",
            "CV, %",
            "CV by the closed form, %",
            "λ at the release",
            "scraped, %",
            "lodged, %",
        ),
        rows,
    )


def _picture(points: Sequence[SlipPoint]) -> Picture:
    with drawing():
        figure = Figure(figsize=(7.2, 2.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        colours = list(COLOURS.values())
        wheel = [point for point in points if point.drive == "ground wheel"]
        for mean, colour in zip(MEANS, colours, strict=False):
            group = [point for point in wheel if point.mean == mean]
            sds = [100 * point.sd for point in group]
            left.plot(sds, [100 * point.precision for point in group], "o", color=colour, label=f"mean slip {mean:.0%}")
            left.plot(sds, [100 * point.expected for point in group], color=colour, linewidth=0.8)
            right.plot(
                [100 * point.spacing_m for point in group], [point.ratio_low for point in group], "v", color=colour
            )
            right.plot(
                [100 * point.spacing_m for point in group], [point.ratio_high for point in group], "^", color=colour
            )
        left.set_xlabel("standard deviation of the slip, %")
        left.set_ylabel("coefficient of variation of the spacing, %")
        left.legend(fontsize=7)
        right.axhline(1.0, color=colours[-1], linewidth=0.6)
        right.set_xlabel("mean plant spacing, cm")
        right.set_ylabel("ratio λ of chain speed to machine speed")
    return Picture(
        "slip",
        "Scatter of the spacing (points: rows, lines: closed form), and λ at the release, 5th percentile (triangles "
        "down) and 95th (up)",
        figure,
    )


def _record(point: SlipPoint) -> dict[str, object]:
    return {name: getattr(point, name) for name in SlipPoint.__slots__}
