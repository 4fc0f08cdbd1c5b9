"""Programs as GX Works2 and GX Developer write and read them with "Write to CSV File" (FX.md 2.1, with its marks).

UTF-16LE with a byte order mark, CRLF, fields between quotation marks with tabs between them, a `""` for a quotation
mark in a field. Three rows of head (title, type of the PLC, names of the seven columns), then a row for each
instruction; each further operand has a row of its own. What a column is follows from its place, since its name is in
the language of the tool. Reading also takes commas for tabs and UTF-8, which other tools write.

A line statement is a title here; a PI statement becomes the note of its pointer. Comments of devices are no part of
this file. That a label stands in the column of the instruction is general knowledge (GK).
"""

from __future__ import annotations

import csv
import io
import re
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from dataclasses import dataclass, field
from typing import Final

from controller.fx.il import numbered, title_lines
from controller.fx.instruction import Device, Digits, Instruction, Ladder, Operand
from controller.fx.parsing import Findings, Token, file_error, one_line, parse_instruction, printable
from controller.fx.structure import Placed, finished

COLUMNS: Final = ("Step No.", "Line Statement", "Instruction", "I/O(Device)", "Blank", "PI Statement", "Note")
STEP, STATEMENT, INSTRUCTION, OPERAND, BLANK, PI_STATEMENT, NOTE = range(7)
_HEAD: Final = 3
_NUMBER: Final = re.compile(r"[0-9]{1,9}")


def decoded(data: bytes, source: str) -> str:
    """Return a text in UTF-16 with a byte order mark, or in UTF-8.

    Raises:
        LadderError: It is neither.
    """
    wide = data.startswith((BOM_UTF16_LE, BOM_UTF16_BE))
    try:
        if wide:
            return data.decode("utf-16")
        return data.removeprefix(BOM_UTF8).decode()
    except UnicodeDecodeError as error:
        wrong = f"is not {'UTF-16' if wide else 'UTF-8'} text; save it as Unicode text (UTF-16) or UTF-8"
        raise file_error(source, wrong, data.count(b"\n", 0, error.start) + 1) from None


@dataclass(slots=True)
class _Open:
    """An instruction whose further rows may still come."""

    name: Token
    operands: list[Token]
    notes: list[str]
    title: list[str]


@dataclass(slots=True)
class _Reader:
    """What was read so far.

    Attributes:
        findings: What is wrong with it.
        program: The instructions that could be read.
        titles: Their titles.
        statements: Line statements in front of the next instruction.
        last_step: The last step number.
        open: The instruction that the next row may belong to.
    """

    findings: Findings
    program: list[Placed] = field(default_factory=list)
    titles: dict[int, str] = field(default_factory=dict)
    statements: list[str] = field(default_factory=list)
    last_step: int = -1
    open: _Open | None = None

    def row(self, line: int, fields: list[str]) -> None:
        """Read one row behind the head."""
        shown = " ".join(text for text in fields if text)
        if not shown.strip():
            return
        if len(fields) != len(COLUMNS):
            wrong = f"the row has {len(fields)} fields; expected the {len(COLUMNS)} of the head"
            self.findings.add(line, min(len(fields), len(COLUMNS)), shown, wrong)
            return
        step, statement, name, operand, blank, pi_statement, note = (one_line(text) for text in fields)
        if blank:
            self.findings.add(line, BLANK + 1, shown, "there is text in the blank column; delete it")
        if step and not _NUMBER.fullmatch(step):
            self.findings.add(line, STEP + 1, shown, f"{printable(step)} is no step number; write a whole number")
        elif name:
            self.step(line, step, shown)
        if name:
            self.close()
            self.open = _Open(Token(name, line, INSTRUCTION + 1), [], [], self.statements)
            self.statements = []
        if statement:
            self.statement(statement, new=bool(name))
        self.belongings(line, operand, [pi_statement, note], shown)

    def step(self, line: int, step: str, shown: str) -> None:
        """Check the step number of an instruction."""
        if not step:
            self.findings.add(line, STEP + 1, shown, "the step number is missing; write it")
            return
        if int(step) <= self.last_step:
            wrong = f"step {step} comes after step {self.last_step}; step numbers must increase"
            self.findings.add(line, STEP + 1, shown, wrong)
        self.last_step = int(step)

    def statement(self, text: str, *, new: bool) -> None:
        """Keep a line statement: that of the instruction in the same row, or of the next one."""
        if new and self.open is not None:
            self.open.title.append(text)
        else:
            self.close()
            self.statements.append(text)

    def belongings(self, line: int, operand: str, notes: list[str], shown: str) -> None:
        """Keep an operand and notes of the open instruction."""
        notes = [note for note in notes if note]
        if not operand and not notes:
            return
        if self.open is None:
            self.findings.add(line, OPERAND + 1, shown, "there is no instruction above it; write it in column 3")
            return
        if operand:
            self.open.operands.append(Token(operand, line, OPERAND + 1))
        self.open.notes.extend(notes)

    def close(self) -> None:
        """Finish the open instruction."""
        if self.open is None:
            return
        name, operands, notes, title = self.open.name, self.open.operands, self.open.notes, self.open.title
        instruction = parse_instruction(name, operands, self.findings, " ".join(notes))
        if instruction is not None:
            if title:
                self.titles[len(self.program)] = "\n".join(title)
            self.program.append(Placed(instruction, INSTRUCTION + 1))
        self.open = None


def read_gx_csv(data: bytes, source: str = "program") -> Ladder:
    """Return the program of a CSV file of GX Works2.

    Args:
        data: The file, as this module describes it.
        source: Where it was read from, for messages; their column is the number of the field, from 1.

    Raises:
        LadderError: It is no such file, or no program of an FX2N; one line a finding, all of the file at once.
    """
    findings = Findings(source)
    rows = _rows(decoded(data, source), source)
    _check_head(rows, findings)
    findings.raise_if_any()
    reader = _Reader(findings)
    for line, fields in rows[_HEAD:]:
        reader.row(line, fields)
    reader.close()
    if reader.statements:
        line, fields = rows[-1]
        findings.add(line, STATEMENT + 1, " ".join(fields), "no instruction follows the statement; delete it")
    return finished(reader.program, findings, reader.titles, {})


def _rows(text: str, source: str) -> list[tuple[int, list[str]]]:
    """Return the rows of a file and the line each begins in.

    Raises:
        LadderError: A quotation mark is missing or out of place.
    """
    tabbed = "\t" in "".join(text.splitlines(keepends=True)[:_HEAD])
    reader = csv.reader(io.StringIO(text, newline=""), delimiter="\t" if tabbed else ",", strict=True)
    rows: list[tuple[int, list[str]]] = []
    line = 1
    try:
        for row in reader:
            rows.append((line, row))
            line = reader.line_num + 1
    except csv.Error as error:
        wrong = f"cannot be taken apart ({printable(str(error))}); put each field between two quotation marks"
        raise file_error(source, wrong, line) from None
    return rows


def _check_head(rows: list[tuple[int, list[str]]], findings: Findings) -> None:
    """Note what is wrong with the three rows of the head."""
    if len(rows) < _HEAD:
        findings.add(1, 1, "file", "the three rows of the head are not there; write the program to CSV from GX Works2")
        return
    line, fields = rows[1]
    plc = [text for text in fields if text][1:]
    if len(plc) != 1 or "FX" not in plc[0].upper():
        wrong = "it does not name an FX CPU in its second field; export the program of an FX2N"
        findings.add(line, 2, " ".join(fields), wrong)
    line, fields = rows[2]
    if len(fields) != len(COLUMNS):
        wrong = f"the head has {len(fields)} columns; expected {len(COLUMNS)}: {', '.join(COLUMNS)}"
        findings.add(line, 1, " ".join(fields), wrong)


def gx_text(operand: Operand) -> str:
    """Return an operand as GX Works2 prints it: X and Y with three digits.

    Examples:
        >>> gx_text(Device("X", 8)), gx_text(Digits(2, Device("Y", 0))), gx_text(Device("M", 8))
        ('X010', 'K2Y000', 'M8')
    """
    match operand:
        case Device("X" | "Y" as kind, number, index):
            return f"{kind}{number:03o}{index}"
        case Digits(digits, device):
            return f"K{digits}{gx_text(device)}"
        case _:
            return str(operand)


def write_gx_csv(ladder: Ladder, *, title: str = "MAIN", plc: str = "FXCPU FX2N/FX2NC") -> bytes:
    """Return a program as a CSV file that GX Works2 reads, and `read_gx_csv` as the same program.

    Args:
        ladder: The program; the comments of its devices are left out.
        title: Name of the program.
        plc: Type of the PLC.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, delimiter="\t", quoting=csv.QUOTE_ALL, lineterminator="\r\n")
    writer.writerow((one_line(title),))
    writer.writerow(("PLC Information:", plc))
    writer.writerow(COLUMNS)
    for index, (step, instruction) in enumerate(numbered(ladder)):
        for line in title_lines(ladder, index):
            writer.writerow((step, line, "", "", "", "", ""))
        name, operands = _columns(instruction)
        writer.writerow((step, "", name, operands[0], "", "", one_line(instruction.note)))
        for operand in operands[1:]:
            writer.writerow(("", "", "", operand, "", "", ""))
    return BOM_UTF16_LE + text.getvalue().encode("utf-16-le")


def _columns(instruction: Instruction) -> tuple[str, list[str]]:
    """Return what stands in the columns of the instruction and its operands."""
    if instruction.name == "P":
        return str(instruction.operands[0]), [""]
    return instruction.name, [gx_text(operand) for operand in instruction.operands] or [""]
