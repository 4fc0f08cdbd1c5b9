"""Table of simulated falls, from which the falls in long rows of plants are drawn at random.

Every cell contains the results of the same random blocks, simulated with full contact at one planting frequency, one
ratio and one position of the opener. Between grid points, a fall is drawn from one of the neighbouring cells at random,
weighted by distance. The roll of a block is not part of the table: across the row, a block rolled by the largest
plausible angle comes to rest upright (tests/plant_sim/planter/test_disturbances.py).
The table of the default parameters is part of the package; any other is built once and stored in the cache folder.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RegularGridInterpolator

from controller.common.files.cache_folder import user_cache_folder
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter, load_planter, load_ranges
from plant_sim.planter.quality import is_tested_force
from plant_sim.planter.scatter import Draw, Ground, Ranges, draw
from plant_sim.planter.verdict import FallVerdict, stand_of, verdicts_of

RATIOS: Final = (0.70, 0.80, 0.85, 0.90, 0.95, 1.00, 1.05, 1.10, 1.17, 1.30, 1.45, 1.60, 1.80)
"""Grid of the ratio lambda."""
OPENERS_DEG: Final = (45.0, 60.0, 67.5, 75.0, 82.5, 90.0, 97.5, 105.0, 120.0, 135.0, 150.0)
"""Grid of the position of the opener on the bottom arc, degrees."""
BLOCKS: Final = 48
"""Number of random blocks in each cell."""
FREQUENCIES_PER_MIN: Final = (30.0, 52.0, 66.0)
"""Grid of the planting frequency, 1/min: from slow work to the highest frequency of the bench test."""
FREQUENCY_PER_MIN: Final = 58.0
"""Planting frequency at the centre of the bench test, 1/min."""


class Grid(NamedTuple):
    """Grid of a table of falls.

    Attributes:
        ratios: Ratios lambda, ascending.
        openers_deg: Positions of the opener on the bottom arc, ascending, degrees.
        blocks: Number of random blocks in each cell.
        frequencies_per_min: Planting frequencies, ascending, 1/min.
    """

    ratios: tuple[float, ...] = RATIOS
    openers_deg: tuple[float, ...] = OPENERS_DEG
    blocks: int = BLOCKS
    frequencies_per_min: tuple[float, ...] = FREQUENCIES_PER_MIN

    @property
    def axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Frequencies, ratios and positions of the opener: the first three axes of the cells."""
        return np.array(self.frequencies_per_min), np.array(self.ratios), np.array(self.openers_deg)


GRID: Final = Grid()
"""Grid of the packaged tables."""

PACKAGED: Final = Path(__file__).with_name("data")
"""Folder of the packaged tables."""

_VERSION: Final = 5
_SEED: Final = 1
_STUCK_DEG: Final = 90.0


class Falls(NamedTuple):
    """Falls of several blocks, as arrays of equal length.

    Attributes:
        along_m: Middle of the base at rest, measured from the hinge at its lowest point, forward positive, m.
        depth_m: Depth of the base below the soil surface, m.
        tilt_deg: Angle of the stem from the vertical, forward positive, degrees; 90 for a block that stuck to a
            plate and tipped across the row.
        stand: `Stand` codes.
        scraped: True if the guide plate touched the block on the ground.
        within: True if frequency, ratio and opener are inside the grid of the table, and, on soil, the clamp force is
            among the tested ones, to which the share of sticking blocks is fitted. Outside the grid, the nearest grid
            point is used.
    """

    along_m: NDArray[np.float64]
    depth_m: NDArray[np.float64]
    tilt_deg: NDArray[np.float64]
    stand: NDArray[np.int8]
    scraped: NDArray[np.bool_]
    within: NDArray[np.bool_]


class FallTable:
    """Table of falls of one planter on one ground.

    Attributes:
        planter: Parameters of the planter.
        kind: Ground.
        cells: Results, of shape (frequencies, ratios, openers, blocks, 5): along_m, clearance below the tip, m,
            tilt_deg, the impulse of the guide plate on the ground, N s, and pushed_m.
        grid: Grid of the cells.
    """

    def __init__(self, planter: Planter, kind: Ground, cells: NDArray[np.float64], grid: Grid = GRID) -> None:
        """Initialise the table from simulated cells."""
        self.grid = grid
        self.planter = planter
        self.kind = kind
        self.cells = cells
        chain = planter.chain
        self._tip_depth_m = chain.sprocket_radius_m + chain.tip_height_m - chain.axle_height_m

    def draw(
        self,
        ratio: ArrayLike,
        rng: np.random.Generator,
        *,
        frequency_per_min: ArrayLike,
        opener_deg: float | None = None,
        clamp_n: float | None = None,
    ) -> Falls:
        """Draw one fall for every ratio.

        Args:
            ratio: Ratios lambda, one for each block.
            rng: Random number generator.
            frequency_per_min: Planting frequency of each block, or of all blocks, 1/min.
            opener_deg: Position of the opener, degrees; by default that of the planter.
            clamp_n: Clamp force, N; by default that of the planter.
        """
        ratios = np.atleast_1d(np.asarray(ratio, dtype=float))
        place_deg = self.planter.chain.release_deg if opener_deg is None else opener_deg
        force_n = self.planter.grip.clamp_n if clamp_n is None else clamp_n
        frequencies = np.broadcast_to(np.asarray(frequency_per_min, dtype=float), ratios.shape)
        at = frequencies, ratios, np.full(ratios.shape, place_deg)
        near = [_neighbour(axis, values, rng) for axis, values in zip(self.grid.axes, at, strict=True)]
        block = rng.integers(self.cells.shape[3], size=ratios.shape)
        drawn = self.cells[(*(index for index, _ in near), block)]
        along_m, clearance_m, tilt_deg, scrape_n_s = np.moveaxis(drawn[..., :4], -1, 0)
        within = np.logical_and.reduce([inside for _, inside in near])
        if self.kind is Ground.SOIL:
            share = self.planter.scatter.stick_share_at(force_n)
            tilt_deg = np.where(rng.uniform(size=ratios.shape) < share, _STUCK_DEG, tilt_deg)
            within = within & is_tested_force(force_n)
        return Falls(
            along_m=along_m,
            depth_m=self._tip_depth_m + clearance_m,
            tilt_deg=tilt_deg,
            stand=stand_of(tilt_deg),
            scraped=scrape_n_s > 0.0,
            within=within,
        )

    def verdict_share(self, verdict: FallVerdict, frequency_per_min: float) -> NDArray[np.float64]:
        """Return the share of blocks with a verdict, interpolated linearly at a frequency, of shape (ratios, openers).

        Args:
            verdict: Verdict.
            frequency_per_min: Planting frequency, 1/min.
        """
        _, ratios, openers_deg = self.grid.axes
        points = np.stack(np.meshgrid(frequency_per_min, ratios, openers_deg, indexing="ij"), axis=-1)[0]
        shares: NDArray[np.float64] = self._interpolator(verdict)(points)
        return shares

    def verdict_shares_at(
        self, ratio: float, opener_deg: float, frequency_per_min: float
    ) -> tuple[dict[FallVerdict, float], bool]:
        """Return the shares of the verdicts at a point, interpolated linearly, and whether it is inside the grid.

        Outside the grid, the nearest point on its edge is used. Blocks that stick to a plate are not included.

        Args:
            ratio: Ratio lambda.
            opener_deg: Position of the opener, degrees.
            frequency_per_min: Planting frequency, 1/min.
        """
        point = frequency_per_min, ratio, opener_deg
        at = tuple(np.clip(value, axis[0], axis[-1]) for value, axis in zip(point, self.grid.axes, strict=True))
        return {each: float(self._interpolator(each)(at)) for each in FallVerdict}, at == point

    def _interpolator(self, verdict: FallVerdict) -> RegularGridInterpolator:
        """Return the interpolator of the share of the simulated blocks with a verdict."""
        shares = (verdicts_of(self.cells[..., 2], self.cells[..., 4]) == verdict).mean(axis=-1)
        return RegularGridInterpolator(self.grid.axes, shares)


def build_cells(
    planter: Planter,
    ranges: Ranges,
    kind: Ground,
    *,
    grid: Grid = GRID,
    progress: Callable[[int, int], None] | None = None,
) -> NDArray[np.float64]:
    """Return the cells of a `FallTable`, simulated with full contact.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        kind: Ground.
        grid: Grid of the cells.
        progress: Function called with the number of completed motions and the total number.
    """
    draws = drawn_blocks(planter, ranges, kind, grid.blocks)
    frequencies, ratios, openers_deg = grid.axes
    cells = np.empty((*map(len, grid.axes), grid.blocks, 5))
    motions = list(itertools.product(enumerate(frequencies.tolist()), enumerate(ratios.tolist())))
    for done, ((layer, frequency_per_min), (row, ratio)) in enumerate(motions, start=1):
        motion = motion_at(planter, ratio, frequency_per_min)
        for (column, opener_deg), (block, drawn) in itertools.product(enumerate(openers_deg), enumerate(draws)):
            cells[layer, row, column, block] = cell_values(drawn, motion, float(opener_deg))
        if progress is not None:
            progress(done, len(motions))
    return cells


def drawn_blocks(planter: Planter, ranges: Ranges, kind: Ground, blocks: int) -> list[Draw]:
    """Return the random blocks that every cell of a table contains.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        kind: Ground.
        blocks: Number of blocks.
    """
    rng = np.random.default_rng(_SEED)
    draws = [draw(planter, ranges, kind, rng) for _ in range(blocks)]
    return _evenly_deep(draws, planter) if kind is Ground.SOIL else draws


def cell_values(drawn: Draw, motion: Motion, opener_deg: float) -> tuple[float, float, float, float, float]:
    """Simulate the fall of one block and return its values in a cell, in the order of `FallTable.cells`."""
    fall = drawn.fall(motion, opener_deg)
    return fall.along_m, drawn.ground.clearance_m, fall.tilt_deg, fall.scrape_n_s, fall.pushed_m


def _evenly_deep(draws: Sequence[Draw], planter: Planter) -> list[Draw]:
    """Return draws whose clearances are evenly spaced quantiles of the normal distribution, in the same order.

    The few blocks of a cell then have the mean and the scatter of the depth that the parameters state.
    """
    mean_m, sd_m = planter.bench_soil.clearance_m, planter.scatter.clearance_sd_m
    if sd_m == 0.0:
        return list(draws)
    ranks = np.argsort(np.argsort([drawn.ground.clearance_m for drawn in draws]))
    shares = ((ranks + 0.5) / len(draws)).tolist()
    clearances_m = [NormalDist(mean_m, sd_m).inv_cdf(share) for share in shares]
    return [
        drawn._replace(ground=dataclasses.replace(drawn.ground, clearance_m=clearance_m))
        for drawn, clearance_m in zip(draws, clearances_m, strict=True)
    ]


def motion_at(planter: Planter, ratio: float, frequency_per_min: float = FREQUENCY_PER_MIN) -> Motion:
    """Return the motion at a ratio lambda and a planting frequency."""
    chain = planter.chain
    chain_m_s = chain.pitch_m * frequency_per_min / 60
    return Motion(chain, speed_m_s=chain_m_s / ratio, frequency_per_min=frequency_per_min)


@lru_cache(maxsize=4)
def default_table(kind: Ground) -> FallTable:
    """Return the table of the default parameters."""
    return fall_table(load_planter(), load_ranges(), kind)


def fall_table(
    planter: Planter,
    ranges: Ranges,
    kind: Ground,
    *,
    grid: Grid = GRID,
    progress: Callable[[int, int], None] | None = None,
) -> FallTable:
    """Return the table of a planter from the package or the cache, or build and store it if it does not exist.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        kind: Ground.
        grid: Grid of the cells.
        progress: Function called with the number of completed motions and the total number while the table is built.

    Raises:
        OSError: The cache folder is not writable.
        RuntimeError: The user has no home folder.
    """
    stored = stored_table(planter, ranges, kind, grid=grid)
    if stored is None:
        path = write_table(planter, ranges, kind, user_cache_folder(), grid=grid, progress=progress)
        stored = FallTable(planter, kind, np.load(path).astype(float), grid)
    return stored


def stored_table(planter: Planter, ranges: Ranges, kind: Ground, *, grid: Grid = GRID) -> FallTable | None:
    """Return the table of a planter from the package or the cache; None if neither contains it.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        kind: Ground.
        grid: Grid of the cells.

    Raises:
        RuntimeError: The user has no home folder.
    """
    name = table_name(planter, ranges, kind, grid)
    for path in (PACKAGED / name, user_cache_folder() / name):
        if path.exists():
            return FallTable(planter, kind, np.load(path).astype(float), grid)
    return None


def write_table(
    planter: Planter,
    ranges: Ranges,
    kind: Ground,
    folder: Path,
    *,
    grid: Grid = GRID,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Build the table of a planter and write it to a folder.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        kind: Ground.
        folder: Folder; created if it does not exist.
        grid: Grid of the cells.
        progress: Function called with the number of completed motions and the total number.

    Returns:
        Path of the file.

    Raises:
        OSError: The folder is not writable.
    """
    path = folder / table_name(planter, ranges, kind, grid)
    _store(build_cells(planter, ranges, kind, grid=grid, progress=progress), path)
    return path


def table_name(planter: Planter, ranges: Ranges, kind: Ground, grid: Grid = GRID) -> str:
    """Return the file name of a table, which identifies everything that its cells depend on."""
    return f"falls-{kind}-{_key(planter, ranges, kind, grid)}.npy"


def _store(cells: NDArray[np.float64], path: Path) -> None:
    """Write the cells to a file completely or not at all."""
    data = io.BytesIO()
    np.save(data, cells.astype(np.float32))
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_bytes(data.getvalue())
    part.replace(path)


def _key(planter: Planter, ranges: Mapping[str, tuple[float, float]], kind: Ground, grid: Grid) -> str:
    """Return a hash of everything that the cells depend on; the code is represented by `_VERSION`."""
    scatter = planter.scatter
    content = (
        _VERSION,
        planter.chain,
        planter.block,
        planter.grip,
        getattr(planter, kind),
        (scatter.place_m, scatter.opener_deg, scatter.pitch_deg, scatter.uneven_s, scatter.slope_deg),
        scatter.clearance_sd_m,
        sorted(ranges.items()),
        (tuple(grid), _SEED),
    )
    return hashlib.sha256(repr(content).encode()).hexdigest()[:16]


def _neighbour(
    grid: NDArray[np.float64], values: NDArray[np.float64], rng: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return a random neighbouring grid point of each value, weighted by distance, and whether the value is inside."""
    inside = (values >= grid[0]) & (values <= grid[-1])
    clipped = np.clip(values, grid[0], grid[-1])
    upper = np.clip(np.searchsorted(grid, clipped), 1, len(grid) - 1)
    weight = (clipped - grid[upper - 1]) / (grid[upper] - grid[upper - 1])
    return np.where(rng.uniform(size=values.shape) < weight, upper, upper - 1), inside
