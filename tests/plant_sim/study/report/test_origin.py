"""Statements of what was fitted to what, and of a changed machine, on the first page of the reports of the twin."""

from __future__ import annotations

from pathlib import Path

from plant_sim.machine.parameters import load_machine
from plant_sim.study.report.origin import changed_keys, origin_parts

DELIVERED = load_machine()


def test_the_delivered_machine_has_no_changed_parameter() -> None:
    assert changed_keys(DELIVERED) == []
    (fitted,) = origin_parts(DELIVERED)
    assert fitted.startswith("What was fitted to what: the constants of the twin's seedlings were fitted to equation 5")
    assert "is in-sample" in fitted


def test_changed_parameters_are_named_before_anything_else() -> None:
    """Five are named and the others are counted."""
    one = DELIVERED.with_values({"seedling.adhesion_n": 2.0})
    assert changed_keys(one) == ["seedling.adhesion_n"]
    changed, fitted = origin_parts(one)
    assert changed.startswith("Changed machine: seedling.adhesion_n differs from the delivered machine")
    assert fitted.startswith("What was fitted to what")
    names = ("cut_n", "cut_sd", "cut_age", "endurance", "crown_m", "sway_m", "stick_m")
    (from_file, _) = origin_parts(one, Path("mine/sticky.yaml"))
    assert from_file.startswith("Changed machine (mine/sticky.yaml): seedling.adhesion_n differs")
    assert len(origin_parts(DELIVERED, Path("mine/same.yaml"))) == 1
    many = DELIVERED.with_values({f"seedling.{name}": 1.01 * getattr(DELIVERED.seedling, name) for name in names})
    assert len(changed_keys(many)) == 7
    assert " and 2 others differ from the delivered machine" in origin_parts(many)[0]
