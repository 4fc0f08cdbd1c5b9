"""Factors of studies: valid names and levels, and the machine of a setting."""

from __future__ import annotations

import pytest

from plant_sim.machine.parameters import load_machine
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting, ratings_exceeded, study_parameter

MACHINE = load_machine()


@pytest.mark.parametrize(
    ("name", "unit", "is_integer", "label"),
    [
        ("crop.foam_thickness_mm", "mm", False, "crop.foam_thickness_mm, mm"),
        ("cups.planting_frequency_per_min", "1/min", False, "cups.planting_frequency_per_min, 1/min"),
        ("cups.pulse_share", "-", False, "cups.pulse_share"),
        ("claws.grippers", "-", True, "claws.grippers"),
        ("layout.arms_may_meet_in_plant", "-", True, "layout.arms_may_meet_in_plant"),
        ("program.release_delay", "ms", True, "program.release_delay, ms"),
        ("program.no_cups", "ms", True, "program.no_cups, ms"),
        ("program.descend_at_count", "-", True, "program.descend_at_count"),
    ],
)
def test_a_name_has_its_unit(name: str, unit: str, is_integer: bool, label: str) -> None:
    found = study_parameter(name, MACHINE)
    assert (found.name, found.unit, found.is_integer, found.label) == (name, unit, is_integer, label)


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("foam_thickness_mm", "unknown factor; did you mean crop.foam_thickness_mm?"),
        ("zzz", "unknown factor; write section.parameter for the machine, or program.SET_POINT"),
        ("crop.foam_thicknes_mm", "unknown parameter of the machine; did you mean foam_thickness_mm?"),
        ("crops.foam_thickness_mm", "unknown section of the machine; did you mean crop?"),
        ("progam.release_delay", "unknown section of the machine; did you mean program?"),
        ("program.releasedelay", "unknown set-point; did you mean release_delay?"),
        ("program.trays_target", "is derived from the number of seedlings; set seedlings instead"),
        ("program.limits", "unknown set-point; use one of step_sequence, "),
        ("crop.extrapolates", "unknown parameter of the machine; use one of "),
        ("picks_m.count", "unknown section of the machine; "),
        ("crop.", "unknown parameter of the machine; "),
    ],
)
def test_an_unknown_name_is_rejected_with_a_remedy(name: str, complaint: str) -> None:
    with pytest.raises(StudyError) as refusal:
        study_parameter(name, MACHINE)
    assert str(refusal.value).startswith(f"{name}: {complaint}")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("name", "text", "level"),
    [
        ("crop.foam_thickness_mm", "1 cm", 10.0),
        ("crop.foam_thickness_mm", "12.5", 12.5),
        ("crop.claw_pressure_mpa", "4 bar", 0.4),
        ("cups.planting_frequency_per_min", "1 /s", 60.0),
        ("program.release_delay", "150 ms", 150.0),
        ("program.release_delay", "15", 150.0),
        ("program.no_cups", "4 s", 4000.0),
        ("program.descend_at_count", "9", 9.0),
        ("layout.arms_may_meet_in_plant", "true", 1.0),
        ("layout.arms_may_meet_in_plant", "false", 0.0),
    ],
)
def test_a_level_can_have_a_unit(name: str, text: str, level: float) -> None:
    assert study_parameter(name, MACHINE).read(text) == pytest.approx(level, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("crop.foam_thickness_mm", "10 MPa", "MPa is a unit of another quantity; use m or cm or mm or um"),
        ("crop.foam_thickness_mm", "10 furlong", "unknown unit furlong"),
        ("crop.foam_thickness_mm", "thick", "not a number"),
        ("crop.foam_thickness_mm", "nan", "not a number"),
        ("program.release_delay", "1.5", "a time requires a unit"),
        ("program.descend_at_count", "9 ms", "ms is a unit of another quantity"),
    ],
)
def test_a_level_of_another_quantity_is_rejected(name: str, text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        study_parameter(name, MACHINE).read(text)


def test_a_setting_changes_only_the_named_parameters() -> None:
    setting = FactorSetting(
        {
            "crop.foam_thickness_mm": 12.5,
            "claws.grippers": 11.0,
            "layout.arms_may_meet_in_plant": 1.0,
            "program.release_delay": 15.0,
        }
    )
    machine = setting.machine(MACHINE)
    assert (machine.crop.foam_thickness_mm, machine.claws.grippers) == (12.5, 11)
    assert machine.layout.arms_may_meet_in_plant is True
    assert isinstance(machine.claws.grippers, int)
    back = {
        "crop.foam_thickness_mm": MACHINE.crop.foam_thickness_mm,
        "claws.grippers": MACHINE.claws.grippers,
        "layout.arms_may_meet_in_plant": False,
    }
    assert machine.with_values(back) == MACHINE
    assert setting.set_points() == {"release_delay": 15}


def test_an_empty_setting_does_not_change_the_machine() -> None:
    assert FactorSetting({}).machine(MACHINE) == MACHINE
    assert FactorSetting({}).set_points() == {}


def test_integer_levels_are_accepted() -> None:
    setting = FactorSetting({"crop.seedling_age_d": 50, "claws.grippers": 12, "program.release_delay": 15})
    assert setting.machine(MACHINE).crop.seedling_age_d == 50.0
    assert setting.set_points() == {"release_delay": 15}


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"crop.foam_thickness_mm": 31.0}, "crop.foam_thickness_mm: must be 0 to 30, not 31"),
        ({"crop.foam_thickness_mm": float("inf")}, "crop.foam_thickness_mm: must be a finite number, not inf"),
        ({"crop.foam": 1.0}, "crop.foam: unknown parameter of the machine; use one of "),
        ({"claws.grippers": 11.5}, "claws.grippers: must be an integer, not 11.5"),
        ({"layout.arms_may_meet_in_plant": 0.5}, "layout.arms_may_meet_in_plant: is a switch and must be 0 or 1"),
        (
            {"handling.cell_pitch_m": 0.05},
            "spreader.travel_m: spreads the claws to 0.067 m; it must equal cups.pitch_m to 1 mm (with "
            "handling.cell_pitch_m = 0.05)",
        ),
    ],
)
def test_an_invalid_machine_is_rejected(values: dict[str, float], complaint: str) -> None:
    with pytest.raises(StudyError) as refusal:
        FactorSetting(values).machine(MACHINE)
    assert str(refusal.value).startswith(complaint)


def test_a_time_of_the_program_is_set_in_its_steps() -> None:
    """A time in ms is converted to the counts of its set-point, which are 10 or 100 ms."""
    assert [
        study_parameter(name, MACHINE).setting(4000.0) for name in ("program.release_delay", "program.no_cups")
    ] == [400, 40]
    assert study_parameter("crop.foam_thickness_mm", MACHINE).setting(12.5) == 12.5


@pytest.mark.parametrize("value", [-1.0, 101.0, 1.5, float("nan")])
def test_an_invalid_set_point_is_rejected(value: float) -> None:
    message = rf"^program.release_delay: must be 0 to 1000 ms in steps of 10 ms, not {10 * value:g} ms$"
    with pytest.raises(StudyError, match=message):
        FactorSetting({"program.release_delay": value}).set_points()
    with pytest.raises(StudyError, match="did you mean release_delay"):
        FactorSetting({"program.release_dely": 1.0}).set_points()


def test_an_exceeded_rating_is_reported_once() -> None:
    high = FactorSetting({"crop.claw_pressure_mpa": 0.62})
    also = FactorSetting({"crop.claw_pressure_mpa": 0.62, "crop.foam_thickness_mm": 12.0})
    found = ratings_exceeded([FactorSetting({}), high, also], MACHINE)
    assert len(found) == 1
    assert found[0].startswith("crop.claw_pressure_mpa: 0.62 MPa is outside the rating of the MHC2 claws")
    assert ratings_exceeded([FactorSetting({})], MACHINE) == []
