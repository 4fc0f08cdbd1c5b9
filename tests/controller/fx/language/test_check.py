"""Program warnings and FX2N resource usage."""

from __future__ import annotations

import pytest

from controller.fx.language.check import Finding, available, check, usage
from controller.fx.language.il import read_il
from tests.controller.fx.language.fx_samples import FLOW, SELF_HOLDING, STEPS


def found(text: str) -> list[tuple[int, str]]:
    """Return the line and text of each finding."""
    return [(finding.line, finding.text) for finding in check(read_il(text))]


def only_finding(text: str, line: int, *parts: str) -> bool:
    """Return whether there is exactly one finding, in this line and with these parts in its text."""
    return [(at, [part in words for part in parts]) for at, words in found(text)] == [(line, [True] * len(parts))]


@pytest.mark.parametrize("sample", [SELF_HOLDING, STEPS])
def test_valid_program_has_no_findings(sample: str) -> None:
    assert check(read_il(sample)) == []


def test_double_coil_is_reported_with_its_lines() -> None:
    assert only_finding("LD X0\nOUT Y0\nLD X1\nOUT Y0\nLD X2\nOUT Y0\nEND", 4, "OUT Y0", "lines 2, 4 and 6", "; ")
    assert only_finding("LD X0\nOUT T0 K5\nLD X1\nOUT T0 K6\nLD T0\nOUT Y0\nEND", 4, "OUT T0", "lines 2 and 4")
    assert only_finding("LD M8002\nSET S0\nLD X1\nOUT Y0\nSTL S0\nOUT Y0\nRET\nEND", 6, "OUT Y0", "lines 4 and 6")
    assert only_finding("LD M8002\nSET S0\nSTL S0\nOUT Y0\nLD X1\nOUT Y0\nRET\nEND", 6, "OUT Y0", "lines 4 and 6")


def test_steps_may_share_a_coil() -> None:
    assert found("LD M8002\nSET S0\nSTL S0\nOUT Y0\nLD X1\nSET S20\nSTL S20\nOUT Y0\nLD X2\nOUT S0\nRET\nEND") == []


def test_set_and_reset_are_not_double_coils() -> None:
    assert found("LD X0\nSET Y0\nLD X1\nSET Y0\nLD X2\nRST Y0\nEND") == []


TWO_STEPS = "LD M8002\nSET S0\nSTL S0\nOUT T0 K5\nLD T0\n{} S20\nSTL {}\nOUT T{} K5\nLD T{}\nOUT S0\nRET\nEND"


@pytest.mark.parametrize("transfer", ["SET", "OUT"])
def test_shared_timer_in_consecutive_steps(transfer: str) -> None:
    twice = TWO_STEPS.format(transfer, "S20", 0, 0)
    assert only_finding(twice, 8, "T0 runs in two consecutive steps, lines 4 and 8", "; ")
    assert found(TWO_STEPS.format(transfer, "S20", 1, 1)) == []


def test_shared_timer_with_a_backward_transfer() -> None:
    text = (
        "LD M8002\nSET S0\nSTL S0\nOUT T0 K5\nLD T0\nSET S20\nSTL S20\nLD X0\nSET S21\n"
        "STL S21\nOUT T0 K5\nLD T0\nOUT S0\nRET\nEND"
    )
    assert only_finding(text, 11, "T0 runs in two consecutive steps, lines 4 and 11")


JOIN = (
    "LD M8002\nSET S20\nSET S21\nSTL S20\nOUT T0 K5\nSTL S21\nOUT T2 K5\nSTL S20\nSTL S21\nLD T0\nAND T2\nSET S22\n"
    "STL S22\nOUT T{} K5\nLD T{}\nSET S23\nSTL S23\nLD X0\nSET S20\nSET S21\nRET\nEND"
)


def test_shared_timer_before_and_after_a_join() -> None:
    assert only_finding(JOIN.format(2, 2), 14, "T2 runs in two consecutive steps, lines 7 and 14")
    assert found(JOIN.format(1, 1)) == []


def test_shared_timer_in_separate_steps_is_valid() -> None:
    text = (
        "LD M8002\nSET S0\nSTL S0\nOUT T0 K5\nLD T0\nSET S20\nSTL S20\nLD X0\nSET S21\n"
        "STL S21\nOUT T0 K5\nLD T0\nSET S22\nSTL S22\nLD X1\nSET S0\nRET\nEND"
    )
    assert found(text) == []


@pytest.mark.parametrize("device", ["M5", "S5", "T5", "C5"])
def test_read_but_never_driven(device: str) -> None:
    assert only_finding(f"LD {device}\nOUT Y0\nEND", 1, device, "read but never driven", "; ")
    assert only_finding(f"LD X0\nRST {device}\nLD {device}\nOUT Y0\nEND", 3, device, "read but never driven")


def test_relays_a_screen_may_write_are_one_finding() -> None:
    text = "LD M7\nOR M402\nOR M5\nOR M400\nOR M401\nOUT Y0\nLD X0\nMOV K1M10 D0\nEND"
    assert only_finding(
        text, 1, "M5, M7, M10 to M13, M400 to M402: read but never driven", "; valid if a screen or panel "
    )
    assert [at for at, _ in found("LD T5\nOR T6\nOUT Y0\nEND")] == [1, 2], "no screen writes a timer's contact"


@pytest.mark.parametrize(
    "coil", ["OUT M5", "SET M5", "PLS M5", "OUT T5 K1", "OUT C5 K1", "MOV K1 K1M4", "CMP D0 D1 M4"]
)
def test_driven_but_never_read(coil: str) -> None:
    assert only_finding(f"LD X0\n{coil}\nEND", 2, "driven but never read", "; ")


@pytest.mark.parametrize(
    "text",
    [
        "LD M8013\nOUT Y0\nEND",
        "LD X0\nMOV D0 D1\nOUT M8034\nSET S900\nEND",
        "LD X0\nMOV K1 K1M4\nLD M7\nOUT Y0\nEND",
        "LD X0\nCMP D0 D1 M4\nLD M6\nOUT Y0\nEND",
        "LD X0\nOUT M4\nMOV K4M0 D0\nEND",
        "LD X0\nMOV K1 K1M4Z0\nLD M99\nOUT Y0\nEND",
        "LD X0\nSFTLP X1 M20 K16 K1\nLD M35\nOUT Y0\nEND",
        "LD X0\nMOV D0 K2M0\nBMOV K1M0 K1M20 K2\nLD M27\nOUT Y0\nEND",
        "LD X0\nDECO D0 M20 K4\nLD M35\nOUT Y0\nEND",
        "LD X0\nMC N0 M5\nLD X1\nOUT Y0\nMCR N0\nEND",
        "LD X0\nOUT C0 K5\nMOV C0 D0\nEND",
        "LD M8000\nIST X20 S20 S29\nSTL S2\nLD X0\nSET S20\nSTL S20\nOUT Y0\nSTL S29\nRET\nEND",
        "LD X0\nANS T0 K5 S900\nEND",
    ],
)
def test_devices_read_and_driven(text: str) -> None:
    assert found(text) == []


def test_step_that_is_never_started() -> None:
    assert only_finding("STL S5\nOUT Y0\nRET\nEND", 1, "S5: read but never driven")


def test_device_after_a_group_does_not_belong_to_it() -> None:
    assert only_finding("LD M0\nOUT Y0\nLD X0\nMOV K1 K1M0\nLD M4\nOUT Y1\nEND", 5, "M4", "read but never driven")
    assert only_finding("LD M0\nOUT Y0\nLD X0\nCMP D0 D1 M0\nLD M3\nOUT Y1\nEND", 5, "M3", "read but never driven")


def test_unused_labels_and_repeated_steps() -> None:
    assert only_finding("P5\nLD X0\nOUT Y0\nEND", 1, "label P5 is never used", "; ")
    twice = "LD M8002\nSET S0\nSTL S0\nOUT Y0\nSTL S0\nOUT Y1\nRET\nEND"
    assert only_finding(twice, 5, "STL S0", "line 3", "; ")


def test_an_input_has_one_fast_function() -> None:
    text = "LD M8000\nOUT C235 K5\nOUT C251 K5\nFEND\nI101\nLD M8000\nOUT Y0\nIRET\nEND"
    errors = [finding for finding in check(read_il(text)) if finding.severity == "error"]
    assert [(finding.line, finding.text) for finding in errors] == [
        (3, "C251 and C235 both use X0; an input has only one fast function"),
        (5, "I101 and C251 both use X1; an input has only one fast function"),
    ]
    assert not check(read_il("LD C235\nOUT Y0\nLD M8000\nOUT C235 K5\nSPD X1 K20 D0\nEND"))


def test_program_exceeding_the_steps_of_an_fx2n() -> None:
    full = "LD X0\nOUT Y0\n" * 3999 + "SET Y1\nEND"
    assert "error" not in {finding.severity for finding in check(read_il(full))}
    beyond = check(read_il(full.replace("END", "NOP\nEND")))
    (finding,) = (finding for finding in beyond if finding.severity == "error")
    remedy = "shorten it, or fit a memory cassette of 16000 steps (general knowledge)"
    assert finding == Finding("error", 8001, f"the program has 8001 steps, but an FX2N has only 8000; {remedy}")
    (beyond_the_cassette,) = (
        finding
        for finding in check(read_il(full.replace("END", "NOP\n" * 8001 + "END")))
        if finding.severity == "error"
    )
    assert beyond_the_cassette.text.endswith("has only 8000; shorten it")


def test_findings_are_in_line_order() -> None:
    lines = [line for line, _ in found("LD M5\nOUT Y0\nLD T6\nOUT Y0\nP1\nLD C9\nOUT M7\nEND")]
    assert lines == [1, 3, 4, 5, 6, 7]


def test_usage_counts_each_device_once_without_special_devices() -> None:
    used = usage(read_il("LD X0\nOR X0\nOR M8013\nMOV K4M0 D0\nOUT T0 K5\nOUT C0 D0\nSET S20\nMOV D8013 D9\nEND"))
    assert used.devices == {"X": 1, "Y": 0, "M": 16, "S": 1, "T": 1, "C": 1, "D": 2}
    assert used.steps == 1 + 1 + 1 + 5 + 3 + 3 + 2 + 5 + 1
    assert str(used).startswith("22 of 8000 steps, 1 of 256 X, 0 of 256 Y, 16 of 3072 M")


@pytest.mark.parametrize(("kind", "count"), [("X", 256), ("M", 3072), ("S", 1000), ("T", 256), ("C", 256), ("D", 8000)])
def test_devices_of_an_fx2n(kind: str, count: int) -> None:
    assert available(kind) == count


def test_a_program_with_loops_and_calls() -> None:
    assert [line for line, _ in found(FLOW)] == [10]


def test_a_ladder_block_that_gx_works2_cannot_edit_is_reported_with_its_first_line() -> None:
    contacts = "LD X0\n" + "OR X1\n" * 23
    assert found(f"LD X1\nOUT Y1\n{contacts}OUT Y0\nEND") == []
    assert only_finding(f"LD X1\nOUT Y1\n{contacts}OR X2\nOUT Y0\nEND", 3, "has 25 lines", "at most 24; ")
    wide = "LD X0\nLD X1\n" + "AND X1\n" * 11 + "ORB\nOUT Y0\nEND"
    assert only_finding(wide, 1, "12 cells wide", "of 11 cells; ")
    nested = "LD X0\n" + "AND X1\nOR X2\n" * 1500 + "OUT Y1\nEND"
    assert any("nested too deeply" in text for _, text in found(nested))


def test_matrix_drives_the_relays_of_all_rows() -> None:
    read = "".join(f"LD M{number}\nOUT Y{number % 8}\n" for number in (30, 37, 40, 47))
    text = f"LD X0\nMTR X20 Y20 M30 K2\n{read}END"
    assert not [line for line, message in found(text) if "never driven" in message]
    assert only_finding(text.replace("LD M47", "LD M48"), 9, "M48", "read but never driven")
