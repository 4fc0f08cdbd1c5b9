"""Program part of a GX Developer project: vectors, round trip, damaged files, and the projects of other programs.

The vectors are written by hand from the tables of source [13] and the published projects [52] of docs/sources/fx2n.md.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.fx.language.cpu_model import FX2N, FX3U, CpuModel
from controller.fx.language.il import read_il
from controller.fx.language.instruction import Ladder, LadderError
from controller.fx.language.instruction_set import steps
from controller.fx.language.reading import load_ladder
from controller.fx.language.wpg import CPU_OFFSET, HEADER_BYTES, MEMORY_BLOCK, NOP, SUBHEADER, encode, read_wpg
from tests.sampling import examples

FX2N_CODE, FX3U_CODE = 0x05, 0x08


def header(cpu: int = FX2N_CODE, series: int = 2, mode: int = 1) -> bytes:
    data = bytearray(b"\x40\x00\x22\x01" + b" " * 32 + b"\x04\x02\x08\x02\x03\x03\x01" + b"\xff" * 21)
    data[CPU_OFFSET], data[CPU_OFFSET + 1], data[CPU_OFFSET + 4] = cpu, series, mode
    assert len(data) == HEADER_BYTES
    return bytes(data) + SUBHEADER


def filled(used: int) -> bytes:
    """Return the NOP that fill a program memory after this number of steps."""
    return NOP * (-used % MEMORY_BLOCK)


def wpg(ladder: Ladder) -> bytes:
    code, used = FX3U_CODE if ladder.cpu is FX3U else FX2N_CODE, sum(map(steps, ladder.instructions))
    return header(code) + b"".join(map(encode, ladder.instructions)) + filled(used)


VECTOR = """
03 00 03 04 9c 00 04
03 0d 03 04 90 05 04
06 40 05 03 11 06 04 a8 0a 04 04 e8 00 04
04 21 03 04 04 c2 00 04 05 e8 f4 01 05
03 00 03 04 9c 08 04
05 4c 05 00 05 04 ea 1f 04 04 f1 04 04 04 90 64 04
05 49 07 28 05 04 a8 00 04 04 f4 02 04 05 a8 e8 03 05 04 a8 01 04
03 34 03
"""


def test_vector() -> None:
    """A file written by hand: codes, steps, prefixes before the device, numbers with the low byte first."""
    data = header() + bytes.fromhex(VECTOR) + filled(1 + 1 + 5 + 3 + 1 + 5 + 7 + 1)
    text = "LD X0\nANI M5\nAND>= D10 K0\nOUT T0 K500\nLD X10\nMOV H1F K4M100\nADD D0 D1000V2 D1\nEND"
    assert read_wpg(data) == read_il(text)


CODES = {
    "LD X0": "03 00 03",
    "LDI X0": "03 01 03",
    "LDP X0": "04 02 02 04",
    "LDF X0": "04 03 02 04",
    "OR X0": "03 06 03",
    "ORI X0": "03 07 03",
    "ORP X0": "04 08 02 04",
    "ORF X0": "04 09 02 04",
    "AND X0": "03 0c 03",
    "ANDP X0": "04 0e 02 04",
    "ANDF X0": "04 0f 02 04",
    "OUT Y0": "03 20 03",
    "SET S0": "04 23 02 04",
    "RST Y0": "03 24 03",
    "DADD D0 D2 D4": "05 49 0d 29 05",
    "DSUB D0 D2 D4": "05 49 0d 2b 05",
    "MUL D0 D2 D4": "05 49 07 2c 05",
    "DIV D0 D2 D4": "05 49 07 2e 05",
    "DDIV D0 D2 D4": "05 49 0d 2f 05",
    "DINC D0": "05 4a 05 01 05",
    "DDEC D0": "05 4a 05 03 05",
    "DMOV D0 D2": "05 4c 09 01 05",
    "ZRST M0 M5": "05 53 05 19 05",
    "TO K0 K0 D0 K1": "05 56 09 02 05",
    "LD> D0 D1": "06 40 05 02 10 06",
    "AND<> D0 D1": "06 40 05 01 11 06",
    "OR<= D0 D1": "06 40 05 05 12 06",
    "LDD= D0 D2": "06 40 09 06 10 06",
}


@pytest.mark.parametrize("line", CODES)
def test_code_of_an_instruction(line: str) -> None:
    contact = line.startswith(("LD", "OR", "AND"))
    text = f"LD X1\n{line}\nOUT Y1\nEND" if contact else f"LD X1\n{line}\nEND"
    instruction = next(each for each in read_il(text.replace("LD X1\nLD", "LD")).instructions if str(each) == line)
    code = bytes.fromhex(CODES[line])
    assert encode(instruction)[: len(code)] == code


def test_labels_and_statements() -> None:
    statement = bytes.fromhex("08 80 00 53 54 4f 50 08")
    label, target = bytes.fromhex("03 3c 03 04 d0 05 04"), bytes.fromhex("03 00 03 04 9c 00 04 03 20 03 04 9d 00 04")
    ladder = read_wpg(header() + label + statement + target + bytes.fromhex("03 34 03") + filled(4))
    assert ladder == read_il("P5\nLD X0\nOUT Y0\nEND")
    assert ladder.titles == {1: "STOP"}


PROGRAM = """\
LD X0
AND M1600
MPS
OUT Y17
MPP
OUT C200 K-70000
LDI T0
ORI X1
ORP X2
ANDF X3
ORF S899
LDP M0
ORB
LDD>= D0 K100000
ANB
SET S20
LD< D0V1 Z3
CALL P3
DWAND D0 HFFFF0000 D4
DADD D0 K100000 D4
DDIV D4 K-3 D10
BMOV D0 D10 K4
FROM K0 K9 D0 K4
FEND
P3
FOR K5
LD M8000
DEC D5Z7
DINC D6
DDEC D6
NEXT
SRET
I001
LD M8000
RST C235
IRET
END
"""


def test_round_trip() -> None:
    ladder = read_il(PROGRAM)
    assert read_wpg(wpg(ladder)) == ladder
    fx3u = read_il("LD D5.F\nDEMOV E-1.5 D0\nOUT M7679\nEND", cpu=FX3U)
    assert read_wpg(wpg(fx3u), cpu=FX3U) == fx3u


LINES = (
    *("LD X0", "LDI X377", "LD M3071", "LDP M8013", "LD= D0 K-5", "LDD<= C200 K70000", "LD<> K4M0 H1F"),
    *("AND Y0", "ANDP T0", "ORF C0", "OR S999", "AND> D0V7 Z1", "OUT Y1", "OUT M2000", "OUT T250 D5", "SET S20"),
    *(
        "OUT C255 K-1",
        "RST D7999",
        "RST V3",
        "MOV HFFFF K4Y0Z0",
        "DMOV K-1 D0",
        "INC D0Z0",
        "DEADD D0 D2 D4",
        "ZRST M0 M9",
    ),
)


@examples(60, nightly=2_000)
@given(
    st.lists(
        st.tuples(st.sampled_from(LINES[:7]), st.sampled_from(LINES[7:12]), st.sampled_from(LINES[12:])), min_size=1
    )
)
def test_round_trip_of_any_rungs(rungs: list[tuple[str, str, str]]) -> None:
    ladder = read_il("\n".join(line for rung in rungs for line in rung) + "\nEND")
    assert read_wpg(wpg(ladder)) == ladder


@examples(100, nightly=5_000)
@given(st.data())
def test_damaged_file_is_refused_in_one_line_or_is_another_program(data: st.DataObject) -> None:
    """No damage goes unnoticed: what is read encodes to exactly the damaged bytes."""
    good = wpg(read_il(PROGRAM))
    at = data.draw(st.integers(len(header()), len(good) - 1) | st.integers(len(header()), len(header()) + 300))
    bad = good[:at] + bytes((data.draw(st.integers(0, 255)),)) + good[at + 1 :]
    if data.draw(st.booleans()):
        bad = bad[:at]
    errors: list[str] = []
    try:
        ladder = read_wpg(bad, "a.wpg")
        assert wpg(ladder) == bad
    except LadderError as error:
        errors = str(error).splitlines()
    assert all(line.startswith("a.wpg:") and "; " in line for line in errors)


def message(data: bytes, cpu: CpuModel = FX2N) -> str:
    with pytest.raises(LadderError) as caught:
        read_wpg(data, "a.wpg", cpu)
    (line,) = str(caught.value).splitlines()
    return line


def test_damage_is_named() -> None:
    good = wpg(read_il(PROGRAM))
    steps = good.replace(bytes.fromhex("04 23 02 04"), bytes.fromhex("04 23 03 04"))
    assert steps != good
    start = len(header())
    assert "SET S20 has another step count or form than in an FX2N" in message(steps)
    assert "the token 4c 05 77 is unknown" in message(good[:start] + bytes.fromhex("05 4c 05 77 05") + good[start:])
    assert "the operand 77 00 of LD is unknown" in message(good[:start] + bytes.fromhex("03 00 03 04 77 00 04"))
    assert "the file is truncated" in message(good[: start + 5])
    assert "END is missing" in message(good[: start + 7] + bytes.fromhex("03 20 03 04 9d 00 04"))
    assert "there is a token after END" in message(good + bytes.fromhex("03 18 03"))
    assert "499 steps with NOP do not fill a program memory; the file is truncated" in message(good[:-2])
    assert "X400 does not exist" in message(good[:start] + bytes.fromhex("03 00 03 05 9c 00 01 05"))


def test_header_is_checked() -> None:
    body = bytes.fromhex("03 34 03")
    assert "use --cpu fx3u" in message(header(FX3U_CODE) + body)
    assert "use --cpu fx2n" in message(header() + body, FX3U)
    assert "a program for an FX1S; change the PLC type" in message(header(6) + body)
    assert "an unknown PLC (type 0F)" in message(header(0x0F) + body)
    assert "another series" in message(header(series=1) + body)
    assert "SFC program" in message(header(mode=0) + body)
    assert "not the program part" in message(b"\x40\x00" + body)
    assert "unknown bytes after the header" in message(header()[:-1] + b"\x00" + body)


def test_file_is_detected_by_content_and_name(tmp_path: Path) -> None:
    ladder = read_il(PROGRAM)
    for name in ("MAIN.wpg", "program.bin"):
        path = tmp_path / name
        path.write_bytes(wpg(ladder))
        assert load_ladder(path) == ladder


@pytest.mark.parametrize(
    ("name", "data", "text"),
    [
        ("a.gxw", b"", "GX Works2 project; open it in GX Works2 and use Write to CSV File"),
        ("a.bin", bytes.fromhex("d0cf11e0a1b11ae1") + b"\0" * 1_200_000, "GX Works2 project"),
        ("A.GX3", b"PK", "GX Works3 project"),
        ("gppw.gpj", b"x", "GX Developer project file; use the file MAIN.wpg"),
        ("param.wpa", b"x", "GX Developer parameter file"),
        ("a.pmw", b"x", "FXGP/WIN program"),
        ("a.wpg", b"LD X0\nOUT Y0\nEND\n", "not the program part of a GX Developer project"),
    ],
)
def test_projects_of_other_programs_are_named(tmp_path: Path, name: str, data: bytes, text: str) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(LadderError) as caught:
        load_ladder(path)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{path}:1:1: file: ")
    assert text in line
