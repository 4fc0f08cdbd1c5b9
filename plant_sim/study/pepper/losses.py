"""Pareto front of the two losses that the claws trade against each other: picking and carrying."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.common.document.parts import Heading, Part, Picture, Table
from plant_sim.study.doe.design import full_factorial, to_natural
from plant_sim.study.doe.optimum import pareto
from plant_sim.study.doe.regression import terms
from plant_sim.study.doe.weighted import WeightedFit, weighted_fit
from plant_sim.study.errors import StudyError
from plant_sim.study.paper_tables import PEPPER_FACTORS
from plant_sim.study.pepper.paper import HIGH, LOW
from plant_sim.study.report.surface import pareto_front
from plant_sim.twin.report import TrialReport

_LOSSES: Final = {"P": "pick failures, %", "D": "carry failures, %"}
_FRONT_POINTS = 21
_FRONT_LISTED = 4
_CLOUD_LEVELS = 9


def losses_parts(coded: NDArray[np.float64], trials: Sequence[TrialReport]) -> list[Part]:
    """Return the Pareto front of pick and carry failures, each fitted with a logit link.

    The logit keeps the small shares above 0. Without enough failures for a model, a sentence says so.

    Args:
        coded: Coded setting of every trial.
        trials: Completed trials.
    """
    try:
        picking, carrying = (_fit(coded, trials, name) for name in _LOSSES)
    except StudyError as error:
        return [Heading("Pick failures against carry failures"), f"There is no Pareto front: {error}."]
    front = pareto(picking, carrying, LOW, HIGH, _FRONT_POINTS)
    cloud = full_factorial([tuple(np.linspace(*ends, _CLOUD_LEVELS)) for ends in zip(LOW, HIGH, strict=True)])
    figure = pareto_front(
        front,
        a=_LOSSES["P"],
        b=_LOSSES["D"],
        marks={},
        cloud=np.column_stack([picking.predict(cloud), carrying.predict(cloud)]),
    )
    listed = slice(None, None, _FRONT_LISTED)
    rows = tuple(
        (*map(float, setting), float(p), float(d))
        for setting, p, d in zip(
            to_natural(PEPPER_FACTORS, front.coded)[listed], front.a[listed], front.b[listed], strict=True
        )
    )
    heading = (*(factor.label for factor in PEPPER_FACTORS), *_LOSSES.values())
    return [
        Heading("Pick failures against carry failures"),
        "A firmer grip loses fewer seedlings in picking and more in carrying. The front is that of two weighted fits "
        "of the twin's trials (full quadratic, logit link); throw failures are not part of it.",
        Table("pareto", "Pareto front with every factor from -1 to 1, every fourth point", heading, rows),
        Picture("pareto-front", "Pareto front of pick and carry failures of the twin.", figure),
    ]


def _fit(coded: NDArray[np.float64], trials: Sequence[TrialReport], name: str) -> WeightedFit:
    counts = np.array([getattr(trial, name) for trial in trials])
    seedlings = np.array([trial.seedlings for trial in trials])
    return weighted_fit(coded, counts, seedlings, terms(len(PEPPER_FACTORS), "quadratic"), link="logit")
