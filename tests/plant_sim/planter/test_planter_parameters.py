"""Tests of the contents of planter.yaml, its ranges, and the rejection of invalid files."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import yaml

from plant_sim.common.defaults import DEFAULT_PLANTER
from plant_sim.common.parameter_file import Value
from plant_sim.planter.parameters import PlanterError, assumed_names, load_planter, load_ranges

PLANTER = load_planter()
TEXT = DEFAULT_PLANTER.read_text(encoding="utf-8")
RADIUS = 'sprocket_radius_m: {value: 0.080, unit: m, source: paper, note: "2.2.2, pitch radius"}'
RADIUS_LINE = 1 + TEXT[: TEXT.index(RADIUS)].count("\n")
DEFINITIONS = {"rigid_ground.cover_m", "rigid_ground.resistance_pa"}
"""Values that define a ground; their ranges have no width."""
RANGE = "write the lowest and the highest plausible value: [0.01, 0.05]"


def complaint(tmp_path: Path, text: str) -> str:
    path = tmp_path / "planter.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(PlanterError) as caught:
        load_planter(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{path}:")
    return message.removeprefix(f"{path}:")


def test_the_planter_matches_the_paper() -> None:
    chain = PLANTER.chain
    assert (chain.sprocket_radius_m, chain.planters) == (0.080, 6)
    assert chain.tip == (chain.offset_m, -chain.tip_height_m)
    assert chain.guide == pytest.approx(
        (chain.offset_m - chain.guide_behind_m, chain.guide_above_m - chain.tip_height_m)
    )
    assert (PLANTER.block.edge_m, PLANTER.block.stem_diameter_m, PLANTER.block.stem_length_m) == (0.040, 0.010, 0.045)
    assert PLANTER.grip.clearance_m(PLANTER.block) == pytest.approx(0.0025)
    assert (PLANTER.grip.crush_low_n, PLANTER.grip.crush_high_n) == (89.95, 119.29)


def test_everything_that_the_paper_does_not_publish_is_assumed_and_has_a_range() -> None:
    ranges = load_ranges()
    assert {"chain.offset_m", "chain.tip_height_m", "chain.axle_height_m"} <= set(assumed_names())
    entries = yaml.safe_load(TEXT)
    unprinted = {f"{s}.{key}" for s in entries for key, entry in entries[s].items() if entry["source"] != "paper"}
    assert unprinted <= set(ranges)
    assert {name for name, (low, high) in ranges.items() if low == high} == DEFINITIONS
    assert "bench_soil.clearance_m" in unprinted
    assert not {"chain.sprocket_radius_m", "chain.planters"} & ({*assumed_names(), *ranges})
    assert ranges["chain.centre_distance_m"] == (1.2161, 1.2174)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            RADIUS.replace("sprocket_radius_m", "radius_m"),
            "chain.radius_m: unknown key; did you mean sprocket_radius_m?",
        ),
        (RADIUS.replace("unit: m", "unit: mm"), "chain.sprocket_radius_m: must have unit m, not mm"),
        (RADIUS.replace("0.080", "0.01"), "chain.sprocket_radius_m: must be 0.02 to 0.5, not 0.01"),
        (
            RADIUS.replace("note", "range: [0.09, 0.1], note"),
            "chain.sprocket_radius_m: must be within its range [0.09, 0.1], not 0.08",
        ),
        (
            RADIUS.replace("note", "range: [0.1, 0.05], note"),
            "chain.sprocket_radius_m: has range [0.1, 0.05]; write the lower limit first",
        ),
        (RADIUS.replace("note", "range: [0.1], note"), f"chain.sprocket_radius_m.range: cannot be a list; {RANGE}"),
        (RADIUS.replace("note", "range: 0.1, note"), f"chain.sprocket_radius_m.range: cannot be 0.1; {RANGE}"),
        (RADIUS.replace("note", "range: [0, .inf], note"), "chain.sprocket_radius_m.range"),
        (
            RADIUS.replace("note", "remark"),
            "chain.sprocket_radius_m.remark: unknown key; use one of value, unit, source, note, range",
        ),
    ],
)
def test_an_invalid_line_is_rejected_with_its_number_and_key(tmp_path: Path, line: str, message: str) -> None:
    assert complaint(tmp_path, TEXT.replace(RADIUS, line)).startswith(f"{RADIUS_LINE}: {message}")


def test_a_guide_plate_behind_the_centre_of_the_arcs_is_rejected() -> None:
    with pytest.raises(PlanterError, match=r"chain.guide_behind_m: must be less than the sum of sprocket_radius_m and"):
        PLANTER.with_values({"chain.guide_behind_m": 0.06, "chain.sprocket_radius_m": 0.03})


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("chain.lenght_m", 1, "chain.lenght_m: unknown parameter of the planter; "),
        ("chian.offset_m", 1, "chian.offset_m: unknown section of the planter; did you mean chain?"),
        ("chain.planters", 5.5, "chain.planters: cannot be 5.5; write an integer"),
    ],
)
def test_an_invalid_change_is_rejected(name: str, value: Value, message: str) -> None:
    with pytest.raises(PlanterError) as caught:
        PLANTER.with_values({name: value})
    assert str(caught.value).startswith(message)


NUMBERS = [
    f"{section.name}.{field.name}"
    for section in dataclasses.fields(PLANTER)
    for field in dataclasses.fields(getattr(PLANTER, section.name))
    if field.type is not bool
]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [-1_000_000, 1_000_000_000])
def test_every_numeric_parameter_has_a_limited_range(name: str, value: int) -> None:
    with pytest.raises(PlanterError):
        PLANTER.with_values({name: value})


@pytest.mark.parametrize("name", sorted(load_ranges()))
def test_every_plausible_range_is_valid(name: str) -> None:
    section, _, key = name.partition(".")
    kind = type(getattr(getattr(PLANTER, section), key))
    for value in load_ranges()[name]:
        assert kind(value) == value
        PLANTER.with_values({name: kind(value)})
