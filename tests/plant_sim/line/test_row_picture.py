"""Picture of the rows: every position is shown, and no legend or note covers data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from plant_sim.common.figure_data import drawn_marks
from plant_sim.common.figure_style import drawing
from plant_sim.common.picture_form import PictureForm
from plant_sim.line.command import line_result
from plant_sim.line.file import find_line
from plant_sim.line.result import LineResult
from plant_sim.line.write import row_picture, write_result

CABBAGE = find_line("cabbage").read_text(encoding="utf-8")


def row(tmp_path: Path, metres: float, spacing: str = "42 cm") -> LineResult:
    (tmp_path / "line.yaml").write_text(CABBAGE.replace("42 cm", spacing), encoding="utf-8")
    return line_result(str(tmp_path / "line.yaml"), metres=metres, seed=1, repeat=1)


def picture(done: LineResult) -> Figure:
    with drawing():
        return row_picture(done)


@pytest.mark.parametrize("metres", [3.0, 60.0, 600.0])
def test_every_position_of_a_row_is_shown_once(metres: float, tmp_path: Path) -> None:
    """Lines of 25 m, or up to 20 longer ones, contain all plants and gaps at their positions."""
    done = row(tmp_path, metres)
    marks = [mark for mark in drawn_marks(picture(done)) if mark.panel == 1]
    assert len(marks) == done.rows[0].released
    length_m = max(25.0, metres / 20)
    lines = np.unique([mark.y for mark in marks if mark.y is not None]).tolist()
    shown_m = sorted(
        mark.x + length_m * lines.index(mark.y) for mark in marks if mark.x is not None and mark.y is not None
    )
    planted = done.rows[0].planted
    expected_m = np.where(planted, done.rows[0].position_m, done.rows[0].travel_m)
    assert shown_m == pytest.approx(np.sort(expected_m), abs=1e-6)
    assert min(mark.x for mark in marks if mark.x is not None) > -0.5
    assert max(mark.x for mark in marks if mark.x is not None) < 1.02 * length_m


def test_a_scraped_plant_looks_different(tmp_path: Path) -> None:
    done = row(tmp_path, 100.0, "55 cm")
    labels = [mark.label for mark in drawn_marks(picture(done)) if mark.panel == 1]
    scraped = int(np.count_nonzero(done.rows[0].scraped))
    assert sum(label.endswith(", scraped") for label in labels) == scraped > 100


def test_a_long_row_is_shown_as_the_shares_of_its_sections(tmp_path: Path) -> None:
    """A row of 5 km has 50 sections, whose shares add up to 100 %."""
    marks = [mark for mark in drawn_marks(picture(row(tmp_path, 5_000.0))) if mark.panel == 1]
    tops: dict[float, float] = {}
    for mark in marks:
        assert mark.x_low is not None
        assert mark.y_high is not None
        tops[mark.x_low] = max(tops.get(mark.x_low, 0.0), mark.y_high)
    assert len(tops) == 50
    assert list(tops.values()) == pytest.approx([100.0] * 50)


def test_neither_legend_nor_note_covers_data(tmp_path: Path) -> None:
    with drawing():
        figure = row_picture(row(tmp_path, 60.0))
        figure.draw_without_rendering()
    for axes in (each for part in figure.subfigs for each in part.axes):
        panel = axes.get_window_extent()
        legend = axes.get_legend()
        for text in [*axes.texts, *([] if legend is None else [legend])]:
            assert text.get_window_extent().y0 >= panel.y1
    legends = [axes.get_legend() for part in figure.subfigs for axes in part.axes]
    assert any(legend is not None for legend in legends)


@pytest.mark.nightly
def test_the_picture_has_the_formats_and_the_resolution_of_the_options(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_result(row(tmp_path, 5.0), out, form=PictureForm(("pdf",)))
    assert sorted(path.name for path in out.glob("rows.*")) == ["rows.data.csv", "rows.pdf"]
    assert (out / "rows.pdf").read_bytes().startswith(b"%PDF")
