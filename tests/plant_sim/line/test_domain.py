"""Domain of the models: each kind of extrapolation is counted, and told in the first lines."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from plant_sim.line.command import line_result
from plant_sim.line.file import find_line
from plant_sim.line.judge.domain import domain_notes
from plant_sim.line.result import LineResult

CABBAGE = find_line("cabbage").read_text(encoding="utf-8")
WITHIN = {'sd: "1 %, assumed"': "sd: 0 %", '"1.5 km/h, paper"': "1.6 km/h", "42 cm, assumed": "46 cm"}
"""Changes of the cabbage line after which nothing is extrapolated."""


def result(tmp_path: Path, changes: dict[str, str], metres: float = 60.0) -> LineResult:
    """Return a row of the cabbage line with texts of its file replaced."""
    text = CABBAGE
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    (tmp_path / "line.yaml").write_text(text, encoding="utf-8")
    return line_result(str(tmp_path / "line.yaml"), metres=metres, seed=1, repeat=1)


def test_a_line_within_the_tested_ranges_says_so(tmp_path: Path) -> None:
    """At 1.6 km/h and 46 cm, λ is 1.06 and the planting frequency 58.0/min, the centre of the bench test."""
    done = result(tmp_path, WITHIN)
    assert done.domain == ()
    assert done.text().splitlines()[1] == "nothing is extrapolated beyond the tested range of a model"
    assert done.record()["domain"] == []


@pytest.mark.parametrize(
    ("name", "beyond", "old", "new"),
    [
        ("lambda", "0.7 to 1.8", "42 cm, assumed", "80 cm"),
        ("frequency", "30 to 66/min", '"1.5 km/h, paper"', "0.8 km/h"),
        ("injury", "bench test", '"1.5 km/h, paper"', "0.8 km/h"),
        ("clamp", "89.84 to 119.40 N", "91.83 N, paper", "60 N"),
        ("slip", "-50 to 90 %", 'sd: "1 %, assumed"', "sd: 60 %"),
    ],
)
def test_each_extrapolation_is_counted_and_told_first(
    name: str, beyond: str, old: str, new: str, tmp_path: Path
) -> None:
    done = result(tmp_path, WITHIN | {old: new})
    (note,) = (note for note in done.domain if note.name == name)
    assert beyond in note.text
    if name == "slip":
        assert 0 < note.number < note.total
    else:
        assert (note.number, note.total) == (done.plants, done.plants)
    assert note.line() in done.text().splitlines()[1 : 1 + len(done.domain)]
    assert note.record() in json.loads(json.dumps(done.record()))["domain"]


def test_the_crop_and_the_ground_speed_sensor_of_the_arms_are_told(tmp_path: Path) -> None:
    run = result(tmp_path, WITHIN, metres=10.0).run
    plants = run.rows[0].single
    notes = domain_notes(dataclasses.replace(run, is_crop_extrapolated=True, sensor=(5, 100)), None)
    assert {note.name: (note.number, note.total) for note in notes} == {
        "crop": (plants, plants),
        "ground_speed_sensor": (5, 100),
    }
    assert domain_notes(dataclasses.replace(run, sensor=(0, 100)), None) == ()


def test_spacing_at_a_large_scatter_of_the_slip_has_the_mean_of_the_file(tmp_path: Path) -> None:
    """With the gear set for 2 % and slip of 2 % with an SD of 5 %, 42.0 cm are planted, and nothing is limited."""
    done = result(
        tmp_path,
        {"set_for_slip: 5 %": "set_for_slip: 2 %", 'mean: "5 %, assumed", sd: "1 %, assumed"': "mean: 2 %, sd: 5 %"},
        metres=10_000.0,
    )
    positions_m = np.concatenate([row.travel_m for row in done.rows])
    assert np.diff(positions_m).mean() == pytest.approx(0.42, abs=4 * 0.42 * 0.05 / 100)
    assert "slip" not in [note.name for note in done.domain]
