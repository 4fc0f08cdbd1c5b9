"""machine.yaml: what it holds, and how a bad one is refused."""

import dataclasses
import re
from pathlib import Path

import pytest

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from plant_sim.parameters import DEFAULT_MACHINE, MachineError, Value, load_machine
from plant_sim.plant import Plant

MACHINE = load_machine()
TEXT = DEFAULT_MACHINE.read_text(encoding="utf-8")
BORE = 'bore_m: {value: 0.025, unit: m, source: paper, note: "CY1S, Table 1"}'
BORE_LINE = 1 + TEXT[: TEXT.index(BORE)].count("\n")


def complaint(tmp_path: Path, text: str) -> str:
    path = tmp_path / "machine.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MachineError) as caught:
        load_machine(path)
    said = str(caught.value)
    assert "\n" not in said
    assert said.startswith(f"{path}:")
    return said.removeprefix(f"{path}:")


def test_the_machine_is_the_one_of_the_papers() -> None:
    machine = load_machine()
    assert machine.slide.stroke_m == 0.600
    assert machine.lift.stroke_m == 0.150
    assert (machine.slide.bore_m, machine.lift.bore_m, machine.claws.bore_m) == (0.025, 0.050, 0.016)
    assert machine.supply.pressure_pa == 0.50e6
    assert machine.spreader.speed_m_s == pytest.approx(0.200)
    assert machine.cups.planting_frequency_per_min == 45
    assert machine.layout.row_spacing_m == 0.600
    assert (machine.crop.foam_thickness_mm, machine.crop.seedling_age_d, machine.crop.claw_pressure_mpa) == (
        10,
        51,
        0.40,
    )


def test_speeds_are_the_throttle_times_a_bar_over_the_area_that_is_emptied() -> None:
    """0.735e-9 * 1e5 / 490.87e-6 = 0.1497; 3.5e-9 * 1e5 / 1649.3e-6 = 0.2122; 4.1e-9 * 1e5 / 1963.5e-6 = 0.2088."""
    machine = load_machine()
    speeds_m_s = (machine.slide.speed_m_s, machine.lift.extend_m_s, machine.lift.retract_m_s)
    assert speeds_m_s == pytest.approx((0.1497, 0.2122, 0.2088), abs=0.0001)


def test_a_machine_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        load_machine().slide.stroke_m = 1.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (BORE.replace("bore_m", "bor_m"), "slide.bor_m: is no parameter of the machine; did you mean bore_m?"),
        (BORE.replace("0.025", "25 mm"), "slide.bore_m: must be a number, not '25 mm'; powers of ten as 1.0e-9"),
        (BORE.replace("0.025", "1e-2"), "slide.bore_m: must be a number, not '1e-2'; powers of ten as 1.0e-9"),
        (BORE.replace("0.025", "true"), "slide.bore_m: must be a number, not True"),
        (BORE.replace("0.025", "[1]"), "slide.bore_m: must be a number, or true or false, not [1]"),
        (BORE.replace("0.025", "-0.025"), "slide.bore_m: must lie within 0.006 to 0.2, not -0.025"),
        (BORE.replace("0.025", ".nan"), "slide.bore_m: must lie within 0.006 to 0.2, not nan"),
        (BORE.replace("unit: m", "unit: mm"), "slide.bore_m: must have unit m, not mm"),
        (BORE.replace("unit: m,", ""), "slide.bore_m: has no unit"),
        (
            BORE.replace("paper", "guess"),
            "slide.bore_m: must have source 'paper', 'catalogue', 'computed' or 'assumed', not 'guess'",
        ),
        (
            BORE.replace("note", "remark"),
            "slide.bore_m: has no field remark; there are value, unit, source, note",
        ),
        (BORE.replace("unit", "value: 0.03, unit"), "slide.bore_m.value: is there twice; delete one"),
        (
            BORE.replace("0.025", "!metres 1"),
            "slide.bore_m: holds something that is neither number, text nor true or false",
        ),
        ("bore_m: 0.025", "slide.bore_m: must be a mapping: a key and a colon a line"),
    ],
)
def test_a_bad_line_is_refused_with_its_number_and_its_key(tmp_path: Path, line: str, said: str) -> None:
    assert complaint(tmp_path, TEXT.replace(BORE, line)) == f"{BORE_LINE}: {said}"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (f"  {BORE}\n", "", "slide.bore_m: is missing; add it"),
        ("\nslide:", "\nslid:", "slid: is no section of the machine; did you mean slide?"),
        ("value: 10, unit: ms", "value: 10.0, unit: ms", "simulation.look_ms: must be a whole number, not 10.0"),
        ("value: false", "value: 0", "layout.arms_may_meet_in_plant: must be true or false, not 0"),
        (
            "0.187",
            "0.170",
            "spreader.travel_m: spreads the claws to 0.05845 m; it must be cups.pitch_m to a millimetre",
        ),
        (
            "value: 0.600, unit: m, source: paper",
            "value: 0.200, unit: m, source: paper",
            "slide.stroke_m: is too short",
        ),
        (
            "value: 0.130",
            "value: 0.150",
            "handling.stem_clearance_rise_m: must be less than lift.stroke_m, or no arm ever clears the seedlings",
        ),
        ("layout:", "layout: [", "not YAML"),
    ],
)
def test_a_bad_file_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in TEXT
    assert said in complaint(tmp_path, TEXT.replace(old, new, 1))


@pytest.mark.parametrize("text", ["", "3", "[]", "slide: 3", "{", "\x07"])
def test_what_is_no_parameter_file_at_all_is_refused(tmp_path: Path, text: str) -> None:
    assert complaint(tmp_path, text).startswith("1: ")


def test_a_section_that_is_missing_is_named(tmp_path: Path) -> None:
    start, end = TEXT.index("valve:"), TEXT.index("slide:")
    assert complaint(tmp_path, TEXT[:start] + TEXT[end:]) == "1: valve: is missing; add the section"


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "none.yaml", "No such file"), (tmp_path, "directory")):
        with pytest.raises(MachineError, match=reason):
            load_machine(path)
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"\xff")
    with pytest.raises(MachineError, match="not UTF-8"):
        load_machine(latin)


def test_values_can_be_changed_by_name() -> None:
    machine = load_machine()
    changed = machine.with_values({"cups.planting_frequency_per_min": 60, "slide.brake_n": 0.0})
    assert changed.cups.planting_frequency_per_min == 60.0
    assert changed.slide == dataclasses.replace(machine.slide, brake_n=0.0)
    assert machine.cups.planting_frequency_per_min == 45.0
    assert machine.with_values({}) == machine


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("cups.frequency", 60, "cups.frequency: is no parameter of the machine"),
        ("cup.pitch_m", 60, "cup.pitch_m: is no section of the machine; did you mean cups?"),
        ("cups", 60, "cups: is no dotted name; write section.parameter"),
        ("cups.pitch_m", True, "cups.pitch_m: must be a number, not True"),
        ("cups.pitch_m", -1, "cups.pitch_m: must lie within 0.02 to 0.5, not -1"),
        ("cups.pitch_m", 0.055, "spreader.travel_m: spreads the claws to 0.06 m"),
        ("simulation.look_ms", 2.5, "simulation.look_ms: must be a whole number"),
        ("simulation.step_s", 0.3e-3, "simulation.step_s: must divide a millisecond: 1.0e-3, 0.5e-3"),
        ("slide.throttle_conductance_m3_s_pa", 4e-11, "slide.throttle_conductance_m3_s_pa: gives 0.00815 m/s; it must"),
        ("slide_port.dead_volume_m3", 4e-6, "slide.overtravel_m: takes more than half of slide_port.dead_volume_m3"),
        ("slide_friction.static_n", 19.0, "slide_friction.static_n: must be at least coulomb_n"),
        ("lift.rod_m", 0.05, "lift.rod_m: must be thinner than the bore"),
        ("lift.retract_conductance_m3_s_pa", 2e-8, "lift.retract_conductance_m3_s_pa: gives 1.02 m/s; it must give"),
        ("supply.compressor_off_pa", 0.6e6, "supply.compressor_off_pa: must exceed compressor_on_pa"),
        ("supply.pressure_pa", 0.65e6, "supply.pressure_pa: must be less than compressor_on_pa"),
        ("spreader.friction_n", 481.0, "spreader.friction_n: holds the motor, which gives 480 N at most"),
        ("conveyor.acceleration_m_s2", 12.0, "conveyor.torque_nm: gives 162 N at full speed and 192 N are needed"),
        ("conveyor.outlet_past_beam_m", 5.0, "conveyor.outlet_past_beam_m: makes room for 11 trays on the belt"),
        ("cups.plug_m", 0.07, "cups.plug_m: must be narrower than the mouth of a cup"),
    ],
)
def test_a_bad_change_is_refused(name: str, value: Value, said: str) -> None:
    with pytest.raises(MachineError) as caught:
        MACHINE.with_values({name: value})
    assert str(caught.value).startswith(said)


NUMBERS = [
    f"{section.name}.{field.name}"
    for section in dataclasses.fields(MACHINE)
    for field in dataclasses.fields(getattr(MACHINE, section.name))
    if field.type is not bool
]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [-1_000_000, 1_000_000_000])
def test_no_parameter_takes_just_any_number(name: str, value: int) -> None:
    with pytest.raises(MachineError):
        MACHINE.with_values({name: value})


PARAMETER = re.compile(r"^  (\w+): \{value: [^,]+, unit: ([^,]+),", re.MULTILINE)
ONE_OF_EACH_UNIT = {found[2].strip('"'): found for found in PARAMETER.finditer(TEXT)}


@pytest.mark.parametrize("unit", ONE_OF_EACH_UNIT)
def test_a_unit_is_what_the_name_ends_in(tmp_path: Path, unit: str) -> None:
    found = ONE_OF_EACH_UNIT[unit]
    spoilt = TEXT[: found.start(2)] + "furlong" + TEXT[found.end(2) :]
    line = 1 + TEXT[: found.start(1)].count("\n")
    said = complaint(tmp_path, spoilt)
    assert said.startswith(f"{line}: ")
    assert said.endswith(f".{found[1]}: must have unit {unit}, not furlong")


def test_there_are_parameters_in_many_units() -> None:
    assert {"m3/(s Pa)", "N s/m", "N m/Pa", "W/(m2 K)", "kg m2", "V s/m", "-"} < set(ONE_OF_EACH_UNIT)


def test_the_machine_of_the_repository_is_within_its_ratings() -> None:
    assert MACHINE.warnings == []


@pytest.mark.parametrize(
    ("values", "warning"),
    [
        (
            {"supply.pressure_pa": 0.72e6, "supply.compressor_on_pa": 0.8e6, "supply.compressor_off_pa": 0.9e6},
            "supply.pressure_pa: 0.72 MPa is outside the rating of the CY1S slide, 0.18 to 0.7 MPa",
        ),
        (
            {"supply.pressure_pa": 0.15e6},
            "supply.pressure_pa: 0.15 MPa is outside the rating of the CY1S slide, 0.18 to 0.7 MPa",
        ),
        (
            {"slide.magnet_holds_n": 200.0},  # 200 N / 490.87 mm2
            "supply.pressure_pa: 0.5 MPa is outside the rating of the CY1S slide, 0.18 to 0.407 MPa",
        ),
        (
            {"rating.lift_pa": 0.45e6},
            "supply.pressure_pa: 0.5 MPa is outside the rating of the SC50 lift, 0 to 0.45 MPa",
        ),
        (
            {"crop.claw_pressure_mpa": 0.62},
            "crop.claw_pressure_mpa: 0.62 MPa is outside the rating of the MHC2 claws, 0.1 to 0.6 MPa",
        ),
        (
            {"crop.claw_pressure_mpa": 0.58, "supply.compressor_on_pa": 0.57e6},
            "crop.claw_pressure_mpa: 0.58 MPa is more than the receiver always holds behind the check valve of the "
            "claws, 0.565 MPa; raise supply.compressor_on_pa",
        ),
        (
            {"slide.throttle_conductance_m3_s_pa": 2.5e-9, "slide.recouples_m_s": 0.6},
            "slide.throttle_conductance_m3_s_pa: 0.509 m/s is outside the rating of the CY1S slide, 0.05 to 0.4 m/s",
        ),
        (
            {"slide.throttle_conductance_m3_s_pa": 0.2e-9},
            "slide.throttle_conductance_m3_s_pa: 0.0407 m/s is outside the rating of the CY1S slide, 0.05 to 0.4 m/s",
        ),
        (
            {"slide.recouples_m_s": 0.1},
            "slide.recouples_m_s: 0.1 m/s is less than the speed of the piston, 0.15 m/s: "
            "a carriage that is lost is never caught again",
        ),
        (
            {"lift.extend_conductance_m3_s_pa": 1.4e-8},
            "lift.extend_conductance_m3_s_pa: 0.849 m/s is outside the rating of the SC50 lift, 0 to 0.8 m/s",
        ),
        (
            {"lift.retract_conductance_m3_s_pa": 1.6e-8},
            "lift.retract_conductance_m3_s_pa: 0.815 m/s is outside the rating of the SC50 lift, 0 to 0.8 m/s",
        ),
    ],
)
def test_what_lies_outside_a_rating_is_warned_about_by_name_and_not_refused(
    values: dict[str, Value], warning: str
) -> None:
    machine = MACHINE.with_values(values)
    assert machine.warnings == [warning]
    Plant(load_io_map(DEFAULT_IO_MAP), machine, seed=1)


@pytest.mark.parametrize("claw_pressure_mpa", [0.1, 0.6])
def test_the_ends_of_a_rating_are_within_it(claw_pressure_mpa: float) -> None:
    assert MACHINE.with_values({"crop.claw_pressure_mpa": claw_pressure_mpa}).warnings == []


@pytest.mark.parametrize(("starts_below_pa", "is_warned"), [(0.606e6, False), (0.604e6, True)])
def test_claws_need_what_the_check_valve_takes_besides(starts_below_pa: float, is_warned: bool) -> None:
    """Claws at 0.6 MPa behind a check valve that opens at 5 kPa."""
    values: dict[str, Value] = {"crop.claw_pressure_mpa": 0.6, "supply.compressor_on_pa": starts_below_pa}
    assert bool(MACHINE.with_values(values).warnings) is is_warned


def test_switches_that_could_contradict_each_other_are_refused() -> None:
    with pytest.raises(MachineError, match=r"slide.switch_band_m: lets the switches of two pick positions be on"):
        MACHINE.with_values(
            {"slide.switch_band_m": 0.015, "slide.switch_hysteresis_m": 0.003, "handling.cell_pitch_m": 0.035}
        )
    for section in ("lift", "spreader"):
        stroke = "stroke_m" if section == "lift" else "travel_m"
        with pytest.raises(MachineError, match=rf"{section}.switch_band_m: lets both end switches be on at once"):
            MACHINE.with_values(
                {f"{section}.switch_band_m": 0.016, f"{section}.switch_hysteresis_m": 0.0, f"{section}.{stroke}": 0.03}
            )
