"""GX Works2 CSV files: exact bytes of the writer, tolerance of the reader."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest

from controller.fx.language.gx_csv import COLUMNS, read_gx_csv, write_gx_csv
from controller.fx.language.il import read_il
from controller.fx.language.instruction import LadderError
from controller.fx.language.reading import load_ladder
from tests.controller.fx.language.fx_samples import SAMPLES, SELF_HOLDING

Row = tuple[str, ...]
TAB_HEADER: tuple[Row, ...] = (("MAIN",), ("PLC Information:", "FXCPU FX2N/FX2NC"), COLUMNS)


def encoded(*rows: Row, head: tuple[Row, ...] = TAB_HEADER) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, delimiter="\t", quoting=csv.QUOTE_ALL, lineterminator="\r\n").writerows((*head, *rows))
    return b"\xff\xfe" + text.getvalue().encode("utf-16-le")


def row(
    step: object = "", name: str = "", operand: str = "", *, statement: str = "", pi: str = "", note: str = ""
) -> Row:
    return str(step), statement, name, operand, "", pi, note


def finding(data: bytes) -> str:
    with pytest.raises(LadderError) as caught:
        read_gx_csv(data, "a.csv")
    return str(caught.value).split("\n")[0]


def test_written_bytes() -> None:
    ladder = read_il('; say "go"\nLD X0 ; pressed\nOUT T0 K50\nMOV K2X10 D0V0\nOUT Y17\nEND')
    text = (
        '"lift"\r\n'
        '"PLC Information:"\t"FXCPU FX2N/FX2NC"\r\n'
        '"Step No."\t"Line Statement"\t"Instruction"\t"I/O(Device)"\t"Blank"\t"PI Statement"\t"Note"\r\n'
        '"0"\t"say ""go"""\t""\t""\t""\t""\t""\r\n'
        '"0"\t""\t"LD"\t"X000"\t""\t""\t"pressed"\r\n'
        '"1"\t""\t"OUT"\t"T0"\t""\t""\t""\r\n'
        '""\t""\t""\t"K50"\t""\t""\t""\r\n'
        '"4"\t""\t"MOV"\t"K2X010"\t""\t""\t""\r\n'
        '""\t""\t""\t"D0V0"\t""\t""\t""\r\n'
        '"9"\t""\t"OUT"\t"Y017"\t""\t""\t""\r\n'
        '"10"\t""\t"END"\t""\t""\t""\t""\r\n'
    )
    assert write_gx_csv(ladder, title="lift") == b"\xff\xfe" + text.encode("utf-16-le")


@pytest.mark.parametrize("sample", SAMPLES)
def test_write_read_round_trip(sample: str) -> None:
    ladder = read_il(sample)
    data = write_gx_csv(ladder)
    again = read_gx_csv(data, "x")
    assert again == ladder
    assert again.titles == ladder.titles
    assert [i.note for i in again.instructions] == [i.note for i in ladder.instructions]
    assert again.source == "x"
    assert write_gx_csv(again) == data


def test_titles_of_several_lines_are_several_statements() -> None:
    ladder = read_il("; one\n; two\nLD X0\nOUT Y0\nEND")
    assert read_gx_csv(write_gx_csv(ladder)).titles == {0: "one\ntwo"}


def test_rows_of_a_real_export() -> None:
    head = (
        ("(lift)",),
        ("PLC信息:", "FXCPU FX3U/FX3UC"),
        ("步号", "行间声明", "指令", "I/O(软元件)", "空白栏", "PI声明", "注解"),
    )
    ladder = read_gx_csv(
        encoded(
            row(0, statement="lower"),
            row(0, statement="the arm"),
            row(0, "LD", "X000", note="first"),
            row(note="and more"),
            row(1, "ZRST", "S20"),
            row(operand="S29"),
            row(note="clear"),
            row(6, "FEND"),
            row(7, "P5", pi="subroutine"),
            row(8, "SRET", statement="back"),
            (),
            row(9, "END"),
            head=head,
        )
    )
    assert [str(i) for i in ladder.instructions] == ["LD X0", "ZRST S20 S29", "FEND", "P5", "SRET", "END"]
    assert [i.note for i in ladder.instructions] == ["first and more", "clear", "", "subroutine", "", ""]
    assert ladder.titles == {0: "lower\nthe arm", 4: "back"}
    assert [i.line for i in ladder.instructions] == [6, 8, 11, 12, 13, 15]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "gbk", "cp932"])
@pytest.mark.parametrize("delimiter", ["\t", ",", ";"])
@pytest.mark.parametrize("quoting", [csv.QUOTE_ALL, csv.QUOTE_MINIMAL])
@pytest.mark.parametrize("newline", ["\r\n", "\n"])
def test_formats_of_other_tools(
    tmp_path: Path, encoding: str, delimiter: str, quoting: Literal[0, 1], newline: str
) -> None:
    ladder = replace(read_il(SELF_HOLDING), titles={0: "起動" if encoding == "cp932" else "启动皮带"})
    rows = csv.reader(io.StringIO(write_gx_csv(ladder).decode("utf-16"), newline=""), delimiter="\t")
    text = io.StringIO(newline="")
    csv.writer(text, delimiter=delimiter, quoting=quoting, lineterminator=newline).writerows(rows)
    path = tmp_path / "belt.csv"
    path.write_bytes(text.getvalue().encode(encoding))
    assert load_ladder(path) == ladder
    assert load_ladder(path).titles == ladder.titles
    is_assumed = encoding in ("utf-16-le", "utf-16-be", "gbk", "cp932")
    assert len(load_ladder(path).notes) == is_assumed + (delimiter == ";")


@pytest.mark.parametrize(
    ("rows", "start"),
    [
        ([row(0, "LD", "X8")], "4:4: LD X8: X8 has a digit 8 or 9"),
        ([row(0, "LD", "X0"), row(1, "OUT", "T0"), row(operand="K0")], "5:3: OUT T0 K0: K0 is not a valid preset"),
        ([row(0, "LD", "X0"), row(1, "MOV", "K1"), row(operand="K2")], "6:4: MOV K1 K2: K2 cannot be the target"),
        ([row(0, "TMR", "T0")], "4:3: TMR T0: an FX2N has no TMR"),
        ([row(operand="K5")], "4:4: K5: there is no instruction above it"),
        ([row(0, "LD", "X0"), row(0, "OUT", "Y0")], "5:1: 0 OUT Y0: step 0 follows step 0"),
        ([row("", "LD", "X0")], "4:1: LD X0: the step number is missing"),
        ([row("a", "LD", "X0")], "4:1: a LD X0: a is not a step number"),
        ([row(0, "LD", "X0")[:6]], "4:6: 0 LD X0: the row has 6 fields"),
        ([("0", "", "LD", "X0", "x", "", "")], "4:5: 0 LD X0 x: there is text in the blank column"),
        ([row(0, "LD", "X0"), row(1, "OUT", "Y0")], "5:3: OUT Y0: END is missing"),
        ([row(0, "END"), row(1, statement="behind")], "5:2: 1 behind: no instruction follows the statement"),
        ([row(0, "LD", "X0"), row(1, "END")], "5:3: END: the circuit before it has no output"),
    ],
)
def test_error_has_line_and_column_of_the_field(rows: list[Row], start: str) -> None:
    assert finding(encoded(*rows)).startswith(f"a.csv:{start}")


@pytest.mark.parametrize(
    ("data", "start"),
    [
        (b"", "1:1: file: the three header rows are missing"),
        (
            encoded(head=(("MAIN",), ("PLC:", "QCPU Q00"), COLUMNS)),
            "2:2: PLC: QCPU Q00: the second field does not name an FX CPU",
        ),
        (encoded(head=(("MAIN",), ("PLC:", "FXCPU"), COLUMNS[:6])), "3:1: "),
        (b"\xff\xfe\x00", "1:1: file: not UTF-16 text"),
        (b'"MAIN"\n"\x80"', "2:1: file: not UTF-8, UTF-16, GBK or Shift-JIS text"),
        (b'"MAIN"\n"a"b\n', "2:1: file: cannot be split into fields"),
        (encoded(), "1:1: END: END is missing"),
    ],
)
def test_invalid_file(data: bytes, start: str) -> None:
    line = finding(data)
    assert line.startswith(f"a.csv:{start}")
    assert "; " in line
