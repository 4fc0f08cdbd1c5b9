"""Doubts about the results of a program: only for the programs concerned, with page and behaviour of the engine."""

from __future__ import annotations

import pytest

from controller.fx.doubts.doubts import doubts
from controller.fx.language.cpu_model import FX3U
from controller.fx.language.il import read_il
from tests.controller.fx.language.fx_samples import SELF_HOLDING, STEPS

WRAPS = (
    "the number stored then has the sign of the limit exceeded; this engine and exported Structured Text wrap around"
)


def found(text: str) -> list[tuple[int, str]]:
    """Return the line and the text of each doubt."""
    return [(each.line, each.text) for each in doubts(read_il(text, cpu=FX3U))]


def only_doubt(text: str, line: int, *parts: str) -> bool:
    """Return whether there is exactly one doubt, at this line and with these parts in its text."""
    return [(at, [part in words for part in parts]) for at, words in found(text)] == [(line, [True] * len(parts))]


@pytest.mark.parametrize("sample", [SELF_HOLDING, STEPS])
def test_a_program_without_such_instructions_has_no_doubts(sample: str) -> None:
    assert found(sample) == []


@pytest.mark.parametrize(
    ("line", "limits"),
    [
        ("ADD D0 K1 D0", "-32768 to 32767"),
        ("ADDP D0 K-1 D0", "-32768 to 32767"),
        ("ADD K4M0 K1 D0", "-32768 to 32767"),
        ("ADD K4M0 K-32768 D0", "-32768 to 32767"),
        ("ADD D0 K0Z0 D0", "-32768 to 32767"),
        ("ADD T0 C0 D0", "-32768 to 32767"),
        ("ADD H7FFF K1 D0", "-32768 to 32767"),
        ("SUB K0 D0 D0", "-32768 to 32767"),
        ("SUB K-2 T0 D0", "-32768 to 32767"),
        ("DADD D0 K1 D0", "-2147483648 to 2147483647"),
        ("DSUBP K8M0 K1 D0", "-2147483648 to 2147483647"),
        ("DADD C200 K1 D0", "-2147483648 to 2147483647"),
    ],
)
def test_sum_that_can_leave_the_range(line: str, limits: str) -> None:
    assert only_doubt(f"LD X0\n{line}\nEND", 2, f"{line} (step 1): the result can leave {limits}", "page 5-25 d", WRAPS)


@pytest.mark.parametrize(
    "line",
    [
        "ADD D0 K0 D1",
        "ADD K32766 K1 D0",
        "ADD HFFFF T0 D0",
        "ADD K3M0 K28672 D0",
        "SUB T0 C0 D0",
        "SUB K-1 T0 D0",
        "SUB K1M0 K2M4 D0",
        "DADD K7M0 K7M0 D0",
        "DSUB K-1 K7M0 D0",
        "INC D0",
        "MUL D0 D1 D2",
    ],
)
def test_sum_that_remains_in_the_range(line: str) -> None:
    assert found(f"LD X0\n{line}\nEND") == []


def test_instructions_with_the_same_doubt_are_one_line_with_their_steps() -> None:
    sums = "".join(f"ADD D{n} K1 D{n}\n" for n in range(8))
    assert only_doubt(f"LD X0\n{sums}END", 2, "ADD D0 K1 D0 (step 1, also 8, 15, 22, 29, 36 and 2 more): ")
    ((_, text),) = found("LD X0\nADD D0 K1 D0\nSUB D0 K1 D0\nEND")
    assert text.startswith("ADD D0 K1 D0 (step 1, also 8): ")


ROUTINE = "LD X0\nCALL P1\nFEND\nP1\nLD X1\n{}\nSRET\nEND"


@pytest.mark.parametrize("device", ["T0", "C0", "C200"])
def test_reset_of_a_timer_or_counter_that_is_not_executed_in_every_scan(device: str) -> None:
    last = "the reset can then last and disable " + device
    jumped = f"LD X0\nCJ P1\nLD X1\nRST {device}\nP1\nEND"
    assert only_doubt(jumped, 4, f"RST {device} (step 5): can be jumped over by CJ: by page 212 of the FX3", last)
    assert only_doubt(ROUTINE.format(f"RST {device}"), 6, "in a subroutine or interrupt routine: by page 212", last)
    assert found(f"LD X1\nRST {device}\nLD X0\nCJ P1\nLD X1\nOUT Y0\nP1\nLD X2\nRST {device}\nEND") == []


def test_instructions_after_the_label_of_a_jump_backwards_are_not_jumped_over() -> None:
    assert found("P1\nLD X1\nRST T0\nLD X0\nCJP P1\nLD X1\nRST C0\nEND") == []
    assert found("LD X0\nCJ P63\nLD X1\nRST T0\nEND")[0][0] == 4
    assert found("LD X0\nCJ P63\nLD X1\nOUT Y0\nFEND\nP5\nLD X1\nRST T0\nSRET\nEND") == []


def test_reset_of_another_device_gives_no_doubt() -> None:
    assert found(ROUTINE.format("RST D0\nRST Y0")) == []
    assert found("LD X0\nCJ P1\nLD X1\nRST M0\nOUT C0 K5\nP1\nEND") == []


@pytest.mark.parametrize("timer", ["T192", "T199", "T246", "T249"])
def test_timer_for_routines_in_a_routine(timer: str) -> None:
    page = "by page 4-18 of the FX manual, its time is updated at END"
    texts = [text for _, text in found(ROUTINE.format(f"OUT {timer} K5"))]
    assert sum(text.startswith(f"OUT {timer} K5 (step 7): ") and page in text for text in texts) == 1
    interrupt = f"EI\nFEND\nI001\nLD X1\nOUT {timer} K5\nIRET\nEND"
    assert sum(page in text for _, text in found(interrupt)) == 1
    after_it = ROUTINE.replace("SRET", f"SRET\nP2\nLD X1\nOUT {timer} K5\nSRET").format("OUT Y0")
    for text in (f"LD X0\nOUT {timer} K5\nEND", after_it):
        assert not [words for _, words in found(text) if page in words]


@pytest.mark.parametrize("timer", ["T191", "T200", "T245", "T250"])
def test_other_timer_in_a_routine(timer: str) -> None:
    assert found(ROUTINE.format(f"OUT {timer} K5")) == []


def test_retentive_timer_of_1_ms() -> None:
    for timer in ("T246", "T249"):
        text = f"LD X0\nOUT {timer} K5\nEND"
        assert only_doubt(text, 2, "a pulse of one scan adds nothing; page 4-18 of the FX manual does not state")
    assert found("LD X0\nOUT T250 K5\nOUT T245 K5\nEND") == []


def test_timer_that_is_jumped_over() -> None:
    text = "LD X0\nOUT T1 K5\nCJ P1\nLD X1\nOUT T0 K5\nP1\nLD X1\nOUT T2 K5\nEND"
    assert only_doubt(text, 5, "OUT T0 K5 (step 8): can be jumped over by CJ: in an FX2N", "no page found")


def test_several_pulse_contacts_of_a_single_operation_flag() -> None:
    text = "LDP M{0}\nOUT Y0\nLD X0\nANDF M{0}\nORP M{1}\nOUT Y1\nEND"
    assert only_doubt(
        text.format(2800, 2801), 1, "LDP M2800 (step 0, also 5): M2800 has 2 pulse contacts", "here each of them does"
    )
    assert only_doubt(text.format(3071, 3071), 1, "M3071 has 3 pulse contacts")
    assert found(text.format(2799, 2799)) == []
    assert found(text.format(3072, 3072)) == []
    assert found("LDP M2800\nOR M2800\nORI M2800\nOUT Y0\nEND") == []


def test_limits_of_pid() -> None:
    text = "LD X0\nPID D0 D1 D100 D2\nEND"
    assert only_doubt(text, 2, "page M-28", "errors 6740 and 6742 to 6749 are reported", "6733 and 6735 as by page M-7")


def test_doubts_are_in_line_order() -> None:
    text = "LDP M2800\nORP M2800\nPID D0 D1 D100 D2\nADD D0 D1 D2\nOUT T246 K5\nEND"
    assert [line for line, _ in found(text)] == [1, 3, 4, 5]
