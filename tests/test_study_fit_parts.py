"""What is said of a fit and drawn of it: doubts in words, shares that are none, marks on and off a slice."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from plant_sim.bench.study.design import Factor, central_composite
from plant_sim.bench.study.fit_parts import doubts, explains, fit_pictures, no_share_text
from plant_sim.bench.study.parts import Picture, Table
from plant_sim.bench.study.regression import Fit, Polynomial, fit, terms
from plant_sim.bench.study.surface import contours, observed_against_predicted

FACTORS = (Factor("foam", "mm", 10.0, 2.0), Factor("age", "d", 50.0, 5.0), Factor("count", "-", 3.0, 1.0))
DESIGN = central_composite(3, axial=1.5, centres=6)
LINEAR, QUADRATIC = terms(3, "linear"), terms(3, "quadratic")
NOISE = np.random.default_rng(3).normal(scale=0.5, size=len(DESIGN))


def of(values: dict[str, float], names: tuple[str, ...] = QUADRATIC) -> Fit:
    """Return a fit of a polynomial with some noise."""
    return fit(DESIGN, Polynomial(values).predict(DESIGN) + NOISE, names)


def test_a_model_that_explains_its_response_and_fits_it_raises_no_doubt() -> None:
    good = of({"1": 50.0, "X1": 5.0, "X2^2": -4.0})
    assert explains(good)
    assert doubts("S", good) == []


def test_a_model_of_noise_is_said_to_explain_nothing() -> None:
    noise = of({"1": 50.0}, LINEAR)
    assert not explains(noise)
    assert doubts("S", noise)[0].startswith("S: the model explains nothing that chance alone would not (P 0.")


def test_a_model_that_is_too_simple_is_said_to_be() -> None:
    """A plane through a bowl, whose slope it finds."""
    simple = of({"1": 50.0, "X1": 9.0, "X2^2": 8.0}, LINEAR)
    assert explains(simple)
    (told,) = doubts("S", simple)
    assert told.startswith("S: the model does not fit (lack of fit P <0.0001)")


def test_where_a_share_is_none_is_told_in_the_units_of_the_factors() -> None:
    """10 + 20 X1 over panels to 1.5: -20 % at the lowest foam, 40 % at the highest."""
    held, reach = [0.0, 0.0, 0.0], [1.5, 1.5, 1.5]
    assert no_share_text(Polynomial({"1": 50.0, "X1": 20.0}), FACTORS, held=held, reach=reach) == []
    (low,) = no_share_text(Polynomial({"1": 10.0, "X1": 20.0}), FACTORS, held=held, reach=reach)
    assert "reaches -20.0 % at foam 7 mm, age " in low
    assert "contours are grey" in low
    (both,) = no_share_text(Polynomial({"1": 50.0, "X1": 40.0}), FACTORS, held=held, reach=reach)
    assert "reaches -10.0 % at foam 7 mm" in both
    assert "and 110.0 % at foam 13 mm" in both


@pytest.mark.parametrize(("limits", "ends"), [((0.0, 100.0), (0.0, 40.0)), (None, (-20.0, 40.0))])
def test_the_colours_of_a_share_end_where_it_does(
    limits: tuple[float, float] | None, ends: tuple[float, float]
) -> None:
    figure = contours(Polynomial({"1": 10.0, "X1": 20.0}), FACTORS, response="S, %", held=[0.0] * 3, reach=[1.5] * 3,
                      limits=limits)  # fmt: skip
    assert figure.axes[-1].get_ylim() == pytest.approx(ends)


def test_a_sign_is_filled_only_on_the_slice_that_holds_its_point_and_the_legend_has_its_response() -> None:
    """The best point is held; the other differs from it in the third factor only."""
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
    """The texts of the legend of a figure."""
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def test_the_line_beside_the_runs_has_a_name() -> None:
    figure = observed_against_predicted(np.array([1.0, 2.0]), np.array([1.1, 1.9]), response="S, %", r2=0.9)
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["observed = predicted"]


def test_pictures_of_a_fit_say_first_where_it_leaves_a_share() -> None:
    parts = fit_pictures("s", of({"1": 10.0, "X1": 20.0}), FACTORS, response="S, %", marks={}, held=np.zeros(3))
    assert [type(part) for part in parts] == [str, Picture, Picture]


def test_nothing_is_shown_as_minus_nothing() -> None:
    assert Table("t", "T", ("a", "b"), ((-0.004, -0.006),)).shown() == [("0.00", "-0.01")]
