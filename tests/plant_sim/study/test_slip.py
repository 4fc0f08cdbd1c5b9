"""Study of the spacing over the slip: closed form, both drives, one quantity."""

from __future__ import annotations

import json

import pytest

from plant_sim.line.file import DriveEntry, LineFile, find_line, load_line
from plant_sim.machine.parameters import load_machine
from plant_sim.study.slip import LINE, MEANS, SDS, slip_point, slip_study

CABBAGE = load_line(find_line(LINE)).values
MOTOR = CABBAGE.model_copy(update={"drive": DriveEntry.model_validate({"kind": "own_motor", "lag": "0.5 s"})})
MACHINE = load_machine()


@pytest.mark.parametrize(("line", "sd"), [(CABBAGE, 0.0), (CABBAGE, 0.02), (CABBAGE, 0.04), (MOTOR, 0.04)])
def test_scatter_of_the_spacing_agrees_with_the_closed_form(line: LineFile, sd: float) -> None:
    point = slip_point(line, MACHINE, mean=0.12, sd=sd, seed=3, metres=800)
    assert point.precision == pytest.approx(point.expected, rel=0.08)
    assert (point.precision > 0.01) == (line is CABBAGE and sd > 0.0)


def test_spacing_and_ratio_are_one_quantity() -> None:
    """The product of spacing and lambda is the distance of the planters on the chain."""
    for mean in (0.0, 0.10):
        point = slip_point(CABBAGE, MACHINE, mean=mean, sd=0.0, seed=1, metres=200)
        assert point.ratio_low == pytest.approx(point.ratio_high)
        assert point.spacing_m * point.ratio_low == pytest.approx(0.4893, abs=2e-4)
        assert point.spacing_m == pytest.approx(
            CABBAGE.spacing * (1 - CABBAGE.drive.set_for_slip) / (1 - mean), rel=2e-3
        )


def test_report_has_every_point_and_is_reproducible() -> None:
    study = slip_study(MACHINE, seed=2, metres=30)
    assert study.json() == slip_study(MACHINE, seed=2, metres=30).json()
    assert str(study.parts[1]).startswith("What was fitted to what: ")
    points = json.loads(study.json())["points"]
    assert len(points) == len(MEANS) * len(SDS) + 2
    assert [point["drive"] for point in points[-2:]] == ["motor", "motor"]
