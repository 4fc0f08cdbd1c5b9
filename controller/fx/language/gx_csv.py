"""Program files of the "Write to CSV File" command of GX Works2 and GX Developer (fx2n.md 2.1).

The files are UTF-16LE with a byte order mark and CRLF line ends. Fields are quoted and separated by tabs; `""`
represents a quotation mark in a field. Three header rows (title, PLC type, names of the seven columns) precede one row
for each instruction; each additional operand has its own row. The verification marks of fx2n.md 2.1 apply here too.
Columns are identified by position because their names depend on the language of the tool. The reader also accepts
fields separated by commas or semicolons, and the encodings of `file_text`, which other tools and spreadsheets write.

A line statement becomes a title; a PI statement becomes the note of its pointer. The file contains no device
comments. The position of labels in the instruction column is from memory.
"""

from __future__ import annotations

import csv
import io
import re
from codecs import BOM_UTF16_LE
from dataclasses import dataclass, field
from typing import Final

from controller.common.files.text_encoding import EncodingError, FileText, file_text
from controller.fx.language.cpu_model import FX2N, CpuModel
from controller.fx.language.il import numbered, title_lines
from controller.fx.language.instruction import DeviceOperand, Digits, Instruction, Ladder, Operand
from controller.fx.language.parsing import TextErrors, Token, file_error, one_line, parse_instruction, printable
from controller.fx.language.structure import Placed, checked_ladder

COLUMNS: Final = ("Step No.", "Line Statement", "Instruction", "I/O(Device)", "Blank", "PI Statement", "Note")
STEP, STATEMENT, INSTRUCTION, OPERAND, BLANK, PI_STATEMENT, NOTE = range(7)
_HEAD: Final = 3
_NUMBER: Final = re.compile(r"[0-9]{1,9}")
_SEPARATORS: Final = ("\t", ",", ";")
_COMMENT_MARKS: Final = (";", "//", "'", "(*")
"""Beginnings of a comment line of an instruction list."""


def decode_text(data: bytes, source: str) -> FileText:
    """Return the text of a program file.

    Raises:
        LadderError: The text has none of the encodings of `file_text`.
    """
    try:
        return file_text(data)
    except EncodingError as error:
        raise file_error(source, str(error), error.line) from None


def separator_of(text: str) -> str | None:
    """Return the character that separates the fields of a CSV program file; None if the text is no such file.

    The third row names the seven columns; a first row in quotation marks also identifies the file.
    """
    lines = text.splitlines()
    head = lines[_HEAD - 1] if len(lines) >= _HEAD else ""
    if not head.startswith(_COMMENT_MARKS):
        for separator in _SEPARATORS:
            if len(next(csv.reader([head], delimiter=separator))) == len(COLUMNS):
                return separator
    if text.lstrip().startswith('"'):
        return next((separator for separator in _SEPARATORS if any(separator in line for line in lines[:_HEAD])), "\t")
    return None


@dataclass(slots=True)
class _PendingInstruction:
    """Instruction that may continue in the next rows."""

    name: Token
    operands: list[Token]
    notes: list[str]
    title: list[str]


@dataclass(slots=True)
class _CsvReader:
    """Parser state.

    Attributes:
        findings: Errors in the file.
        program: Parsed instructions.
        titles: Titles of the instructions.
        statements: Line statements before the next instruction.
        last_step: Last step number.
        open: Instruction that may continue in the next row.
    """

    findings: TextErrors
    program: list[Placed] = field(default_factory=list)
    titles: dict[int, str] = field(default_factory=dict)
    statements: list[str] = field(default_factory=list)
    last_step: int = -1
    open: _PendingInstruction | None = None

    def row(self, line: int, fields: list[str]) -> None:
        """Parse one row after the header."""
        shown = " ".join(text for text in fields if text)
        if not shown.strip():
            return
        if len(fields) != len(COLUMNS):
            message = f"the row has {len(fields)} fields; expected {len(COLUMNS)} as in the header"
            self.findings.add(line, min(len(fields), len(COLUMNS)), shown, message)
            return
        step, statement, name, operand, blank, pi_statement, note = (one_line(text) for text in fields)
        if blank:
            self.findings.add(line, BLANK + 1, shown, "there is text in the blank column; delete it")
        if step and not _NUMBER.fullmatch(step):
            self.findings.add(line, STEP + 1, shown, f"{printable(step)} is not a step number; write an integer")
        elif name:
            self.step(line, step, shown)
        if name:
            self.close()
            self.open = _PendingInstruction(Token(name, line, INSTRUCTION + 1), [], [], self.statements)
            self.statements = []
        if statement:
            self.statement(statement, new=bool(name))
        self.continuation(line, operand, [pi_statement, note], shown)

    def step(self, line: int, step: str, shown: str) -> None:
        """Check the step number of an instruction."""
        if not step:
            self.findings.add(line, STEP + 1, shown, "the step number is missing; write it")
            return
        if int(step) <= self.last_step:
            message = f"step {step} follows step {self.last_step}; step numbers must increase"
            self.findings.add(line, STEP + 1, shown, message)
        self.last_step = int(step)

    def statement(self, text: str, *, new: bool) -> None:
        """Store a line statement of the instruction in the same row, or of the next instruction."""
        if new and self.open is not None:
            self.open.title.append(text)
        else:
            self.close()
            self.statements.append(text)

    def continuation(self, line: int, operand: str, notes: list[str], shown: str) -> None:
        """Add an operand and notes to the open instruction."""
        notes = [note for note in notes if note]
        if not operand and not notes:
            return
        if self.open is None:
            self.findings.add(line, OPERAND + 1, shown, "there is no instruction above it; write one in column 3")
            return
        if operand:
            self.open.operands.append(Token(operand, line, OPERAND + 1))
        self.open.notes.extend(notes)

    def close(self) -> None:
        """Parse the open instruction and close it."""
        if self.open is None:
            return
        name, operands, notes, title = self.open.name, self.open.operands, self.open.notes, self.open.title
        instruction = parse_instruction(name, operands, self.findings, " ".join(notes))
        if instruction is not None:
            if title:
                self.titles[len(self.program)] = "\n".join(title)
            self.program.append(Placed(instruction, INSTRUCTION + 1))
        self.open = None


def read_gx_csv(data: bytes, source: str = "program", cpu: CpuModel = FX2N) -> Ladder:
    """Return the program in a GX Works2 CSV file.

    Args:
        data: File content in the format that this module describes.
        source: File name for messages; the column in a message is the field number, from 1.
        cpu: CPU for which the program is written.

    Raises:
        LadderError: The file is malformed or not a valid program of the CPU; the message has one line for each finding.
    """
    findings = TextErrors(source, cpu)
    rows = _rows(decode_text(data, source).text, source)
    _check_head(rows, findings)
    findings.raise_if_any()
    reader = _CsvReader(findings)
    for line, fields in rows[_HEAD:]:
        reader.row(line, fields)
    reader.close()
    if reader.statements:
        line, fields = rows[-1]
        findings.add(line, STATEMENT + 1, " ".join(fields), "no instruction follows the statement; delete it")
    return checked_ladder(reader.program, findings, reader.titles, {})


def _rows(text: str, source: str) -> list[tuple[int, list[str]]]:
    """Return the rows of a file, each with its first line number.

    Raises:
        LadderError: A quotation mark is missing or misplaced.
    """
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator_of(text) or "\t", strict=True)
    rows: list[tuple[int, list[str]]] = []
    line = 1
    try:
        for row in reader:
            rows.append((line, row))
            line = reader.line_num + 1
    except csv.Error as error:
        message = f"cannot be split into fields ({printable(str(error))}); enclose each field in quotation marks"
        raise file_error(source, message, line) from None
    return rows


def _check_head(rows: list[tuple[int, list[str]]], findings: TextErrors) -> None:
    """Report errors in the three header rows."""
    if len(rows) < _HEAD:
        findings.add(1, 1, "file", "the three header rows are missing; write the program to CSV from GX Works2")
        return
    line, fields = rows[1]
    plc = [text for text in fields if text][1:]
    if len(plc) != 1 or "FX" not in plc[0].upper():
        message = "the second field does not name an FX CPU; export the program of an FX2N"
        findings.add(line, 2, " ".join(fields), message)
    line, fields = rows[2]
    if len(fields) != len(COLUMNS):
        message = f"the header has {len(fields)} columns; expected {len(COLUMNS)}: {', '.join(COLUMNS)}"
        findings.add(line, 1, " ".join(fields), message)


def gx_text(operand: Operand) -> str:
    """Return an operand in GX Works2 notation: X and Y with three digits.

    Examples:
        >>> gx_text(DeviceOperand("X", 8)), gx_text(Digits(2, DeviceOperand("Y", 0))), gx_text(DeviceOperand("M", 8))
        ('X010', 'K2Y000', 'M8')
    """
    match operand:
        case DeviceOperand("X" | "Y" as kind, number, index):
            return f"{kind}{number:03o}{index}"
        case Digits(digits, device):
            return f"K{digits}{gx_text(device)}"
        case _:
            return str(operand)


def write_gx_csv(ladder: Ladder, *, title: str = "MAIN", plc: str = "FXCPU FX2N/FX2NC") -> bytes:
    """Return a program as a CSV file that GX Works2 imports and `read_gx_csv` parses back to the same program.

    Args:
        ladder: The program; its device comments are omitted.
        title: Program name.
        plc: PLC type.
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
    """Return the content of the instruction column and of the operand column in each row."""
    if instruction.name in ("P", "I"):
        return str(instruction.operands[0]), [""]
    return instruction.name, [gx_text(operand) for operand in instruction.operands] or [""]
