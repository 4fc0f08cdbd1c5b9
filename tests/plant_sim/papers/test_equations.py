"""Equations and statements of the papers, written out independently of the code that calculates them."""

from __future__ import annotations

import functools
import re
from math import cos, pi, sin
from pathlib import Path
from typing import Final

import pytest

from plant_sim.common.defaults import DEFAULT_PLANTER
from plant_sim.common.paper_sheet import equation
from plant_sim.planter.contact import drop
from plant_sim.planter.motion import Motion
from plant_sim.planter.motion_model import MotionModel
from plant_sim.planter.parameters import load_planter
from plant_sim.planter.verdict import FallVerdict, verdict_of
from plant_sim.study.paper_tables import cabbage_settings
from tests.plant_sim.papers.claims import run


def test_the_rates_of_a_trial_are_those_of_equations_1_to_4_of_the_pepper_paper(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = run("plant_sim trial", tmp_path, capsys)
    losses = [int(found) for found in re.findall(r"(?:picking P|carrying D|throwing T) (\d+)", printed)]
    rates = [float(found) for found in re.findall(r"(?:S|F_p|F_d|F_t) ([\d.]+) %", printed)]
    assert len(losses) == 3
    counts = (144 - sum(losses), *losses)
    assert rates == [round(100 * count / 144, 1) for count in counts]


def test_table_2_of_the_pepper_paper_is_complete(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """22 inputs X0 to X25 and 18 outputs Y0 to Y21, octal; [P] Table 2."""
    run("controller docs --out var/reference", tmp_path, capsys)
    table = (tmp_path / "var/reference/io.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| ([XY][0-7]+) \|", table, re.MULTILINE))
    assert {f"X{number:o}" for number in range(22)} | {f"Y{number:o}" for number in range(18)} <= listed


def printed_equations(motion: Motion, time_s: float) -> tuple[list[float], list[float]]:
    """Return position and speed of the tip by [K] equations 1 to 8 as printed, written out independently."""
    chain, v = motion.chain, motion.speed_m_s
    r, l, h, c = chain.sprocket_radius_m, chain.offset_m, chain.tip_height_m, chain.centre_distance_m  # noqa: E741
    w = motion.chain_m_s / r
    t = time_s
    if t < pi / w:
        at = [v * t - (r + l) * cos(w * t), c - h + (r + l) * sin(w * t)]
        return at, [v + (r + l) * sin(w * t), (r + l) * w * cos(w * t)]
    if t < pi / w + c / (w * r):
        return [v * t + r + l, c - h - w * r * (t - pi / w)], [v, -w * r]
    if t < 2 * pi / w + c / (w * r):
        phase = w * t - (pi + c / r)
        at = [v * t + (r + l) * cos(phase), -h - (r + l) * sin(phase)]
        return at, [v + (r + l) * w * sin(phase), -(r + l) * w * cos(phase)]
    return [v * t - (r + l), -c + w * r * (t - (2 * pi + c / r) / w)], [v, w * r]


@pytest.mark.parametrize("share", [0.02, 0.07, 0.2, 0.4, 0.52, 0.57, 0.7, 0.9])
def test_the_printed_model_is_equations_1_to_8_of_the_cabbage_paper(share: float) -> None:
    chain = load_planter(DEFAULT_PLANTER).chain
    motion = Motion(chain, speed_m_s=1.4 / 3.6, frequency_per_min=56.0, model=MotionModel.PRINTED)
    time_s = share * motion.period_s
    position, velocity = printed_equations(motion, time_s)
    assert motion.position_m(time_s, chain.tip)[0, 0].tolist() == pytest.approx(position, abs=1e-12)
    assert motion.velocity_m_s(time_s, chain.tip)[0, 0].tolist() == pytest.approx(velocity, abs=1e-12)


@pytest.mark.parametrize(
    ("speed_km_h", "verdict", "pushed_mm"),
    [(1.9, FallVerdict.FORWARD, 54.1), (1.65, FallVerdict.PUSHED, 2.1), (1.4, FallVerdict.CLEAN, 0.0)],
)
def test_the_falls_of_figures_7_to_9_of_the_cabbage_paper(
    speed_km_h: float, verdict: FallVerdict, pushed_mm: float
) -> None:
    planter = load_planter(DEFAULT_PLANTER)
    motion = Motion(planter.chain, speed_m_s=speed_km_h / 3.6, frequency_per_min=56.0, model=MotionModel.RIGID)
    fall = drop(planter, planter.rigid_ground, motion, opener_deg=planter.chain.release_deg)
    assert verdict_of(fall.tilt_deg, fall.pushed_m) == verdict
    assert 1000.0 * fall.pushed_m == pytest.approx(pushed_mm, abs=0.05)


@functools.cache
def coefficients(number: int, response: str) -> dict[str, float]:
    return equation(f"cabbage-equation-{number}", response)


def slope(number: int, response: str, factor: str, at: dict[str, float]) -> float:
    """Return the derivative of equation 10 or 11 with respect to a coded factor."""
    terms = coefficients(number, response)
    value = terms[factor] + 2.0 * terms.get(f"{factor}^2", 0.0) * at.get(factor, 0.0)
    for term, coefficient in terms.items():
        if factor in term.split() and " " in term:
            (other,) = set(term.split()) - {factor}
            value += coefficient * at.get(other, 0.0)
    return value


LEVELS: Final = (-1.0, 0.0, 1.0)


def test_figure_11a_of_the_cabbage_paper() -> None:
    """At the centre force, lodging increases with speed; with frequency it increases, then decreases, except at low
    speed, so it is lowest at the low levels of both.
    """
    assert all(slope(10, "Y1", "X1", {"X2": frequency}) > 0.0 for frequency in LEVELS)
    for speed in (0.0, 1.0):
        assert slope(10, "Y1", "X2", {"X1": speed, "X2": -1.0}) > 0.0 > slope(10, "Y1", "X2", {"X1": speed, "X2": 1.0})
    assert all(slope(10, "Y1", "X2", {"X1": -1.0, "X2": frequency}) > 0.0 for frequency in LEVELS)


def test_figures_11b_and_11c_of_the_cabbage_paper() -> None:
    """Lodging increases with speed and force, slowest at the low levels, and with frequency up to 58.75 per minute."""
    for force in LEVELS:
        assert slope(10, "Y1", "X1", {"X3": force}) >= slope(10, "Y1", "X1", {"X3": -1.0}) > 0.0
        assert slope(10, "Y1", "X3", {"X1": force}) >= slope(10, "Y1", "X3", {"X1": -1.0}) > 0.0
        assert slope(10, "Y1", "X3", {"X2": force}) > 0.0
    assert slope(10, "Y1", "X2", {"X2": 0.75}) == pytest.approx(0.0, abs=1e-12)
    assert "X3^2" not in coefficients(10, "Y1")


def test_figure_11d_of_the_cabbage_paper() -> None:
    """Injury increases linearly with frequency and force, faster with force."""
    terms = coefficients(11, "Y2")
    assert all(slope(11, "Y2", factor, {"X2": at, "X3": at}) > 0.0 for factor in ("X2", "X3") for at in LEVELS)
    assert terms["X3"] > terms["X2"]
    assert not {"X2^2", "X3^2"} & set(terms)


def test_the_stated_setting_of_the_cabbage_paper_violates_equation_12() -> None:
    for setting in cabbage_settings():
        assert (setting.natural[2] - 104.62) / 8.79 == pytest.approx(-1.455, abs=5e-4)
