"""Axes of the figures of studies: words with units, and labels on contour lines."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

import numpy as np
import pytest
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure

from plant_sim.common.figure_data import COLORBAR
from plant_sim.common.polynomial import Polynomial
from plant_sim.study.cabbage.study import cabbage_study
from plant_sim.study.paper_tables import PEPPER_FACTORS
from plant_sim.study.pepper.paper import paper_study
from plant_sim.study.report.axis_labels import axis_label
from plant_sim.study.report.study import Study
from plant_sim.study.report.surface import contours
from tests.plant_sim.study.figures import figures_of

WITHOUT_UNIT: Final = ("ratio ", "studentized residual", "normal quantile")
"""Beginnings of labels of quantities without a unit."""
STUDIES: Final[tuple[Callable[[], Study], ...]] = (paper_study, lambda: cabbage_study("reconciled"))


@pytest.mark.parametrize(
    ("label", "shown"),
    [
        ("S, %", "success rate S, %"),
        ("Y1, %", "lodging Y1, %"),
        ("foam thickness, mm", "foam thickness, mm"),
        ("crop.foam_thickness_mm, mm", "foam thickness, mm"),
        ("crop.claw_pressure_mpa, MPa", "claw pressure, MPa"),
        ("program.pause_at_feed, ms", "pause at feed, ms"),
        ("slide.throttle_conductance_m3_s_pa, m3/(s Pa)", "throttle conductance, m3/(s Pa)"),
        ("cycle_time_s, s", "cycle time, s"),
        ("cups", "cups"),
    ],
)
def test_a_symbol_or_parameter_becomes_words(label: str, shown: str) -> None:
    assert axis_label(label) == shown


@pytest.mark.parametrize("study", STUDIES, ids=["pepper", "cabbage"])
def test_every_axis_has_words_and_a_unit(study: Callable[[], Study]) -> None:
    for name, figure in figures_of(study()).items():
        for text in labels_of(figure):
            assert re.search("[a-z]{4}", text), f"{name}: {text!r} is not in words"
            assert ", " in text or text.startswith(WITHOUT_UNIT), f"{name}: {text!r} has no unit"
            assert not re.search(r"\w\.\w|[a-z]_[a-z]{2}", text), f"{name}: {text!r} is a name of the program"


def labels_of(figure: Figure) -> list[str]:
    """Return the labels of all axes; a colour bar has one."""
    labels = []
    for axes in figure.axes:
        both = [axes.get_xlabel(), axes.get_ylabel()]
        labels += [each for each in both if each] if axes.get_label() == COLORBAR else both
    return labels


@pytest.mark.parametrize(
    "surface",
    [
        Polynomial({"1": 90.0, "X1": 3.0, "X2^2": -4.0, "X3^2": -2.0}),
        Polynomial({"1": -1.0, "X1": 1.0, "X2": -1.0, "X3": 0.5}),
        Polynomial({"1": 50.0, "X1 X2": 5.0, "X1 X3": -5.0, "X2 X3": 5.0}),
    ],
    ids=["ridge", "plane", "saddle"],
)
def test_every_panel_has_labels_apart_from_each_other_and_from_the_frame(surface: Polynomial) -> None:
    """A label that the frame would clip, or that covers another one, cannot be read."""
    figure = contours(surface, PEPPER_FACTORS, response="S, %", held=[0.0] * 3, reach=[1.5] * 3)
    panels = [axes for axes in figure.axes if axes.get_label() != COLORBAR]
    assert len(panels) == 3
    for axes in panels:
        (lines,) = [each for each in axes.collections if isinstance(each, ContourSet) and not each.filled]
        places = axes.transData + axes.transAxes.inverted()
        at = np.array([places.transform(text.get_position()) for text in lines.labelTexts])
        assert len(at) >= 3
        assert ((at > 0.05) & (at < 0.95)).all()
        distances = np.linalg.norm(at[:, None] - at[None], axis=2)[np.triu_indices(len(at), 1)]
        assert (distances > 0.08).all()
