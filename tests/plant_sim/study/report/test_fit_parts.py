"""Report parts of a fit: caveats, predicted percentages out of range, and markers on slices."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from controller.common.document.parts import Picture
from plant_sim.common.polynomial import Polynomial
from plant_sim.study.doe.design import Factor, central_composite
from plant_sim.study.doe.regression import Fit, fit, terms
from plant_sim.study.report.fit_parts import doubts, explains, fit_pictures, no_share_text
from plant_sim.study.report.surface import contours, observed_against_predicted

FACTORS = (Factor("foam", "mm", 10.0, 2.0), Factor("age", "d", 50.0, 5.0), Factor("count", "-", 3.0, 1.0))
DESIGN = central_composite(3, axial=1.5, centres=6)
LINEAR, QUADRATIC = terms(3, "linear"), terms(3, "quadratic")
NOISE = np.random.default_rng(3).normal(scale=0.5, size=len(DESIGN))


def of(values: dict[str, float], names: tuple[str, ...] = QUADRATIC) -> Fit:
    """Return a fit of a polynomial with some noise."""
    return fit(DESIGN, Polynomial(values).predict(DESIGN) + NOISE, names)


def test_a_significant_model_without_lack_of_fit_has_no_limitation() -> None:
    good = of({"1": 50.0, "X1": 5.0, "X2^2": -4.0})
    assert explains(good)
    assert doubts("S", good) == []


def test_a_model_of_noise_is_reported_as_not_significant() -> None:
    noise = of({"1": 50.0}, LINEAR)
    assert not explains(noise)
    assert doubts("S", noise)[0].startswith("S: the model is not significant (P 0.")


def test_a_lack_of_fit_is_reported() -> None:
    """The lack of fit of a plane to a curved surface is reported although the model is significant."""
    simple = of({"1": 50.0, "X1": 9.0, "X2^2": 8.0}, LINEAR)
    assert explains(simple)
    (doubt,) = doubts("S", simple)
    assert doubt.startswith("S: the model does not fit (lack of fit P <0.0001)")


def test_a_share_out_of_range_is_reported_with_its_setting_in_natural_units() -> None:
    """In panels from -1.5 to 1.5, 10 + 20 X1 gives -20 % at the thinnest foam and 40 % at the thickest."""
    held, reach = [0.0, 0.0, 0.0], [1.5, 1.5, 1.5]
    assert no_share_text(Polynomial({"1": 50.0, "X1": 20.0}), FACTORS, held=held, reach=reach) == []
    (low,) = no_share_text(Polynomial({"1": 10.0, "X1": 20.0}), FACTORS, held=held, reach=reach)
    assert "reaches -20.0 % at foam 7 mm, age " in low
    assert "Areas outside the range are grey" in low
    (both,) = no_share_text(Polynomial({"1": 50.0, "X1": 40.0}), FACTORS, held=held, reach=reach)
    assert "reaches -10.0 % at foam 7 mm" in both
    assert "and 110.0 % at foam 13 mm" in both


@pytest.mark.parametrize(("limits", "ends"), [((0.0, 100.0), (0.0, 40.0)), (None, (-20.0, 40.0))])
def test_the_colour_scale_of_a_share_ends_at_its_limits(
    limits: tuple[float, float] | None, ends: tuple[float, float]
) -> None:
    figure = contours(
        Polynomial({"1": 10.0, "X1": 20.0}), FACTORS, response="S, %", held=[0.0] * 3, reach=[1.5] * 3, limits=limits
    )
    assert figure.axes[-1].get_ylim() == pytest.approx(ends)


def test_a_marker_is_filled_only_on_the_slice_of_its_point() -> None:
    """The best point defines the slice; the other point differs only in the third factor."""
    surface = Polynomial({"1": 10.0, "X1": 1.0, "X3": 7.0})
    marks = {"best": np.array([0.5, 0.5, 0.5]), "other": np.array([0.5, 0.5, -1.0])}
    figure = contours(surface, FACTORS, response="S, %", held=[0.5] * 3, reach=[1.5] * 3, marks=marks)
    filled = [
        {str(line.get_label()): to_rgba(line.get_markerfacecolor())[3] > 0 for line in panel.lines}
        for panel in figure.axes[:3]
    ]
    assert filled == [
        {"best": True, "other": False},  # over foam and age
        {"best": True, "other": True},
        {"best": True, "other": True},
    ]
    assert texts_of(figure) == ["best: 14.00", "other: 3.50"]


def texts_of(figure: Figure) -> list[str]:
    """Return the legend texts of a figure."""
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def test_the_line_of_the_model_has_a_label() -> None:
    figure = observed_against_predicted(np.array([1.0, 2.0]), np.array([1.1, 1.9]), response="S, %", r2=0.9)
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["observed = predicted"]


def test_plots_of_a_fit_report_shares_out_of_range_first() -> None:
    parts = fit_pictures("s", of({"1": 10.0, "X1": 20.0}), FACTORS, response="S, %", marks={}, held=np.zeros(3))
    assert [type(part) for part in parts] == [str, Picture, Picture]
