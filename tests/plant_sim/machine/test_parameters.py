"""Contents of machine.yaml, and rejection of invalid files."""

import dataclasses
import re
from pathlib import Path

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.common.parameter_file import Value
from plant_sim.machine.parameters import MachineError, load_machine
from plant_sim.machine.plant import Plant
from plant_sim.machine.time_step import steps_per_ms_by_key

MACHINE = load_machine()
TEXT = DEFAULT_MACHINE.read_text(encoding="utf-8")
BORE = 'bore_m: {value: 0.025, unit: m, source: paper, note: "CY1S, Table 1"}'
BORE_LINE = 1 + TEXT[: TEXT.index(BORE)].count("\n")
FIRST_LINE = 1 + TEXT[: TEXT.index("simulation:")].count("\n")
NUMBER = "write a number (powers of ten as 1.0e-9), true or false"


def complaint(tmp_path: Path, text: str) -> str:
    path = tmp_path / "machine.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MachineError) as caught:
        load_machine(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{path}:")
    return message.removeprefix(f"{path}:")


def test_the_machine_matches_the_papers() -> None:
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


def test_speeds_are_conductance_times_reference_pressure_over_the_exhaust_area() -> None:
    """The speeds follow from 0.735e-9 * 1e5 / 490.87e-6, 3.5e-9 * 1e5 / 1649.3e-6 and 4.1e-9 * 1e5 / 1963.5e-6, m/s."""
    machine = load_machine()
    speeds_m_s = (machine.slide.speed_m_s, machine.lift.extend_m_s, machine.lift.retract_m_s)
    assert speeds_m_s == pytest.approx((0.1497, 0.2122, 0.2088), abs=0.0001)


def test_a_machine_is_immutable() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        load_machine().slide.stroke_m = 1.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (BORE.replace("bore_m", "bor_m"), "slide.bor_m: unknown key; did you mean bore_m?"),
        (BORE.replace("0.025", "25 mm"), f"slide.bore_m.value: cannot be '25 mm'; {NUMBER}"),
        (BORE.replace("0.025", "1e-2"), f"slide.bore_m.value: cannot be '1e-2'; {NUMBER}"),
        (BORE.replace("0.025", "true"), "slide.bore_m: cannot be true; write a number"),
        (BORE.replace("0.025", "[1]"), f"slide.bore_m.value: cannot be a list; {NUMBER}"),
        (BORE.replace("0.025", "-0.025"), "slide.bore_m: must be 0.006 to 0.2, not -0.025"),
        (BORE.replace("0.025", ".nan"), "slide.bore_m: must be 0.006 to 0.2, not nan"),
        (BORE.replace("unit: m", "unit: mm"), "slide.bore_m: must have unit m, not mm"),
        (
            BORE.replace("unit: m,", ""),
            "slide.bore_m.unit: is missing; write the unit that matches the name suffix, or - for none, in quotes",
        ),
        (
            BORE.replace("paper", "guess"),
            "slide.bore_m.source: cannot be 'guess'; write paper, catalogue, computed or assumed",
        ),
        (
            BORE.replace("note", "remark"),
            "slide.bore_m.remark: unknown key; use one of value, unit, source, note",
        ),
        (
            BORE.replace("unit", "value: 0.03, unit"),
            f"slide.bore_m: key 'value' is already defined on line {BORE_LINE}; delete one",
        ),
        (
            BORE.replace("0.025", "!metres 1"),
            "slide.bore_m.value: must be a number, text, true or false",
        ),
        ("bore_m: 0.025", "slide.bore_m: cannot be 0.025; write a mapping: a key, a colon and a value per line"),
    ],
)
def test_an_invalid_line_is_rejected_with_its_number_and_key(tmp_path: Path, line: str, message: str) -> None:
    assert complaint(tmp_path, TEXT.replace(BORE, line)) == f"{BORE_LINE}: {message}"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (f"  {BORE}\n", "", "slide.bore_m: is missing; add it"),
        ("\nslide:", "\nslid:", "slid: unknown key; did you mean slide?"),
        ("\nslide:", "\nbanana:", f"{BORE_LINE - 1}: banana: unknown key; use one of simulation, start, rating, "),
        ("\n  bore_m:", "\n  bo.re_m:", f"{BORE_LINE}: slide.bo.re_m: unknown key; did you mean bore_m?"),
        ("value: 10, unit: ms", "value: 10.0, unit: ms", "simulation.look_ms: cannot be 10.0; write an integer"),
        ("value: false", "value: 0", "layout.arms_may_meet_in_plant: cannot be 0; write true or false"),
        (
            "0.187",
            "0.170",
            "spreader.travel_m: spreads the claws to 0.05845 m; it must equal cups.pitch_m to 1 mm",
        ),
        (
            "value: 0.600, unit: m, source: paper",
            "value: 0.200, unit: m, source: paper",
            "slide.stroke_m: is too short",
        ),
        (
            "value: 0.130",
            "value: 0.150",
            "handling.stem_clearance_rise_m: must be less than lift.stroke_m for an arm to clear the seedlings",
        ),
        ("layout:", "layout: [", "not YAML"),
    ],
)
def test_an_invalid_file_is_rejected(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in TEXT
    assert message in complaint(tmp_path, TEXT.replace(old, new, 1))


@pytest.mark.parametrize("text", ["", "3", "[]", "slide: 3", "{", "\x07"])
def test_a_file_of_another_kind_is_rejected(tmp_path: Path, text: str) -> None:
    assert complaint(tmp_path, text).startswith("1: ")


def test_an_entry_may_take_fields_from_another_one(tmp_path: Path) -> None:
    """YAML merge keys copy fields from one or several entries."""
    path = tmp_path / "machine.yaml"
    text = TEXT.replace(BORE, BORE.replace("bore_m: ", "bore_m: &bore "))
    for base in ("*bore", "[*bore, {unit: s}]"):
        entry = f"  stroke_m: {{<<: {base}, value: 0.601}}"
        path.write_text(re.sub("  stroke_m: .*", entry, text, count=1), encoding="utf-8")
        assert load_machine(path).slide.stroke_m == 0.601
    path.write_text(re.sub("  stroke_m: .*", "  stroke_m: {<<: 1, value: 0.601}", text, count=1), encoding="utf-8")
    with pytest.raises(MachineError, match=r"slide.stroke_m.<<: unknown key; use one of value, unit, source, note"):
        load_machine(path)


def test_a_missing_section_is_named(tmp_path: Path) -> None:
    start, end = TEXT.index("valve:"), TEXT.index("slide:")
    assert complaint(tmp_path, TEXT[:start] + TEXT[end:]) == f"{FIRST_LINE}: valve: is missing; add it"


def test_an_unreadable_file_is_rejected(tmp_path: Path) -> None:
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
    ("name", "value", "message"),
    [
        ("cups.frequency", 60, "cups.frequency: unknown parameter of the machine; use one of pitch_m, "),
        ("cup.pitch_m", 60, "cup.pitch_m: unknown section of the machine; did you mean cups?"),
        ("cups", 60, "cups: not a dotted name; write section.parameter"),
        ("cups.pitch_m", True, "cups.pitch_m: cannot be true; write a number"),
        ("cups.pitch_m", -1, "cups.pitch_m: must be 0.02 to 0.5, not -1"),
        ("cups.pitch_m", 0.056, "spreader.travel_m: spreads the claws to 0.06 m"),
        ("simulation.look_ms", 2.5, "simulation.look_ms: cannot be 2.5; write an integer"),
        ("simulation.step_s", 0.3e-3, "simulation.step_s: must divide a millisecond: 1.0e-3, 0.5e-3"),
        ("slide.throttle_conductance_m3_s_pa", 4e-11, "slide.throttle_conductance_m3_s_pa: gives 0.00815 m/s; it must"),
        ("slide_port.dead_volume_m3", 4e-6, "slide.overtravel_m: takes more than half of slide_port.dead_volume_m3"),
        ("lift.carried_kg", 100.0, "lift.carried_kg: weighs 980.7 N, but the lift may carry only 577.3 N, 0.7 of its"),
        ("slide.brake_bites_pa", 0.3e6, "slide.brake_bites_pa: must be less than rating.slide_least_pa, otherwise"),
        ("slide_friction.static_n", 89.0, "slide_friction.static_n: must be less than 88.4 N, the force at rating.sl"),
        ("claws_friction.static_n", 21.0, "claws_friction.static_n: must be less than 20.1 N, the force at rating.cl"),
        ("slide.bumper_m", 0.006, "slide.bumper_m: must be thinner than slide.switch_band_m, otherwise the switch"),
        ("lift.cushion_volume_m3", 23e-6, "lift.cushion_volume_m3: takes more than half of lift_port.dead_volume_m3"),
        ("slide_friction.static_n", 16.0, "slide_friction.static_n: must be at least coulomb_n"),
        ("lift.rod_m", 0.05, "lift.rod_m: must be thinner than the bore"),
        ("lift.retract_conductance_m3_s_pa", 2e-8, "lift.retract_conductance_m3_s_pa: gives 1.02 m/s; it must give"),
        ("supply.compressor_off_pa", 0.6e6, "supply.compressor_off_pa: must exceed compressor_on_pa"),
        ("supply.pressure_pa", 0.65e6, "supply.pressure_pa: must be less than compressor_on_pa"),
        ("spreader.friction_n", 481.0, "spreader.friction_n: exceeds the stall force of the motor, 480 N"),
        ("conveyor.acceleration_m_s2", 12.0, "conveyor.torque_nm: gives 162 N at full speed, but 192 N are required"),
        ("conveyor.outlet_past_beam_m", 5.0, "conveyor.outlet_past_beam_m: allows 11 trays on the belt"),
        ("cups.mouth_m", 0.06, "cups.mouth_m: must be less than the pitch; the cups would overlap"),
        ("cups.plug_m", 0.055, "cups.plug_m: must be narrower than the mouth of a cup"),
    ],
)
def test_an_invalid_change_is_rejected(name: str, value: Value, message: str) -> None:
    with pytest.raises(MachineError) as caught:
        MACHINE.with_values({name: value})
    assert str(caught.value).startswith(message)


NUMBERS = [
    f"{section.name}.{field.name}"
    for section in dataclasses.fields(MACHINE)
    for field in dataclasses.fields(getattr(MACHINE, section.name))
    if field.type is not bool
]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [-1_000_000, 1_000_000_000])
def test_every_numeric_parameter_has_a_limited_range(name: str, value: int) -> None:
    with pytest.raises(MachineError):
        MACHINE.with_values({name: value})


PARAMETER = re.compile(r"^  (\w+): \{value: [^,]+, unit: ([^,]+),", re.MULTILINE)
ONE_OF_EACH_UNIT = {found[2].strip('"'): found for found in PARAMETER.finditer(TEXT)}


@pytest.mark.parametrize("unit", ONE_OF_EACH_UNIT)
def test_the_unit_is_the_suffix_of_the_name(tmp_path: Path, unit: str) -> None:
    found = ONE_OF_EACH_UNIT[unit]
    changed = TEXT[: found.start(2)] + "furlong" + TEXT[found.end(2) :]
    line = 1 + TEXT[: found.start(1)].count("\n")
    message = complaint(tmp_path, changed)
    assert message.startswith(f"{line}: ")
    assert message.endswith(f".{found[1]}: must have unit {unit}, not furlong")


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
            "crop.claw_pressure_mpa: 0.58 MPa exceeds the lowest pressure behind the claw check valve, "
            "0.565 MPa; raise supply.compressor_on_pa",
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
            "a decoupled carriage never recouples",
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
def test_a_value_outside_a_rating_causes_a_warning_with_its_name_and_no_error(
    values: dict[str, Value], warning: str
) -> None:
    machine = MACHINE.with_values(values)
    assert machine.warnings == [warning]
    Plant(load_io_map(DEFAULT_IO_MAP), machine, seed=1)


@pytest.mark.parametrize("claw_pressure_mpa", [0.1, 0.6])
def test_the_ends_of_a_rating_are_within_it(claw_pressure_mpa: float) -> None:
    assert MACHINE.with_values({"crop.claw_pressure_mpa": claw_pressure_mpa}).warnings == []


@pytest.mark.parametrize(("starts_below_pa", "is_warned"), [(0.606e6, False), (0.604e6, True)])
def test_the_cracking_pressure_adds_to_the_claw_pressure(starts_below_pa: float, is_warned: bool) -> None:
    """Claws at 0.6 MPa require at least 0.605 MPa because their check valve has a cracking pressure of 5 kPa."""
    values: dict[str, Value] = {"crop.claw_pressure_mpa": 0.6, "supply.compressor_on_pa": starts_below_pa}
    assert bool(MACHINE.with_values(values).warnings) is is_warned


def test_a_lighter_lift_on_its_cushion_needs_shorter_steps() -> None:
    """The number of steps is proportional to the frequency of a mass on a spring, sqrt(k / m)."""
    light = MACHINE.with_values({"lift.carried_kg": MACHINE.lift.carried_kg / 4})
    usual_steps, light_steps = (steps_per_ms_by_key(each)["lift.cushion_volume_m3"] for each in (MACHINE, light))
    assert light_steps == pytest.approx(2 * usual_steps)


def test_overlapping_switches_are_rejected() -> None:
    with pytest.raises(MachineError, match=r"slide.switch_band_m: allows the switches of two pick positions to be on"):
        MACHINE.with_values(
            {"slide.switch_band_m": 0.015, "slide.switch_hysteresis_m": 0.003, "handling.cell_pitch_m": 0.035}
        )
    for section in ("lift", "spreader"):
        stroke = "stroke_m" if section == "lift" else "travel_m"
        with pytest.raises(
            MachineError, match=rf"{section}.switch_band_m: lets both end switches be on at the same time"
        ):
            MACHINE.with_values(
                {f"{section}.switch_band_m": 0.016, f"{section}.switch_hysteresis_m": 0.0, f"{section}.{stroke}": 0.03}
            )
