"""Tests of the figures of the planter: contents, marks and identical files."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from PIL import Image, ImageSequence

from plant_sim.common.figure_style import FigureError, drawing, save_as
from plant_sim.planter.drawing import gif
from plant_sim.planter.drawing.animation import write_animation, write_regimes_animation, write_scheme_animation
from plant_sim.planter.drawing.paths import motion_figure, regimes_figure, shown_m, window_s
from plant_sim.planter.drawing.scheme import Scheme
from plant_sim.planter.motion_model import MotionModel
from plant_sim.planter.ratio import zero_speed_points
from tests.plant_sim.planter.planter_rig import CHAIN, FREQUENCY_PER_MIN, motion_at


def line_of(axes: Axes, label: str) -> np.ndarray:
    """Return the points of a line, of shape (points, 2)."""
    (line,) = [line for line in axes.lines if line.get_label() == label]
    return np.asarray(line.get_xydata())


def texts_of(figure: Figure) -> set[str]:
    return {text.get_text() for axes in figure.axes for text in axes.texts}


@pytest.mark.parametrize("model", MotionModel)
def test_the_scheme_names_joints_and_dimensions(model: MotionModel) -> None:
    with drawing():
        figure = Scheme(CHAIN, model).figure
    assert {"A", "B", "C", "D", "R = 80 mm", "H = 1.217 m", "h = 200 mm", "l = 30 mm"} <= texts_of(figure)
    hinge_m = line_of(figure.axes[0], "path of the hinge")
    assert hinge_m[0] == pytest.approx(hinge_m[-1], abs=1e-9)
    begin_m = -CHAIN.centre_distance_m if model is MotionModel.PRINTED else -CHAIN.sprocket_radius_m
    height_m = CHAIN.centre_distance_m + CHAIN.sprocket_radius_m - begin_m
    assert np.ptp(hinge_m, axis=0) == pytest.approx((0.160, height_m), abs=0.005)


def test_the_three_paths_have_the_points_of_the_paper() -> None:
    with drawing():
        figure = regimes_figure(CHAIN, frequency_per_min=FREQUENCY_PER_MIN)
    named = [{text.get_text(): text.xy for text in axes.texts if isinstance(text, Annotation)} for axes in figure.axes]
    assert [set(names) for names in named] == [{"c1", "d", "e"}, {"c2"}, {"c3"}]
    lowest, descending, ascending = named[0]["c1"], named[0]["e"], named[0]["d"]
    assert ascending[0] < lowest[0] < descending[0], "the loop runs backward at its lowest point"
    assert lowest[1] < ascending[1] == pytest.approx(descending[1])


@pytest.mark.parametrize(("speed_km_h", "count"), [(1.9, 0), (1.65, 0), (1.4, 2)])
def test_the_motion_is_drawn_with_its_points_of_zero_speed(speed_km_h: float, count: int) -> None:
    motion = motion_at(speed_km_h)
    with drawing():
        figure = motion_figure(motion, title="")
    paths, speeds = figure.axes
    times_s = np.linspace(*window_s(motion), 401)
    for name, offset in {"hinge": (0.0, 0.0), "tip": CHAIN.tip, "guide plate": CHAIN.guide}.items():
        np.testing.assert_array_equal(line_of(paths, name), shown_m(motion, times_s, offset))
    lowest_m = shown_m(motion, motion.time_at_s(90.0), (0.0, 0.0))[0]
    assert lowest_m == pytest.approx((0.0, -CHAIN.sprocket_radius_m), abs=1e-12)
    marked = [line for line in paths.lines if line.get_label() == "zero horizontal speed"]
    assert sum(len(np.asarray(line.get_xydata())) for line in marked) == 3 * count
    phases_deg = {float(np.asarray(line.get_xdata())[0]) for line in speeds.lines if line.get_marker() == "o"}
    assert phases_deg == {point.phase_deg for point in zero_speed_points(motion)}


@pytest.mark.nightly
def test_equal_figures_give_identical_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gif, "FRAMES_PER_S", 1)
    for name in ("a", "b"):
        with drawing():
            save_as(motion_figure(motion_at(1.4), title="title"), tmp_path / f"{name}.svg")
            save_as(motion_figure(motion_at(1.4), title="title"), tmp_path / f"{name}.png")
            write_animation(motion_at(1.4), tmp_path / f"{name}.gif", title="title")
    for ending in ("svg", "png", "gif"):
        assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()
    assert len(list(tmp_path.iterdir())) == 6
    with Image.open(tmp_path / "a.gif") as image:
        frames = sum(1 for _ in ImageSequence.Iterator(image))
        assert image.info["duration"] == pytest.approx(1000, abs=10)
    first_s, last_s = window_s(motion_at(1.4))
    assert frames == pytest.approx((last_s - first_s) * 4, abs=1)


def test_an_unwritable_file_is_one_line_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    figure = Figure()
    for path in (tmp_path / "none" / "a.png", tmp_path / "file" / "a.svg"):
        with pytest.raises(FigureError, match=r"a\.\w+: cannot be written \(.*\); specify another path$"):
            save_as(figure, path)
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(FigureError, match=r"folder\.png: cannot be written"):
        save_as(figure, tmp_path / "folder.png")
    assert {path.name for path in tmp_path.iterdir()} == {"file", "folder.png"}


def test_scheme_moves_every_planter_to_the_place_of_the_next_one() -> None:
    """The animation may repeat after one spacing, because the planters cannot be told apart."""
    with drawing():
        scheme = Scheme(CHAIN)
    spacing_s = scheme.motion.period_s / CHAIN.planters
    places = []
    for time_s in (0.0, spacing_s / 2, spacing_s):
        hinges = scheme.place(time_s)[0]
        assert isinstance(hinges, Line2D)
        places.append(sorted(map(tuple, np.round(np.asarray(hinges.get_xydata()), 9).tolist())))
    assert np.asarray(places[0]) == pytest.approx(np.asarray(places[2]))
    assert np.abs(np.subtract(places[0], places[1])).max() > 0.05
    assert len(places[0]) == CHAIN.planters


@pytest.mark.nightly
def test_figures_3_and_4_are_animated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gif, "FRAMES_PER_S", 4)
    with drawing():
        write_scheme_animation(CHAIN, tmp_path / "3.gif", model=MotionModel.RIGID)
        write_regimes_animation(CHAIN, tmp_path / "4.gif", frequency_per_min=FREQUENCY_PER_MIN, model=MotionModel.RIGID)
    for name, duration_s in (("3.gif", 1.0), ("4.gif", 4 * 0.55)):
        with Image.open(tmp_path / name) as image:
            frames = [np.asarray(frame.convert("L"), dtype=int) for frame in ImageSequence.Iterator(image)]
        assert len(frames) == pytest.approx(4 * duration_s, abs=1)
        assert all(np.abs(after - before).max() > 50 for before, after in pairwise(frames)), name
