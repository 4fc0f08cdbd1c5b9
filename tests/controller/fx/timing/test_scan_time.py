"""Estimated scan time of an FX2N."""

from __future__ import annotations

import pytest

from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from controller.fx.language.instruction import Ladder
from controller.fx.language.instruction_set import KINDS
from controller.fx.timing.scan_time import executed_ms, execution_time, execution_times, scan_time_bounds

END_US = 508
FIVE_TIMERS = "LD X0\n" + "".join(f"OUT T{n} K5\n" for n in range(5))


def test_every_time_has_a_mark_and_belongs_to_an_instruction() -> None:
    times = execution_times()
    names = {kind.name for kind in KINDS} | {"P", "I", "contact comparison", "contact comparison of 32 bits", "applied"}
    assert {name for name, _ in times} <= names
    assert {time.mark for time in times.values()} == {"from memory", "assumed"}
    assert all(0 < time.not_driven_us < 1_000 and 0 < time.driven_us < 1_000 for time in times.values())


@pytest.mark.parametrize(
    ("line", "driven_us", "not_driven_us"),
    [
        ("LD X0", 0.08, 0.08),
        ("OUT Y0", 0.08, 0.08),
        ("OUT T0 K5", 42, 37),
        ("SET S20", 24, 0.3),
        ("RST D0", 22, 0.3),
        ("LD= D0 K5", 1.52, 1.52),
        ("LDD> D0 K5", 1.84, 1.84),
        ("DMOVP D0 D2", 1.52, 1.52),
        ("ADDP D0 D1 D2", 28, 6.4),
        ("BMOV D0 D10 K5", 300, 6.4),
    ],
)
def test_time_of_an_instruction(line: str, driven_us: float, not_driven_us: float) -> None:
    text = f"{line}\nOUT Y0\nEND" if line.startswith("LD") else f"LD X0\n{line}\nEND"
    instruction = read_il(text).instructions[0 if line.startswith("LD") else 1]
    time = execution_time(instruction)
    assert (time.driven_us, time.not_driven_us) == (driven_us, not_driven_us)


def test_bounds_of_a_program() -> None:
    bounds = scan_time_bounds(read_il(f"{FIVE_TIMERS}END"))
    assert bounds.shortest_ms == pytest.approx((0.08 + 5 * 37 + END_US) / 1_000)
    assert bounds.longest_ms == pytest.approx((0.08 + 5 * 42 + END_US) / 1_000)
    assert "general knowledge" in str(bounds)


def test_steps_count_only_in_the_longest_scan() -> None:
    bounds = scan_time_bounds(read_il(f"LD M8002\nSET S0\nSTL S0\n{FIVE_TIMERS}RET\nLD X1\nOUT Y0\nEND"))
    fixed_us = 0.08 + 24 + 22 + 0.08 + 0.08 + END_US
    assert bounds.shortest_ms == pytest.approx((fixed_us + 0.3) / 1_000)
    assert bounds.longest_ms == pytest.approx((fixed_us + 24 + 0.08 + 5 * 42) / 1_000)


def after_a_scan(ladder: Ladder, *inputs: int) -> float:
    plc = FxPlc(ladder, input_filter_ms=0)
    for now_ms in (0, 10):
        plc.scan(now_ms, [number in inputs for number in range(256)])
    return 1_000 * executed_ms(ladder, plc.memory)


@pytest.mark.parametrize(
    ("condition", "contacts_us", "on"),
    [
        ("LD X0\nAND X1", 0.16, True),
        ("LD X0\nANI X1", 0.16, False),
        ("LDI X0\nOR X1", 0.16, True),
        ("LD X5\nLD X0\nORB", 0.24, True),
        ("LD X0\nLD X5\nANB", 0.24, False),
        ("LD X5\nINV", 0.16, True),
        ("LD X0\nAND= D0 K0", 1.6, True),
        ("LDD< D0 K0", 1.84, False),
        ("LDP X0", 43, False),
        ("LD X5\nMPS\nAND X1\nOUT Y5\nMPP\nINV", 0.48, True),
    ],
)
def test_conditions_of_an_executed_scan(condition: str, contacts_us: float, on: bool) -> None:
    estimate = after_a_scan(read_il(f"{condition}\nOUT T0 K5\nEND"), 0, 1)
    assert estimate == pytest.approx(contacts_us + (42 if on else 37) + END_US)


def test_instructions_of_inactive_steps_are_not_executed() -> None:
    program = read_il(f"LD X0\nSET S0\nSTL S0\n{FIVE_TIMERS}RET\nLD X1\nOUT T9 K5\nEND")
    fixed_us = 0.08 + 24 + 22 + 0.08 + 37 + END_US
    assert after_a_scan(program) == pytest.approx(fixed_us + 0.3)
    assert after_a_scan(program, 0) == pytest.approx(fixed_us + 24 + 0.08 + 5 * 42)


def test_consecutive_outputs_have_the_same_condition_and_the_next_contact_begins_a_new_one() -> None:
    estimate = after_a_scan(read_il("LD X0\nOUT T0 K5\nOUT T1 K5\nLD X5\nOUT T2 K5\nEND"), 0)
    assert estimate == pytest.approx(0.16 + 42 + 42 + 37 + END_US)
