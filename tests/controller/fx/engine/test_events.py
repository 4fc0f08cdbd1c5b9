"""Events between two scans: outputs at once, interrupts at their millisecond, both executions equal."""

from __future__ import annotations

import pytest

from controller.core.devices import SIZES
from controller.fx.engine.plc import FxPlc
from controller.fx.language.high_speed_inputs import COUNTER_INPUTS
from controller.fx.language.il import read_il


def level(*numbers: int) -> list[bool]:
    return [number in numbers for number in range(SIZES["X"])]


def started(text: str) -> FxPlc:
    plc = FxPlc(read_il(text), input_filter_ms=0)
    plc.scan(0, level())
    return plc


def test_comparison_switches_the_terminal_before_the_next_scan() -> None:
    plc = started("LD M8000\nOUT C235 K9\nDHSCS K2 C235 Y3\nDHSCR K3 C235 Y3\nEND")
    seen = [plc.sample(at_ms, level(0) if at_ms % 2 else level())[3] for at_ms in range(1, 8)]
    assert seen == [False, False, True, True, False, False, False]
    assert plc.scans == 1
    assert not plc.memory.Y[3]


def test_m8034_keeps_the_terminals_off() -> None:
    plc = started("LD M8000\nOUT C235 K9\nOUT M8034\nDHSCS K1 C235 Y3\nDHSZ K1 K1 C235 Y4\nEND")
    assert not any(plc.sample(1, level(0)))
    assert plc.memory.Y[3]
    assert plc.memory.Y[5]


def test_zones_switch_the_terminals() -> None:
    plc = started("LD M8000\nOUT C235 K9\nDHSZ K2 K2 C235 Y4\nEND")
    assert plc.sample(1, level(0))[4:7] == [True, False, False]
    plc.sample(2, level())
    assert plc.sample(3, level(0))[4:7] == [False, True, False]


def test_interrupt_refreshes_outputs_at_once_and_others_at_the_end_of_the_scan() -> None:
    plc = started("EI\nLD X7\nOUT Y1\nFEND\nI001\nLD M8000\nOUT Y10\nOUT Y2\nREF Y10 K8\nIRET\nEND")
    image = plc.sample(4, level(0))
    assert image[8]
    assert not image[2]
    assert plc.scan(10, level(0))[2]


def test_interrupt_reads_terminals_with_ref() -> None:
    plc = started(
        "EI\nLD X7\nOUT Y1\nFEND\nI101\nREF X0 K8\nLD X5\nMOVP K7 D0\nIRET\nEND".replace(
            "I101\nREF", "I101\nLD M8000\nREF"
        )
    )
    plc.sample(3, level(1, 5))
    assert plc.memory.D[0] == 7


def test_interrupt_routine_calls_a_subroutine_and_uses_its_own_edges() -> None:
    plc = started(
        "EI\nLD X7\nOUT Y1\nFEND\nP5\nLD M8000\nINC D1\nSRET\nI001\nLDP X7\nINC D0\nLD M8000\nCALL P5\nIRET\nEND"
    )
    for at_ms in range(1, 7):
        plc.sample(at_ms, level(0) if at_ms % 2 else level())
    assert (plc.memory.D[0], plc.memory.D[1]) == (0, 3)


def test_two_labels_have_one_routine() -> None:
    plc = started("EI\nLD X7\nOUT Y1\nFEND\nI001\nI101\nLD M8000\nINC D0\nIRET\nEND")
    plc.sample(1, level(0))
    plc.sample(2, level(0, 1))
    assert plc.memory.D[0] == 2


def test_endless_interrupt_stops_the_cpu_with_all_outputs_off() -> None:
    plc = started("EI\nLD M8000\nOUT Y1\nFEND\nI001\nP1\nLD M8000\nCJ P1\nIRET\nEND")
    assert plc.scan(10, level())[1]
    assert not any(plc.sample(11, level(0)))
    assert not plc.running
    assert plc.memory.M[8061]


def test_interrupts_and_comparisons_end_with_run() -> None:
    plc = started(
        "LDI X6\nCJ P0\nEI\nP0\nLD X5\nOUT C235 K9\nDHSCS K1 C235 Y3\nFEND\nI101\nLD M8000\nINC D0\nIRET\nEND"
    )
    plc.scan(10, level(5, 6))
    plc.stop()
    plc.run()
    plc.scan(20, level())
    plc.sample(21, level(0, 1))
    assert plc.memory.D[0] == plc.memory.CV[235] == 0
    assert not plc.memory.Y[3]


@pytest.mark.parametrize("retained", [False, True])
def test_stop_switches_the_terminals_off_before_the_next_scan(retained: bool) -> None:
    plc = started("LD M8000\nOUT Y1\nOUT C235 K9\nLD X2\nOUT M8033\nEND")
    assert plc.scan(10, level(2) if retained else level())[1]
    plc.stop()
    assert plc.sample(11, level())[1] is retained


def test_programs_without_fast_inputs_are_not_sampled() -> None:
    assert not started("LD X0\nOUT Y0\nEND").is_sampled
    assert started("LD X0\nSPD X0 K10 D0\nEND").is_sampled


def test_comparison_is_released_when_its_drive_goes_off() -> None:
    plc = started("LD M8000\nOUT C235 K9\nLD X7\nDHSCS K1 C235 Y3\nEND")
    plc.scan(10, level(7))
    plc.scan(20, level())
    plc.sample(21, level(0))
    assert plc.memory.CV[235] == 1
    assert not plc.memory.Y[3]


@pytest.mark.parametrize("number", COUNTER_INPUTS)
def test_every_counter_counts_its_terminals(number: int) -> None:
    """A pulse in the direction up counts; the reset terminal clears, and nothing counts without the start terminal."""
    inputs = COUNTER_INPUTS[number]
    plc = started(f"LD M8000\nOUT C{number} K100\nEND")
    always = () if inputs.start is None else (inputs.start,)
    pulse = (
        [inputs.count[:1], inputs.count, inputs.count[1:], ()]
        if inputs.phases == "A and B"
        else [inputs.count[:1], (), inputs.count[:1], ()]
    )
    plc.sample(1, level(*always))
    for at_ms, terminals in enumerate(pulse, 2):
        plc.sample(at_ms, level(*terminals, *always))
    assert plc.memory.CV[number] == (1 if inputs.phases == "A and B" else 2)
    if inputs.reset is not None:
        plc.sample(7, level(inputs.reset, *always))
        assert plc.memory.CV[number] == 0
    if inputs.start is not None:
        for at_ms, terminals in enumerate(pulse, 8):
            plc.sample(at_ms, level(*terminals))
        assert plc.memory.CV[number] == 0


@pytest.mark.nightly
def test_a_thousand_pulses_are_all_counted() -> None:
    plc = started("LD M8000\nOUT C235 K1000\nLD C235\nOUT Y0\nEND")
    for at_ms in range(1, 2_001):
        plc.sample(at_ms, level(0) if at_ms % 2 else level())
        if at_ms % 50 == 0:
            plc.scan(at_ms, level())
    assert plc.memory.CV[235] == 1000
    assert plc.memory.C[235]
