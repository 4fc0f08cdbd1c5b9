"""Instruction lists: accepted text, errors and their messages, write-read round trips."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.fx.language.il import read_il, write_il
from controller.fx.language.instruction import (
    Constant,
    DeviceOperand,
    Digits,
    Instruction,
    Ladder,
    LadderError,
    Nest,
    Operand,
    Pointer,
)
from controller.fx.language.operand_rules import OperandError
from controller.fx.language.parsing import parse_operand
from controller.fx.language.reading import LARGEST_BYTES, load_ladder
from tests.controller.fx.language.fx_samples import SAMPLES, SELF_HOLDING


def all_fields(ladder: Ladder) -> tuple[object, ...]:
    """Return all fields of a program, including those ignored in comparisons."""
    notes = [instruction.note for instruction in ladder.instructions]
    return ladder.instructions, notes, ladder.titles, ladder.comments


def findings(text: str) -> list[str]:
    with pytest.raises(LadderError) as caught:
        read_il(text, "a.il")
    return str(caught.value).split("\n")


OPERANDS: list[tuple[str, Operand]] = [
    ("X0", DeviceOperand("X", 0)),
    ("X10", DeviceOperand("X", 8)),
    ("x0000377", DeviceOperand("X", 255)),
    ("Y017", DeviceOperand("Y", 15)),
    ("M3071", DeviceOperand("M", 3071)),
    ("M8255", DeviceOperand("M", 8255)),
    ("S999", DeviceOperand("S", 999)),
    ("T255", DeviceOperand("T", 255)),
    ("c200", DeviceOperand("C", 200)),
    ("D7999", DeviceOperand("D", 7999)),
    ("D20V0", DeviceOperand("D", 20, "V0")),
    ("d20v", DeviceOperand("D", 20, "V0")),
    ("D20Z7", DeviceOperand("D", 20, "Z7")),
    ("V", DeviceOperand("V", 0)),
    ("Z7", DeviceOperand("Z", 7)),
    ("K-32768", Constant(-32768)),
    ("k10z2", Constant(10, "K", "Z2")),
    ("H0ED", Constant(0xED, "H")),
    ("hffffffff", Constant(0xFFFFFFFF, "H")),
    ("H10V", Constant(16, "H", "V0")),
    ("K4M0", Digits(4, DeviceOperand("M", 0))),
    ("K2X010", Digits(2, DeviceOperand("X", 8))),
    ("K1M10Z", Digits(1, DeviceOperand("M", 10, "Z0"))),
    ("P127", Pointer("P", 127)),
    ("N7", Nest(7)),
]


@pytest.mark.parametrize(("text", "operand"), OPERANDS)
def test_operand(text: str, operand: Operand) -> None:
    assert parse_operand(text) == operand
    assert parse_operand(str(operand)) == operand


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("X8", "octal"),
        ("Y400", "Y0 to Y377"),
        ("M3072", "M0 to M3071 and M8000 to M8255"),
        ("M7999", "M0 to M3071"),
        ("M8256", "M8000 to M8255"),
        ("S1000", "S0 to S999"),
        ("T256", "T0 to T255"),
        ("D8256", "D0 to D8255"),
        ("V8", "V0 to V7"),
        ("D0Z8", "not an operand"),
        ("N8", "N0 to N7"),
        ("P128", "P0 to P127"),
        ("D100.F", "--cpu fx3u"),
        ("I600", "I610 to I899"),
        ("D0.10", "not an operand"),
        ("E1.5", "FX3"),
        ("R100", "FX3"),
        ("U0\\G5", "FX3"),
        ("K", "not an operand"),
        ("K--1", "not an operand"),
        ("Q0", "not an operand"),
        ("X", "not an operand"),
        ("X-1", "not an operand"),
        ("X٣", "not an operand"),
        ("ſ0", "not an operand"),
        ("K" + "9" * 5000, "not an operand"),
    ],
)
def test_invalid_operand(text: str, part: str) -> None:
    with pytest.raises(OperandError) as caught:
        parse_operand(text)
    assert part in str(caught.value)
    assert "; " in str(caught.value)


def test_parsed_instructions() -> None:
    ladder = read_il(SELF_HOLDING, "belt.il")
    assert ladder.instructions == (
        Instruction("LD", (DeviceOperand("X", 0),)),
        Instruction("OR", (DeviceOperand("Y", 0),)),
        Instruction("AND", (DeviceOperand("X", 1),)),
        Instruction("OUT", (DeviceOperand("Y", 0),)),
        Instruction("LD", (DeviceOperand("Y", 0),)),
        Instruction("OUT", (DeviceOperand("T", 0), Constant(50))),
        Instruction("LD", (DeviceOperand("T", 0),)),
        Instruction("OUT", (DeviceOperand("Y", 1),)),
        Instruction("END"),
    )
    assert [instruction.line for instruction in ladder.instructions] == [6, 7, 8, 9, 11, 12, 13, 14, 15]
    assert ladder.instructions[0].note == "pressed"
    assert ladder.titles == {0: "conveyor on and off", 4: "running long enough"}
    assert ladder.comments == {"X0": "start button", "X1": "stop button, opens", "Y0": "conveyor contactor"}
    assert ladder.source == "belt.il"


@pytest.mark.parametrize(
    "text",
    [
        "LD X0\nMOV K5 D0\nP1\nLDD= D0 D2\nOUT Y0\nEND",
        "ld x000\r\nmov k5,d0\r\np1:\r\nldd= d0, d2\r\nout y0\r\nend\r\n",
        "0 LD\tX0\n  1 MOV K0005\tD0 // five\n6 P1:\n7 DLD= D0 D2 ' both\n16 OUT Y000 ; out\n17 END (* over *)\n\n",
        "LD X0\rMOV H5 , D0\rP1\rdld= D0 D2\rOUT Y0\rEND\r; behind it",
    ],
)
def test_spellings_of_one_program(text: str) -> None:
    ladder = read_il(text)
    five = ladder.instructions[1].operands[0]
    assert isinstance(five, Constant)
    assert five.value == 5
    assert [str(instruction) for instruction in ladder.instructions if instruction.name != "MOV"] == [
        "LD X0",
        "P1",
        "LDD= D0 D2",
        "OUT Y0",
        "END",
    ]
    assert ladder.instructions[2] == Instruction("P", (Pointer("P", 1),))


def test_position_determines_the_meaning_of_a_comment() -> None:
    ladder = read_il(
        "; a header, ignored\n\n; first\n// second\nLD X0 ;  a   note\n\n;; X0 = no device comment\nOUT Y0 // ; odd\n"
        "; X8 = is no device\n(* m0 = lower case *)\nEND\n; X007=last\n"
    )
    assert ladder.titles == {0: "first\nsecond", 1: "X0 = no device comment", 2: "X8 = is no device"}
    assert [instruction.note for instruction in ladder.instructions] == ["a note", "; odd", ""]
    assert ladder.comments == {"M0": "lower case", "X7": "last"}


@pytest.mark.parametrize("sample", SAMPLES)
@pytest.mark.parametrize("step_numbers", [True, False])
def test_write_read_round_trip(sample: str, step_numbers: bool) -> None:
    ladder = read_il(sample)
    text = write_il(ladder, step_numbers=step_numbers)
    again = read_il(text)
    assert all_fields(again) == all_fields(ladder)
    assert write_il(again, step_numbers=step_numbers) == text


def test_written_text() -> None:
    ladder = read_il("; X0 = start\n; one\n; two\nLD X000 // now\nOUT T0,K5\n;; X1 = odd\nP1:\nEND")
    assert write_il(ladder) == (
        "; X0 = start\n\n; one\n; two\n    0 LD X0 ; now\n    1 OUT T0 K5\n\n;; X1 = odd\n    4 P1\n    5 END\n"
    )
    assert write_il(read_il("; one\nEND"), step_numbers=False) == "; one\nEND\n"


TEXTS = st.text(max_size=30)


@given(
    titles=st.dictionaries(st.integers(0, 2), TEXTS | st.sampled_from(["X0 = a", "; a", "a\nb", ";; b", "(* c"])),
    note=TEXTS,
    comments=st.dictionaries(st.sampled_from(["X10", "M0", "Z7", "D8000"]), TEXTS),
)
def test_titles_notes_and_comments_round_trip(titles: dict[int, str], note: str, comments: dict[str, str]) -> None:
    contact = Instruction("LD", (DeviceOperand("X", 0),), note=note)
    ladder = Ladder((contact, Instruction("OUT", (DeviceOperand("Y", 8),)), Instruction("END")), titles, comments)
    once = read_il(write_il(ladder))
    assert once == ladder
    assert " ".join(note.split()) == once.instructions[0].note
    assert {key: text.split() for key, text in titles.items() if text.split()} == {
        key: text.split() for key, text in once.titles.items()
    }
    assert {key: text.split() for key, text in comments.items() if text.split()} == {
        key: text.split() for key, text in once.comments.items()
    }
    assert all_fields(read_il(write_il(once))) == all_fields(once)


def test_step_count_of_an_fx2n() -> None:
    text = write_il(read_il("LDP X0\nOUT T0 K5\nDMOV D0 D2\nLD M0\nALT M1\nP5\nLD M2000\nMC N0 M0\nMCR N0\nEND"))
    assert [int(line.split()[0]) for line in text.splitlines()] == [0, 2, 5, 14, 15, 18, 19, 21, 24, 26]


TEXT_ERRORS = [
    ("LD X8\nEND", "1:4: LD X8: X8 has a digit 8 or 9"),
    ("  12 LD X0, X1\nEND", "1:6: LD X0 X1: has 2 operands; expected LD contact"),
    ("MVO K1 D0\nEND", "1:1: MVO K1 D0: MVO is not an instruction; did you mean MOV?"),
    ("LD X0\nMEP\nEND", "2:1: MEP: MEP exists only on an FX3"),
    ("LD X0\nDEMOVP D0 D2\nEND", "2:1: DEMOVP D0 D2: DEMOVP exists only on an FX3"),
    ("LD X0\nDEADD E1 D0 D2\nEND", "2:7: DEADD E1 D0 D2: E1 is a real number (E), which only an FX3U has"),
    ("TMR T0 K5\nEND", "1:1: TMR T0 K5: an FX2N has no TMR; write OUT T0 K10"),
    ("PR Y0 M0\nEND", "1:1: PR Y0 M0: this engine does not support PR"),
    ("LD X0\nDI\nEND", "2:1: DI: the circuit before it has no output"),
    ("I001\nEND", "1:1: I001: not allowed in the main program"),
    ("LD X0\nDRVI K5 K100 Y0 Y4\nEND", "2:1: DRVI K5 K100 Y0 Y4: DRVI exists only on an FX3U; use --cpu fx3u"),
    ("LD X0\nOUT X1\nEND", "2:5: OUT X1: X1 is an input and cannot be driven"),
    ("LD X0\nOUT T0\nEND", "2:1: OUT T0: the preset of T0 is missing"),
    ("LD X0\nOUT T0 K0\nEND", "2:1: OUT T0 K0: K0 is not a valid preset"),
    ("LD X0\nOUT C199 K32768\nEND", "2:10: OUT C199 K32768: K32768 does not fit into 16 bits"),
    ("LD X0\nOUT Y0 K5\nEND", "2:1: OUT Y0 K5: Y0 takes no preset"),
    ("LD X0V0\nEND", "1:4: LD X0V0: X0V0 has an index, which only an FX3 accepts"),
    ("LD X0\nMOV K32768 D0\nEND", "2:5: MOV K32768 D0: K32768 does not fit into 16 bits"),
    ("LD X0\nMOV H10000 D0\nEND", "2:5: MOV H10000 D0: H10000 does not fit into 16 bits; expected H0 to HFFFF"),
    ("LD X0\nDMOV K2147483648 D0\nEND", "2:6: DMOV K2147483648 D0: K2147483648 does not fit into 32 bits"),
    ("LD X0\nMOV K5M0 D0\nEND", "2:5: MOV K5M0 D0: K5M0 has 5 digits; expected K1 to K4"),
    ("LD X0\nDMOV K9M0 D0\nEND", "2:6: DMOV K9M0 D0: K9M0 has 9 digits; expected K1 to K8"),
    ("LD X0\nMOV K0M0 D0\nEND", "2:5: MOV K0M0 D0: K0M0 has 0 digits"),
    ("LD X0\nMOV K4M3057 D0\nEND", "2:5: MOV K4M3057 D0: 16 devices starting at M3057 extend beyond M3071"),
    ("LD X0\nMOV K2X371 D0\nEND", "2:5: MOV K2X371 D0: 8 devices starting at X371 extend beyond X377"),
    ("LD X0\nMOV D0 K2X0\nEND", "2:8: MOV D0 K2X0: K2X0 cannot be the target of MOV"),
    ("LD X0\nDMOV D7999 D0\nEND", "2:6: DMOV D7999 D0: 2 devices starting at D7999 extend beyond D7999"),
    ("LD X0\nDMOV D0 V1\nEND", "2:9: DMOV D0 V1: V1 is the high half of a 32-bit number; write Z1"),
    ("LD X0\nMOV C200 D0\nEND", "2:5: MOV C200 D0: C200 has 32 bits"),
    ("LD X0\nCMP D0 D1 M3070\nEND", "2:11: CMP D0 D1 M3070: 3 devices starting at M3070 extend beyond M3071"),
    ("LD X0\nROR D0 K17\nEND", "2:8: ROR D0 K17: 17 is outside its range; expected K1 to K16"),
    ("LD X0\nANS T200 K1 S900\nEND", "2:1: ANS T200 K1 S900: T200 is not a 100 ms timer"),
    ("LD X0\nANS T0 K1 S899\nEND", "2:1: ANS T0 K1 S899: S899 is not an annunciator"),
    ("LD X0\nZRST M10 M9\nEND", "2:1: ZRST M10 M9: M10 is after M9"),
    ("LD X0\nZRST C199 C200\nEND", "2:1: ZRST C199 C200: C199 and C200 are of different kinds"),
    ("LD X0\nREFP X4 K8\nEND", "2:1: REFP X4 K8: X4 is not the first of a group of eight"),
    ("LD X0\nREF X0 K12\nEND", "2:1: REF X0 K12: K12 is not a multiple of eight"),
    ("LD X0\nIST X20 S30 S20\nEND", "2:1: IST X20 S30 S20: S30 and S20 are not a range of automatic steps"),
    ("LD X0\nIST X20 S19 S29\nEND", "2:1: IST X20 S19 S29: S19 and S29 are not a range of automatic steps"),
    ("LD X0\nIST X20 S20 S900\nEND", "2:1: IST X20 S20 S900: S20 and S900 are not a range of automatic steps"),
    ("LD X0 and X1\nEND", "1:7: LD X0 and X1: and is a second instruction; write it on the next line"),
    ("LD X0\nDPLSY K1 K1 Y2\nEND", "2:1: DPLSY K1 K1 Y2: Y2 is not a pulse output"),
    ("LD X0\nSFTLP X1 M0 K4 K5\nEND", "2:1: SFTLP X1 M0 K4 K5: K5 is more than the 4"),
    ("LD X0\nPLS M8000\nEND", "2:1: PLS M8000: M8000 is a special relay"),
    ("STL S900\nRET\nEND", "1:1: STL S900: S900 is an annunciator"),
    ("5 LD X0\n5 OUT Y0\n6 END", "2:1: 5 OUT Y0: step 5 follows step 5; step numbers must increase"),
    ("7\nLD X0\nOUT Y0\nEND", "1:1: 7: there is no instruction after the step number"),
    ("P1 LD X0\nEND", "1:4: P1: there is text after the label"),
    ("P63\nEND", "1:1: P63: P63 is END and needs no label"),
    ("P200\nEND", "1:1: P200: P200 does not exist on an FX2N"),
    ("LD X0 (* open\nEND", "1:9: (*: the comment is not closed"),
    ("(* a *) LD X0\nEND", "1:8: (*: there is text after the comment"),
    ("L\x00D X0\nEND", "1:1: L\\x00D X0: L\\x00D is not an instruction"),
]
STRUCTURE_ERRORS = [
    ("", "1:1: END: END is missing"),
    ("LD X0\nOUT Y0\n", "2:1: OUT Y0: END is missing"),
    ("END\n; fine\n\nLD X0", "4:1: LD X0: not executed after END"),
    ("LD X0\nEND", "2:1: END: the circuit before it has no output"),
    ("OUT Y0\nEND", "1:1: OUT Y0: there is no contact before the output"),
    ("LD X0\nOUT Y0\nRET\nEND", "3:1: RET: no step is open"),
    ("AND X0\nOUT Y0\nEND", "1:1: AND X0: there is no contact before it"),
    ("LD X0\nLD X1\nOUT Y0\nEND", "3:1: OUT Y0: 2 blocks are open"),
    ("LD X0\nANB\nOUT Y0\nEND", "2:1: ANB: there is only one block"),
    ("LD X0\nLD X1\nORB\nORB\nOUT Y0\nEND", "4:1: ORB: there is only one block"),
    ("LD X0\n" * 9 + "ORB\n" * 8 + "OUT Y0\nEND", "9:1: LD X0: more than 8 blocks are open"),
    ("LD X0\nOUT Y0\nOR X1\nOUT Y1\nEND", "3:1: OR X1: nothing can be parallel to an output"),
    ("LD X0\nMPS\nLD X1\nORB\nOUT Y0\nMPP\nOUT Y1\nEND", "4:1: ORB: nothing can be parallel"),
    ("LD X0\nMPS\nOUT Y0\nEND", "4:1: END: 1 of its branches are open"),
    ("LD X0\nMPS\nOUT Y0\nLD X1\nOUT Y1\nEND", "4:1: LD X1: 1 of its branches are open"),
    ("LD X0\nOUT Y0\nMPP\nOUT Y1\nEND", "3:1: MPP: no branch is open"),
    ("LD X0\nMRD\nOUT Y1\nEND", "2:1: MRD: no branch is open"),
    ("LD X0\nMPS\nAND X1\nMPP\nOUT Y1\nEND", "4:1: MPP: the branch before it has no output"),
    ("LD X0\nMPS\nLD X1\nMPS\nOUT Y0\nMPP\nOUT Y1\nMPP\nOUT Y2\nEND", "4:1: MPS: 2 blocks are open"),
    (
        "LD X0\n" + "MPS\nAND X1\n" * 12 + "OUT Y0\n" + "MPP\nOUT Y0\n" * 11 + "END",
        "24:1: MPS: more than 11 branches are open",
    ),
    ("STL S0\nMPS\nOUT Y0\nMPP\nOUT Y1\nRET\nEND", "2:1: MPS: there is no contact before it"),
    ("LD X0\nMC N1 M0\nMCR N1\nEND", "2:1: MC N1 M0: levels are opened in order; expected N0"),
    (
        "LD X0\nMC N0 M0\nLD X1\nMC N1 M1\nMCR N0\nMCR N1\nEND",
        "6:1: MCR N1: no level is open; write MC N1 first",
    ),
    ("MCR N0\nEND", "1:1: MCR N0: no level is open"),
    ("LD X0\nMC N0 M0\nEND", "3:1: END: master control is open; write MCR N0"),
    ("LD X0\nMC N0 M0\nOUT Y0\nMCR N0\nEND", "3:1: OUT Y0: there is no contact before the output"),
    ("STL S0\nLD X0\nMC N0 M0\nRET\nMCR N0\nEND", "3:1: MC N0 M0: master control cannot be used in a step"),
    ("LD X0\nMC N0 M0\nSTL S0\nMCR N0\nRET\nEND", "4:1: MCR N0: master control cannot be used in a step"),
    ("STL S0\nOUT Y0\nEND", "3:1: END: a step is open; write RET"),
    ("STL S0\nOUT Y0\nFEND\nEND", "3:1: FEND: a step is open; write RET"),
    ("".join(f"STL S{n}\n" for n in range(9)) + "RET\nEND", "9:1: STL S8: more than 8 steps are joined"),
    ("STL S0\nLD X0\nOUT Y0\nFOR K2\nSTL S1\nNEXT\nRET\nEND", "5:1: STL S1: a loop is open here"),
    ("FOR K2\nEND", "2:1: END: a loop is open; write its NEXT"),
    ("NEXT\nEND", "1:1: NEXT: no loop is open"),
    ("FOR K2\n" * 6 + "NEXT\n" * 6 + "END", "6:1: FOR K2: more than 5 loops are open"),
    ("LD X0\nCJ P1\nEND", "2:1: CJ P1: label P1 is missing"),
    ("LD X0\nCALL P1\nP1\nFEND\nEND", "2:1: CALL P1: P1 is in the main program"),
    ("SRET\nEND", "1:1: SRET: not allowed in the main program"),
    ("P1\nP2\n\nP1\nEND", "4:1: P1: the label is already defined on line 1"),
]


@pytest.mark.parametrize(("text", "start"), [*TEXT_ERRORS, *STRUCTURE_ERRORS])
def test_error_has_location_reason_and_remedy(text: str, start: str) -> None:
    found = findings(text)
    assert found[0].startswith(f"a.il:{start}")
    assert all("; " in line for line in found)


@pytest.mark.parametrize(
    "text",
    [
        "LD X0\n" * 8 + "ORB\n" * 7 + "OUT Y0\nEND",
        "LD X0\n" + "MPS\nAND X1\n" * 11 + "OUT Y0\n" + "MPP\nOUT Y0\n" * 11 + "END",
        "FOR K2\n" * 5 + "NEXT\n" * 5 + "END",
        "".join(f"STL S{n}\n" for n in range(8)) + "OUT Y0\nOUT Y1\nRET\nEND",
        "".join(f"STL S{n}\nOUT Y{n % 8}\n" for n in range(12)) + "RET\nEND",
        "LD X0\nMC N0 M0\nLD X1\nOUT Y0\nMCR N0\nLD X2\nMC N0 M1\nMCR N0\nEND",
        "LD X0\nOUT Y0\nAND X1\nOUT Y1\nMPS\nAND X2\nOUT Y2\nMPP\nINV\nOUT Y3\nEND",
        "LD X0\nMPS\nLD X1\nOR X2\nANB\nOUT Y0\nMPP\nOUT Y1\nEND",
        "LD X0\nNOP\nCJ P63\nWDT\nEND",
        "LD X0\nOUT C200 K-2147483648\nOUT C234 H0FFFFFFFF\nDMOV K8M3040 D7998\nDMOV C200 C0\nMOV K4M8240 D8255\nEND",
        "LD X0\nDROR D0 K32\nDMOV D0 Z7\nMOV D0 V7\nSET S899\nEND",
    ],
)
def test_programs_at_the_limits(text: str) -> None:
    ladder = read_il(text)
    assert all_fields(read_il(write_il(ladder))) == all_fields(ladder)


def test_all_errors_are_reported_in_order() -> None:
    found = findings("LD X8\nMOV K5M0 K0\nFOO\nOUT Y0\nEND")
    assert [line.split(": ")[0] for line in found] == ["a.il:1:4", "a.il:2:5", "a.il:2:10", "a.il:3:1"]


@pytest.mark.parametrize(
    "text",
    [
        "STL S0\nOUT Y0\nFEND\nEND",
        "LD X0\nMC N0 M0\nFEND\nEND",
        "FOR K2\nFEND\nEND",
        "LD X0\nLD X1\nOUT Y0\nOUT Y1\nEND",
        "AND X0\nAND X1\nOUT Y0\nEND",
        "LD X0\nMPS\nOUT Y0\nLD X1\nOUT Y1\nEND",
    ],
)
def test_a_structure_error_is_reported_once(text: str) -> None:
    assert len(findings(text)) == 1


def test_all_structure_errors_are_reported() -> None:
    found = findings("LD X0\nCJ P1\nOUT Y0\nSTL S0\nOUT Y1\nSRET\nEND")
    assert [line.split(": ")[0] for line in found] == ["a.il:2:1", "a.il:6:1", "a.il:7:1"]


def test_file_format_is_detected_from_the_content(tmp_path: Path) -> None:
    path = tmp_path / "belt.txt"
    path.write_text(SELF_HOLDING, encoding="utf-8-sig")
    ladder = load_ladder(path)
    assert all_fields(ladder) == all_fields(read_il(SELF_HOLDING))
    assert ladder.source == str(path)
    path.write_text(SELF_HOLDING, encoding="utf-16")
    assert all_fields(load_ladder(path)) == all_fields(ladder)


@pytest.mark.parametrize(
    ("data", "part"),
    [
        (None, "cannot be read"),
        (b"\x80\x81", "not UTF-8, UTF-16, GBK or Shift-JIS text; save it as UTF-8"),
        (b"\xff\xfea", "not UTF-16 text"),
        (b"LD X0\n\x00\x01", "not a text file (character U+0000)"),
        (b" " * (LARGEST_BYTES + 1), "larger than"),
    ],
)
def test_invalid_file(tmp_path: Path, data: bytes | None, part: str) -> None:
    path = tmp_path / "belt.txt"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(LadderError) as caught:
        load_ladder(path)
    (line,) = str(caught.value).split("\n")
    assert line.startswith(f"{path}:")
    assert part in line
    assert "; " in line


def test_directory_is_an_invalid_file(tmp_path: Path) -> None:
    with pytest.raises(LadderError, match="cannot be read"):
        load_ladder(tmp_path)
