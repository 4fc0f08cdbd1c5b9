"""Figures of a study."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from controller.common.document.parts import Picture
from plant_sim.study.report.study import Study


def figures_of(study: Study) -> dict[str, Figure]:
    """Return the Matplotlib figures of the pictures by name, in order."""
    drawn = {part.name: part.figure for part in study.parts if isinstance(part, Picture)}
    return {name: figure for name, figure in drawn.items() if isinstance(figure, Figure)}


def axes_of(picture: Picture) -> list[Axes]:
    """Return the panels of a picture."""
    assert isinstance(picture.figure, Figure)
    return picture.figure.axes
