"""False alarms of ``study analyse``, from the CSV file to the P value, by simulation.

``python -m scripts.analyse_error_rates`` prints the table of docs/statistics.md. No factor has an effect. Seedlings of
a tray of 72 are correlated as in `scripts.error_rates`; every table is written as a CSV file and analysed by the
functions of the command.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from scipy import stats

from plant_sim.study.analyse.model import TrialModel, fit_model
from plant_sim.study.analyse.roles import RoleOptions, assign
from plant_sim.study.analyse.table import read_table
from plant_sim.study.doe.irls import Array, Link
from plant_sim.study.doe.standard_designs import box_behnken
from scripts.error_rates import CORRELATIONS, NOMINAL, simulated, table

LINKS: Final[tuple[Link, ...]] = ("logit", "identity")
DESIGNS: Final = ("blocks", "whole plots")
SEEDLINGS: Final = 144
BLOCK_SHARES: Final = (0.07, 0.09)
"""Share of losses in each block."""
PLOT_SHARE: Final = 0.08
PLOT_CORRELATION: Final = 0.02
"""Mean share of losses of the whole plots, and correlation of two seedlings of different trials of one plot."""
_PLOTS, _FOAMS_MM = 8, (8, 8, 16, 16)


def block_table(correlation: float, rng: np.random.Generator) -> tuple[Sequence[str], list[Sequence[object]]]:
    """Return heading and lines of a Box-Behnken design in two blocks of different losses."""
    points = box_behnken(3, centres=3)
    lines: list[Sequence[object]] = []
    for block, share in enumerate(BLOCK_SHARES):
        lost = _lost(np.full(len(points), share), correlation, rng)
        lines += [(*point, f"D{block}", count, SEEDLINGS) for point, count in zip(points.tolist(), lost, strict=True)]
    return ("foam", "age", "pressure", "date", "lost", "total"), lines


def plot_table(correlation: float, rng: np.random.Generator) -> tuple[Sequence[str], list[Sequence[object]]]:
    """Return heading and lines of whole plots, each of one age and with a share of losses of its own."""
    strength = (1 - PLOT_CORRELATION) / PLOT_CORRELATION
    shares = rng.beta(PLOT_SHARE * strength, (1 - PLOT_SHARE) * strength, _PLOTS)
    lines: list[Sequence[object]] = []
    for plot, share in enumerate(shares):
        lost = _lost(np.full(len(_FOAMS_MM), share), correlation, rng)
        lines += [(plot, (45, 55)[plot % 2], foam, n, SEEDLINGS) for foam, n in zip(_FOAMS_MM, lost, strict=True)]
    return ("batch", "age", "foam", "lost", "total"), lines


def _lost(shares: Array, correlation: float, rng: np.random.Generator) -> list[int]:
    observed = simulated(shares, SEEDLINGS, correlation, 1, rng)[0]
    return [round(SEEDLINGS * share) for share in observed.tolist()]


_TABLES = {"blocks": block_table, "whole plots": plot_table}
_ROLES = {
    "blocks": RoleOptions(),
    "whole plots": RoleOptions(factors=("age", "foam"), whole_plots="batch", counts="lost", total="total"),
}


def p_values(path: Path, design: str, link: Link) -> dict[str, float]:
    """Return the P values of the factors together and of the lack of fit of a file, by stratum of the error."""
    model = fit_model(assign(read_table(path), _ROLES[design]), None, link)
    assert isinstance(model, TrialModel)  # noqa: S101 - the designs identify a model
    found = {}
    for stratum in model.strata:
        name = "factors" if stratum.name == "trials" else f"factors {stratum.name}"
        lack = next((row.p for row in stratum.rows() if row.source == "lack of fit"), None)
        for test, p in ((name, stratum.model_p), ("lack of fit", lack)):
            if p is not None:
                found[test] = p
    return found


def rejections(design: str, link: Link, correlation: float, tables: int, seed: int = 1) -> dict[str, int]:
    """Return in how many tables without any effect each test rejects at the nominal 5 %."""
    rng = np.random.default_rng((seed, DESIGNS.index(design), round(1000 * correlation)))
    found: dict[str, int] = {}
    with TemporaryDirectory() as folder:
        path = Path(folder, "trials.csv")
        for _ in range(tables):
            heading, lines = _TABLES[design](correlation, rng)
            with path.open("w", encoding="utf-8", newline="") as file:
                csv.writer(file).writerows([heading, *lines])
            for test, p in p_values(path, design, link).items():
                found[test] = found.get(test, 0) + (p < NOMINAL)
    return found


def rows(tables: int) -> list[tuple[str, ...]]:
    """Return the rows of the table of false alarms."""
    cells: list[tuple[str, ...]] = []
    for design, link, correlation in itertools.product(DESIGNS, LINKS, CORRELATIONS):
        for test, count in rejections(design, link, correlation, tables).items():
            low, high = stats.binomtest(count, tables).proportion_ci(method="exact")
            rate = f"{100 * count / tables:.1f} ({100 * low:.1f} to {100 * high:.1f})"
            cells.append((design, test, link, f"{correlation:g}", rate))
    return sorted(cells, key=lambda row: (row[0], row[1]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m scripts.analyse_error_rates", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--tables", type=int, default=1000, help="simulated tables per row (default: 1000)")
    heading = ("design", "test", "link", "correlation", "false alarms, % (95 % interval)")
    sys.stdout.write(table(heading, rows(parser.parse_args().tables)) + "\n")


if __name__ == "__main__":
    main()
