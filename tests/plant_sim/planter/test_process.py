"""Tests of the figures of a fall: stages, positions of the parts and animation."""

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Polygon
from PIL import Image, ImageSequence

from plant_sim.common.figure_style import drawing
from plant_sim.planter.contact import FallFrame
from plant_sim.planter.drawing.process import process_figure, write_process
from plant_sim.planter.parameters import load_planter

PLANTER = load_planter()
TIPPING = [
    FallFrame(-0.04 + 0.001 * i, 0.0005 * i, 0.0004 * i, 0.01, 0.0, min(math.pi / 2, 0.005 * i)) for i in range(400)
]
"""Frames of a block that rotates about the middle of its base until it lies on the ground."""


def test_stages_show_the_start_the_end_and_the_tilt() -> None:
    with drawing():
        figure = process_figure(TIPPING, PLANTER, title="title")
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[0] == "-40 ms, stem at 0°"
    assert titles[-1] == "+359 ms, stem at 90°"
    cube, stem, _ = (patch for patch in figure.axes[-1].patches if isinstance(patch, Polygon))
    edge, height = PLANTER.block.edge_m, PLANTER.block.height_m
    corners = cube.get_xy()[:4]
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    assert sides == pytest.approx(4 * [edge])
    assert np.ptp(corners, axis=0) == pytest.approx((edge, edge))
    assert stem.get_xy()[:, 0].max() == pytest.approx(0.01 + height), "the stem points forward"


@pytest.mark.nightly
def test_animation_plays_in_slow_motion(tmp_path: Path) -> None:
    path = tmp_path / "fall.gif"
    with drawing():
        write_process(TIPPING[:60], PLANTER, path, title="title")
    with Image.open(path) as animation:
        frames = sum(1 for _ in ImageSequence.Iterator(animation))
        shown_s = frames * animation.info["duration"] / 1000
    assert shown_s == pytest.approx(8 * 0.060, rel=0.1)
