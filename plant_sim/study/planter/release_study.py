"""Study ``planter-release``: clean falls and lodging over the ratio lambda and the position of the opener."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from controller.common.document.parts import Cell, Heading, Part, Picture, Table
from plant_sim.common.figure_style import COLOURS, drawing
from plant_sim.planter.falls import BLOCKS, FREQUENCY_PER_MIN, FallTable, motion_at
from plant_sim.planter.parameters import Planter
from plant_sim.planter.ratio import zero_speed_points
from plant_sim.planter.scatter import Ground, Ranges
from plant_sim.planter.verdict import PUSHED_M, FallVerdict
from plant_sim.study.engines import Progress
from plant_sim.study.planter.lodging_fit import Values, rms
from plant_sim.study.planter.release_windows import GOOD, window_parts, window_points, window_record, windows_of
from plant_sim.study.planter.verdicts import FallPoint, VerdictCount, count_verdicts
from plant_sim.study.report.study import Study
from plant_sim.study.runner import command_line

LOWEST_RATIO: Final = 0.8
HIGHEST_RATIO: Final = 1.6
"""Largest ratio of the map; `LOWEST_RATIO` is the smallest."""
SAMPLES: Final = 12
"""Number of random points on each ground that are compared with falls simulated with full contact."""

_NAMES: Final[Mapping[Ground, str]] = {Ground.RIGID: "rigid ground", Ground.SOIL: "bench soil"}
_LODGED: Final = (FallVerdict.FORWARD, FallVerdict.BACKWARD)
_LOWEST_DEG = 90.0


@dataclass(frozen=True)
class ReleaseMap:
    """Shares over the ratio and the position of the opener on one ground.

    Attributes:
        kind: Ground.
        ratios: Ratios, ascending.
        openers_deg: Positions of the opener, ascending, degrees.
        clean: Share of clean and upright falls, of shape (ratios, openers).
        lodged: Share of lodged falls; blocks that stick to a plate are not included.
        samples: Verdicts of falls with full contact at random points.
        table: Table of the falls.
    """

    kind: Ground
    ratios: Values
    openers_deg: Values
    clean: Values
    lodged: Values
    samples: tuple[VerdictCount, ...]
    table: FallTable

    def expected(self, count: VerdictCount) -> tuple[float, float]:
        """Return the shares of clean and of lodged falls at a sampled point, from the table."""
        shares, _ = self.table.verdict_shares_at(count.point.ratio, count.point.opener_deg, FREQUENCY_PER_MIN)
        return shares[FallVerdict.CLEAN], sum(shares[verdict] for verdict in _LODGED)

    def windows_deg(self, row: int) -> list[tuple[float, float]]:
        """Return the first and last position of every uninterrupted range inside the window at a ratio, degrees."""
        windows: list[tuple[float, float]] = []
        before = False
        for opener_deg, share in zip(self.openers_deg.tolist(), self.clean[row].tolist(), strict=True):
            if share >= GOOD:
                windows = [*windows[:-1], (windows[-1][0], opener_deg)] if before else [*windows, (opener_deg,) * 2]
            before = share >= GOOD
        return windows


def release_study(
    planter: Planter,
    ranges: Ranges,
    tables: Mapping[Ground, FallTable],
    *,
    draws: int,
    seed: int,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Study:
    """Return the study ``planter-release``.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        tables: Tables of falls of this planter, by ground.
        draws: Random falls with full contact at each sampled point.
        seed: Seed of the sampled points and of their falls.
        workers: Number of processes; by default one per core.
        progress: Callback after each completed point.
    """
    rng = np.random.default_rng(seed)
    points = [_random_point(tables[kind], draws, rng) for kind in Ground for _ in range(SAMPLES)]
    points += window_points(planter, draws)
    counts = count_verdicts(planter, ranges, points, seed=seed, workers=workers, progress=progress)
    sampled, windows = counts[: len(Ground) * SAMPLES], windows_of(counts[len(Ground) * SAMPLES :])
    maps = [_map(tables[kind], tuple(count for count in sampled if count.point.kind is kind)) for kind in Ground]
    return Study(
        name="planter-release",
        title="Chain planter: position of the release over λ",
        command=command_line("planter-release", trials=draws, seed=seed),
        parts=(
            *_map_parts(planter, maps),
            *(part for each in maps for part in _window_parts(planter, each)),
            *window_parts(*windows),
            *_sample_parts(maps, draws),
        ),
        record={
            "openers_deg": maps[0].openers_deg,
            "grounds": {each.kind.value: _record(each) for each in maps},
            **window_record(*windows),
        },
    )


def _random_point(table: FallTable, draws: int, rng: np.random.Generator) -> FallPoint:
    ratio = float(rng.uniform(LOWEST_RATIO, HIGHEST_RATIO))
    opener_deg = float(rng.uniform(table.grid.openers_deg[0], table.grid.openers_deg[-1]))
    return FallPoint(ratio, opener_deg, draws, kind=table.kind, frequency_per_min=FREQUENCY_PER_MIN)


def _map(table: FallTable, samples: tuple[VerdictCount, ...]) -> ReleaseMap:
    ratios, inside = np.array(table.grid.ratios), _in_map(table)
    lodged = sum(table.verdict_share(verdict, FREQUENCY_PER_MIN)[inside] for verdict in _LODGED)
    clean = table.verdict_share(FallVerdict.CLEAN, FREQUENCY_PER_MIN)[inside]
    openers_deg = np.array(table.grid.openers_deg)
    return ReleaseMap(table.kind, ratios[inside], openers_deg, clean, np.asarray(lodged), samples, table)


def _in_map(table: FallTable) -> NDArray[np.bool_]:
    """Return which ratios of a table are in the map."""
    ratios = np.array(table.grid.ratios)
    return (ratios >= LOWEST_RATIO) & (ratios <= HIGHEST_RATIO)


def _zero_speed_deg(planter: Planter, ratio: float) -> tuple[float, ...]:
    return tuple(point.phase_deg for point in zero_speed_points(motion_at(planter, ratio)))


def _map_parts(planter: Planter, maps: list[ReleaseMap]) -> list[Part]:
    stick = 100 * planter.scatter.stick_share_at(planter.grip.clamp_n)
    return [
        "What was fitted to what: the mean clearance of the block and the share of blocks that stick to a plate are "
        "fitted to part of Table 2 of the cabbage paper (study planter-lodging). The map is not fitted to anything; "
        "the paper has no data to compare it with.",
        Heading("Map"),
        f"From the packaged tables of falls: {BLOCKS} random blocks with full contact at each grid point, "
        f"{FREQUENCY_PER_MIN:g} plants per minute, interpolated. A fall is clean if the seedling is upright and the "
        f"guide plate has moved it by at most {1000 * PUSHED_M:g} mm on the ground. On bench soil, {stick:.1f} % of "
        "the blocks also stick to a plate and lodge at every ratio and position; they are not part of the map.",
        Picture(
            "release-map",
            "Share of clean and of lodged falls; black: points of zero horizontal speed, sin φ = 1/λ; dotted: lowest "
            f"point; dashed: opener of planter.yaml; orange: {100 * GOOD:g} % clean or more from the lowest point on",
            _chart(planter, maps),
        ),
    ]


def _window_parts(planter: Planter, each: ReleaseMap) -> list[Part]:
    name = _NAMES[each.kind]
    rows: list[tuple[Cell, ...]] = []
    for row, ratio in enumerate(each.ratios.tolist()):
        zero_deg = _zero_speed_deg(planter, ratio)
        second_deg = zero_deg[-1] if zero_deg else None
        means = (100 * share if share is not None else None for share in _means(each, row, second_deg))
        windows = "; ".join(f"{low:g} to {high:g}°" for low, high in each.windows_deg(row)) or "none"
        rows.append((f"{ratio:.2f}", "; ".join(f"{deg:.1f}°" for deg in zero_deg) or None, *means, windows))
    heading = (
        "λ",
        "zero speed",
        "before 90°, %",
        "90° to the second point, %",
        "beyond, %",
        f"grid points with {100 * GOOD:g} % or more",
    )
    return [
        Heading(f"Window of the release, {name}"),
        Table(
            f"window-{each.kind.value.replace('_', '-')}", f"Mean share of clean falls, {name}", heading, tuple(rows), 1
        ),
        _everywhere(planter, each),
    ]


def _means(each: ReleaseMap, row: int, second_deg: float | None) -> tuple[float | None, float | None, float | None]:
    """Return the mean share of clean falls before the lowest point, from there to the second point, and beyond it."""
    openers_deg, clean = each.openers_deg, each.clean[row]
    end_deg = _LOWEST_DEG if second_deg is None else second_deg
    rising = (openers_deg >= _LOWEST_DEG) & (openers_deg <= end_deg)
    parts = (openers_deg < _LOWEST_DEG, rising & (second_deg is not None), (openers_deg > end_deg))
    before, inside, beyond = (float(clean[part].mean()) if part.any() else None for part in parts)
    return before, inside, beyond


def _everywhere(planter: Planter, each: ReleaseMap) -> str:
    """Return the positions of the opener that are inside the window at every ratio, by frequency."""
    inside = _in_map(each.table)
    found = []
    for frequency_per_min in each.table.grid.frequencies_per_min:
        clean = each.table.verdict_share(FallVerdict.CLEAN, frequency_per_min)[inside]
        good_deg = each.openers_deg[(clean >= GOOD).all(axis=0)].tolist()
        where = ", ".join(f"{opener_deg:g}°" for opener_deg in good_deg) or "no grid point"
        found.append(f"at {frequency_per_min:g} plants per minute {where}")
    return (
        f"{100 * GOOD:g} % clean falls or more at every ratio of the map, with a pitch of up to "
        f"{planter.scatter.pitch_deg:g}°: {'; '.join(found)}. The distance between the plants is not considered. The "
        f"angle is that of the opener; the block is free {1000 * planter.grip.free_s:.0f} ms later."
    )


def _sample_parts(maps: list[ReleaseMap], draws: int) -> list[Part]:
    rows: list[tuple[Cell, ...]] = []
    sentences = []
    for each in maps:
        pairs = [
            (*each.expected(count), count.proportion(FallVerdict.CLEAN).share, count.proportion(*_LODGED).share)
            for count in each.samples
        ]
        rows += [
            (
                _NAMES[each.kind],
                count.point.ratio,
                count.point.opener_deg,
                *(100 * pair[index] for index in (0, 2, 1, 3)),
            )
            for count, pair in zip(each.samples, pairs, strict=True)
        ]
        table, full = np.array([pair[:2] for pair in pairs]), np.array([pair[2:] for pair in pairs])
        expected = math.sqrt(float(np.mean(table * (1 - table))) * (1 / draws + 1 / BLOCKS))
        sentences.append(
            f"{_NAMES[each.kind]}: {100 * rms(table - full):.1f} points, where the numbers of falls alone give "
            f"{100 * expected:.1f}"
        )
    heading = ("ground", "λ", "opener, °", "clean, table", "clean, full", "lodged, table", "lodged, full")
    return [
        Heading("Sample with full contact"),
        f"At {SAMPLES} random points between the grid points, {draws} new random falls each were simulated with full "
        f"contact. Root mean square difference of the interpolated shares: {'; '.join(sentences)}.",
        Table("samples", "Shares by the table and by full contact, %", heading, tuple(rows)),
    ]


def _chart(planter: Planter, maps: list[ReleaseMap]) -> Figure:
    with drawing():
        figure = Figure(figsize=(8.0, 6.4), layout="constrained")
        panels = figure.subplots(len(maps), 2, sharex=True, sharey=True)
        for each, (left, right) in zip(maps, panels, strict=True):
            for axes, shares, name, colours in (
                (left, each.clean, "clean and upright", "Greens"),
                (right, each.lodged, "lodged", "Reds"),
            ):
                edges = _edges(each.ratios), _edges(each.openers_deg)
                drawn = axes.pcolormesh(*edges, 100 * shares.T, cmap=colours, vmin=0, vmax=100)
                figure.colorbar(drawn, ax=axes, label="share of the falls, %")
                axes.set_title(f"{_NAMES[each.kind]}: {name}, %", fontsize=8, loc="left")
                _mark_phases(axes, planter.chain.release_deg)
            _mark_window(left, each)
            left.set_ylabel("phase of the opener on the bottom arc, °")
        for axes in panels[-1]:
            axes.set_xlabel("ratio λ of chain speed to machine speed")
    return figure


def _mark_phases(axes: Axes, release_deg: float) -> None:
    """Draw the points of zero horizontal speed, the lowest point and the position of the opener."""
    ratios = np.linspace(1.0, HIGHEST_RATIO, 241)
    phases_deg = np.degrees(np.arcsin(1 / ratios))
    for branch_deg in (phases_deg, 180.0 - phases_deg):
        axes.plot(ratios, branch_deg, color="black", linewidth=1.2)
    axes.axhline(_LOWEST_DEG, color="black", linewidth=0.6, linestyle=":")
    axes.axhline(release_deg, color=COLOURS["left"], linewidth=0.8, linestyle="--")


def _mark_window(axes: Axes, each: ReleaseMap) -> None:
    """Draw the outline of the cells inside the window, from the lowest point on."""
    x, y = _edges(each.ratios), _edges(each.openers_deg)
    good = np.pad((each.clean >= GOOD) & (each.openers_deg >= _LOWEST_DEG), 1)
    for row, column in np.argwhere(good[1:-1, 1:-1]).tolist():
        sides = {(-1, 0): (0, 0, 0, 1), (1, 0): (1, 1, 0, 1), (0, -1): (0, 1, 0, 0), (0, 1): (0, 1, 1, 1)}
        for (right, up), (x0, x1, y0, y1) in sides.items():
            if not good[row + 1 + right, column + 1 + up]:
                ends = [x[row + x0], x[row + x1]], [y[column + y0], y[column + y1]]
                axes.plot(*ends, color=COLOURS["right"], linewidth=1.6)


def _edges(grid: Values) -> Values:
    """Return the edges of the cells around the points of a grid."""
    middles = (grid[1:] + grid[:-1]) / 2
    edges: Values = np.concatenate([[grid[0] - (middles[0] - grid[0])], middles, [2 * grid[-1] - middles[-1]]])
    return edges


def _record(each: ReleaseMap) -> dict[str, object]:
    return {
        "ratios": each.ratios,
        "clean": each.clean,
        "lodged": each.lodged,
        "windows_deg": [each.windows_deg(row) for row in range(len(each.ratios))],
        "samples": [
            {
                "ratio": count.point.ratio,
                "opener_deg": count.point.opener_deg,
                "expected": each.expected(count),
                "clean": count.proportion(FallVerdict.CLEAN).share,
                "lodged": count.proportion(*_LODGED).share,
            }
            for count in each.samples
        ],
    }
