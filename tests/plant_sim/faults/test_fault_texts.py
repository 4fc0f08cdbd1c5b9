"""Syntax of faults, and rejection of invalid faults."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.faults import FAULTS, Fault, FaultError, FaultKind, FaultSchedule, fault_table, parse_fault
from tests.plant_sim.machine.plant_rig import Rig


@given(
    kind=st.sampled_from(list(FAULTS.values())),
    share=st.floats(min_value=0.0, max_value=1.0),
    start_ms=st.integers(0, 10**7),
    for_ms=st.none() | st.integers(1, 10**7),
)
def test_parsing_a_fault_inverts_its_text(kind: FaultKind, share: float, start_ms: int, for_ms: int | None) -> None:
    size = None if kind.size is None else kind.size.low + share * (kind.size.high - kind.size.low)
    start_ms = 0 if kind.permanent else start_ms
    end_ms = None if for_ms is None or kind.permanent else start_ms + for_ms
    fault = Fault(kind.name, kind.example, start_ms, end_ms, size)
    assert parse_fault(str(fault)) == fault


@pytest.mark.parametrize("row", fault_table()[1:], ids=lambda row: row[0])
def test_every_example_of_the_table_is_a_fault_of_the_machine(row: tuple[str, ...]) -> None:
    fault = parse_fault(row[-1].strip("`"))
    assert row[0] == f"`{fault.kind}`"
    FaultSchedule(Rig().plant, [fault])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            "stuck",
            "'stuck': not a fault; write KIND:TARGET, KIND:TARGET=SIZE or KIND:TARGET=SIZE@START..END, for "
            "example leak:left.slide.plus=2e-9@5s..",
        ),
        ("stuck_of:left.lift_up", "stuck_of: unknown fault; did you mean stuck_off?"),
        ("stuck_off:left.lift_upp", "stuck_off:left.lift_upp: not a sensor; did you mean left.lift_up?"),
        ("broken_wire:horn", "broken_wire:horn: not a wired input; use one of "),
        ("stuck_off:left.lift_up=3", "stuck_off:left.lift_up: takes no size; remove 3"),
        (
            "leak:left.slide.plus",
            "leak:left.slide.plus: requires a size (sonic conductance of the hole); write 1e-16 to "
            "1e-07 m3/(s Pa), for example 2e-9",
        ),
        (
            "leak:left.slide.plus=5mm",
            "leak:left.slide.plus: '5mm': mm is a unit of another quantity; use m3/(s Pa) or dm3/(s bar) or L/(s bar)",
        ),
        (
            "closed_throttle:left.slide.plus=130%",
            "closed_throttle:left.slide.plus: size must be 0 to 1, not 1.3; for example 30 %",
        ),
        ("jammed:left.slide@5..9s", "jammed:left.slide: '5': a time requires a unit; write 5 s or 5 ms"),
        ("jammed:left.slide@9s..5s", "jammed:left.slide: ends at 5000 ms; must end after its start at 9000 ms"),
        (
            "jammed:left.slide@5s",
            "'jammed:left.slide@5s': the two dots after the start are missing; write @5s.. for a fault that stays, or "
            "@5s..END for one that ends",
        ),
        (
            "missing_cells:tray_1=5@3s..",
            "missing_cells:tray_1: is set before the run and is permanent; remove its times",
        ),
        ("missing_cells:tray_3=5", "missing_cells:tray_3: not a tray; did you mean tray_2?"),
    ],
)
def test_an_invalid_fault_is_rejected_in_one_line(text: str, complaint: str) -> None:
    with pytest.raises(FaultError) as error:
        FaultSchedule(Rig().plant, [parse_fault(text)])
    assert str(error.value).startswith(complaint)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("stuck_on:left.lift_up", "stuck_off:left.lift_up@5s..6s"),
        ("leaking_check_valve:left.lift.plus=1e-9@1s..3s", "dropping_arm:left.lift=1e-9@2s..4s"),
        ("missed_pulses:left.cup_pulse=5%", "doubled_pulses:left.cup_pulse=5%"),
        ("missing_cells:tray_1=5", "missing_cells:tray_1=6"),
    ],
)
def test_two_faults_of_the_same_value_at_the_same_time_are_rejected(first: str, second: str) -> None:
    plant = Rig().plant
    with pytest.raises(FaultError) as error:
        FaultSchedule(plant, [parse_fault(first), parse_fault(second)])
    complaint = (
        f"{parse_fault(second)}: changes the same value as {parse_fault(first)}; end one before the other starts"
    )
    assert str(error.value) == complaint


def test_a_fault_in_the_past_is_rejected() -> None:
    rig = Rig()
    rig.run(100)
    with pytest.raises(FaultError, match=r"ends before the current time, 100 ms; specify a later end$"):
        rig.plant.faults.add(parse_fault("jammed:left.slide@0s..100ms"))
    with pytest.raises(FaultError, match=r"must be set before the run; add it at plant time 0$"):
        rig.plant.faults.add(parse_fault("missing_cells:tray_1=5"))
    assert rig.plant.faults.active == []
