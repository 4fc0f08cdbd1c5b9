"""Table of simulated falls, from which the falls in long rows of plants are drawn at random.

Every cell contains the results of the same random blocks, simulated with full contact at one ratio and one position of
the opener. Between two grid points, a fall is drawn from one of the neighbouring cells at random, weighted by distance.
The table of the default parameters is part of the package; any other is built once and stored in the cache folder.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RegularGridInterpolator

from controller.common.files.cache_folder import user_cache_folder
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter, load_planter, load_ranges
from plant_sim.planter.scatter import Ground, Ranges, draw
from plant_sim.planter.verdict import FallVerdict, stand_of, verdicts_of

RATIOS: Final = (0.70, 0.80, 0.85, 0.90, 0.95, 1.00, 1.05, 1.10, 1.17, 1.30, 1.45, 1.60, 1.80)
"""Grid of the ratio lambda."""
OPENERS_DEG: Final = (45.0, 60.0, 67.5, 75.0, 82.5, 90.0, 97.5, 105.0, 120.0, 135.0, 150.0)
"""Grid of the position of the opener on the bottom arc, degrees."""
BLOCKS: Final = 48
"""Number of random blocks in each cell."""
FREQUENCY_PER_MIN: Final = 58.0
"""Planting frequency of the table, 1/min: the centre of the bench test."""


class Grid(NamedTuple):
    """Grid of a table of falls.

    Attributes:
        ratios: Ratios lambda, ascending.
        openers_deg: Positions of the opener on the bottom arc, ascending, degrees.
        blocks: Number of random blocks in each cell.
    """

    ratios: tuple[float, ...] = RATIOS
    openers_deg: tuple[float, ...] = OPENERS_DEG
    blocks: int = BLOCKS


GRID: Final = Grid()
"""Grid of the packaged tables."""

PACKAGED: Final = Path(__file__).with_name("data")
"""Folder of the packaged tables."""

_VERSION: Final = 3
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
        within: True if ratio and opener are inside the grid of the table; otherwise the nearest grid point is used.
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
        cells: Results, of shape (ratios, openers, blocks, 5): along_m, clearance below the tip, m, tilt_deg, the
            impulse of the guide plate on the ground, N s, and pushed_m.
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
        opener_deg: float | None = None,
        clamp_n: float | None = None,
    ) -> Falls:
        """Draw one fall for every ratio.

        Args:
            ratio: Ratios lambda, one for each block.
            rng: Random number generator.
            opener_deg: Position of the opener, degrees; by default that of the planter.
            clamp_n: Clamp force, N; by default that of the planter.
        """
        ratios = np.atleast_1d(np.asarray(ratio, dtype=float))
        place_deg = self.planter.chain.release_deg if opener_deg is None else opener_deg
        row, row_within = _neighbour(np.array(self.grid.ratios), ratios, rng)
        column, column_within = _neighbour(np.array(self.grid.openers_deg), np.full(ratios.shape, place_deg), rng)
        block = rng.integers(self.cells.shape[2], size=ratios.shape)
        along_m, clearance_m, tilt_deg, scrape_n_s = np.moveaxis(self.cells[row, column, block, :4], -1, 0)
        if self.kind is Ground.SOIL:
            share = self.planter.scatter.stick_share_at(self.planter.grip.clamp_n if clamp_n is None else clamp_n)
            tilt_deg = np.where(rng.uniform(size=ratios.shape) < share, _STUCK_DEG, tilt_deg)
        return Falls(
            along_m=along_m,
            depth_m=self._tip_depth_m + clearance_m,
            tilt_deg=tilt_deg,
            stand=stand_of(tilt_deg),
            scraped=scrape_n_s > 0.0,
            within=row_within & column_within,
        )

    def verdict_share(self, verdict: FallVerdict) -> NDArray[np.float64]:
        """Return the share of the simulated blocks with a verdict, of shape (ratios, openers)."""
        shares: NDArray[np.float64] = (verdicts_of(self.cells[..., 2], self.cells[..., 4]) == verdict).mean(axis=-1)
        return shares

    def verdict_shares_at(self, ratio: float, opener_deg: float) -> tuple[dict[FallVerdict, float], bool]:
        """Return the shares of the verdicts at a point, interpolated linearly, and whether it is inside the grid.

        Outside the grid, the nearest point on its edge is used. Blocks that stick to a plate are not included.

        Args:
            ratio: Ratio lambda.
            opener_deg: Position of the opener, degrees.
        """
        axes = np.array(self.grid.ratios), np.array(self.grid.openers_deg)
        at = tuple(np.clip(value, axis[0], axis[-1]) for value, axis in zip((ratio, opener_deg), axes, strict=True))
        shares = {each: float(RegularGridInterpolator(axes, self.verdict_share(each))(at)) for each in FallVerdict}
        return shares, at == (ratio, opener_deg)


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
        progress: Function called with the number of completed ratios and the total number.
    """
    ratios, openers_deg, blocks = grid
    rng = np.random.default_rng(_SEED)
    draws = [draw(planter, ranges, kind, rng) for _ in range(blocks)]
    cells = np.empty((len(ratios), len(openers_deg), blocks, 5))
    for row, ratio in enumerate(ratios):
        motion = motion_at(planter, ratio)
        for column, opener_deg in enumerate(openers_deg):
            for block, drawn in enumerate(draws):
                fall = drawn.fall(motion, opener_deg)
                clearance_m = drawn.ground.clearance_m
                cells[row, column, block] = fall.along_m, clearance_m, fall.tilt_deg, fall.scrape_n_s, fall.pushed_m
        if progress is not None:
            progress(row + 1, len(ratios))
    return cells


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
        progress: Function called with the number of completed ratios and the total number while the table is built.

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
        progress: Function called with the number of completed ratios and the total number.

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
        (scatter.place_m, scatter.opener_deg, scatter.clearance_sd_m),
        sorted(ranges.items()),
        (tuple(grid), FREQUENCY_PER_MIN, _SEED),
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
