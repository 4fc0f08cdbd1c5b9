"""Standard designs in coded units: Box-Behnken, orthogonal arrays, fractions of a factorial; blocks and run order.

The points come from pyDOE3. Central composite designs with any axial level are in `plant_sim.study.doe.design`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.study.doe.design import central_composite, two_level
from plant_sim.study.errors import StudyError

ARRAYS: Final[Mapping[str, str]] = {
    "L4": "L4(2^3)",
    "L8": "L8(2^7)",
    "L9": "L9(3^4)",
    "L12": "L12(2^11)",
    "L16": "L16(2^15)",
    "L16x4": "L16(4^5)",
    "L18": "L18(6^1 3^6)",
    "L25": "L25(5^6)",
    "L27": "L27(2^1 3^12)",
}
"""Orthogonal arrays, with their names in pyDOE3; its L27 has 13 columns of three levels despite the name."""

FRACTIONS: Final[Mapping[tuple[int, int], str]] = {
    (3, 4): "a b ab",
    (4, 8): "a b c abc",
    (5, 8): "a b c ab ac",
    (5, 16): "a b c d abcd",
    (6, 8): "a b c ab ac bc",
    (6, 16): "a b c d abc bcd",
    (6, 32): "a b c d e abcde",
    (7, 8): "a b c ab ac bc abc",
    (7, 16): "a b c d abc bcd acd",
    (8, 16): "a b c d bcd acd abc abd",
}
"""Generators of the regular fractions with the highest resolution, by number of factors and of runs."""

_BOX_BEHNKEN_FACTORS = range(3, 6)
"""Numbers of factors for which pyDOE3 has the points of Box and Behnken (1960), who combine three factors from 6 on."""


@dataclass(frozen=True)
class RunPlan:
    """Runs of an experiment in the order of execution.

    Attributes:
        coded: Coded runs, one per row.
        blocks: Number of the block of every run, from 1.
    """

    coded: NDArray[np.float64]
    blocks: NDArray[np.int_]


def box_behnken(k: int, *, centres: int) -> NDArray[np.float64]:
    """Return a Box-Behnken design: the corners of every pair of factors with the others at 0, and repeated centres.

    Args:
        k: Number of factors, 3 to 5.
        centres: Number of centre runs.

    Raises:
        StudyError: The number of factors or of centres is out of range.
    """
    if k not in _BOX_BEHNKEN_FACTORS:
        raise StudyError(f"box-behnken: {k} factors; must be 3 to 5, else use a composite")
    if centres < 0:
        raise StudyError(f"box-behnken: {centres} centres; must be 0 or more")
    from pyDOE3 import bbdesign  # noqa: PLC0415 - importing it would delay every start of a worker

    return np.vstack([np.asarray(bbdesign(k, 1), dtype=np.float64)[:-1], np.zeros((centres, k))])


def orthogonal_array(name: str, k: int) -> NDArray[np.float64]:
    """Return the first columns of an orthogonal array, with the levels of each coded from -1 to 1.

    L18 is the array of one column with two levels and seven with three.

    Args:
        name: Name, such as ``L9``.
        k: Number of columns.

    Raises:
        StudyError: The array is unknown or has fewer columns.

    >>> orthogonal_array("L9", 2)[:4].tolist()
    [[-1.0, -1.0], [-1.0, 0.0], [-1.0, 1.0], [0.0, -1.0]]
    """
    if name not in ARRAYS:
        raise StudyError(f"orthogonal array {name}: is unknown; use one of {', '.join(ARRAYS)}")
    from pyDOE3 import get_orthogonal_array  # noqa: PLC0415

    levels = np.asarray(get_orthogonal_array(ARRAYS[name]), dtype=np.float64)
    if name == "L18":
        # each level of a six-level column is one pair of a level of two and a level of three
        levels = np.column_stack([levels[:, 0] // 3, levels[:, 0] % 3, levels[:, 1:]])
    if not 1 <= k <= levels.shape[1]:
        raise StudyError(f"orthogonal array {name}: {k} factors; must be 1 to {levels.shape[1]}")
    columns = levels[:, :k]
    coded: NDArray[np.float64] = 2 * columns / columns.max(axis=0) - 1
    return coded


def fractional_factorial(k: int, runs: int) -> NDArray[np.float64]:
    """Return a regular fraction of the 2^k factorial design.

    Args:
        k: Number of factors.
        runs: Number of runs, a power of 2 below 2^k.

    Raises:
        StudyError: There is no fraction of this size.
    """
    if (k, runs) not in FRACTIONS:
        sizes = [str(size) for number, size in FRACTIONS if number == k]
        remedy = f"use {' or '.join(sizes)}" if sizes else "fractions have 3 to 8 factors"
        raise StudyError(f"fractional factorial: {runs} runs for {k} factors; {remedy}")
    from pyDOE3 import fracfact  # noqa: PLC0415

    return np.asarray(fracfact(FRACTIONS[k, runs]), dtype=np.float64)


def blocked_composite(k: int, *, axial: float, centres: int, blocks: int) -> RunPlan:
    """Return a central composite design whose blocks leave the estimates of the linear and product terms unchanged.

    The axial points are the last block. With three blocks, the corners are divided by the sign of the product of all
    factors. The centres are distributed over the blocks as evenly as possible, the surplus to the first ones.

    Args:
        k: Number of factors.
        axial: Coded level of the axial points.
        centres: Number of centre runs of all blocks together.
        blocks: Number of blocks, 1 to 3.

    Raises:
        StudyError: The design is invalid, or cannot be divided into so many blocks.
    """
    points = central_composite(k, axial=axial, centres=centres)
    if blocks == 1:
        return RunPlan(points, np.ones(len(points), dtype=np.int_))
    if blocks not in (2, 3) or (blocks == 3 and k < 3):
        raise StudyError(f"composite of {k} factors: {blocks} blocks; must be 1 or 2, or 3 from three factors on")
    if centres < blocks:
        raise StudyError(f"composite in {blocks} blocks: {centres} centres; must be at least one per block")
    corners = two_level(k)
    first = np.where(corners.prod(axis=1) > 0, 1, 2) if blocks == 3 else np.ones(len(corners), dtype=np.int_)
    axes = np.full(2 * k, blocks)
    return RunPlan(points, np.concatenate([first, axes, np.arange(centres) % blocks + 1]).astype(np.int_))


def complete_blocks(points: NDArray[np.float64], blocks: int) -> RunPlan:
    """Return complete replicates of a design, each of which is a block."""
    return RunPlan(np.tile(points, (blocks, 1)), np.repeat(np.arange(1, blocks + 1), len(points)))


def randomised(plan: RunPlan, *, seed: int) -> RunPlan:
    """Return a plan with its blocks in order and the runs of each block in random order.

    Args:
        plan: The plan.
        seed: Seed of the order; the same seed gives the same order.
    """
    shuffled = np.random.default_rng(seed).permutation(len(plan.coded))
    order = shuffled[np.argsort(plan.blocks[shuffled], kind="stable")]
    return RunPlan(plan.coded[order], plan.blocks[order])
