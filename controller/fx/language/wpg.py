"""Program part of a GX Developer project (MAIN.wpg): a stream of tokens with step counts.

The file has a header of 64 bytes, 4 more bytes, and then records: a length, the content, and the same length again. An
instruction is a record with its code, its number of steps if it has more than one, and up to two further bytes,
followed by the records of its operands: prefixes (digits, index, bit of a word) and a device or a constant with its
number, low byte first. The codes are those of the tables in source [13] (verified, docs/sources/fx2n.md 2.3) and a few
that follow from their order; any other token is rejected. A program is accepted only if encoding each instruction again
yields the same bytes, including the step count, and if all step counts together fill a program memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from controller.core.devices import WORD_MAX, WORD_MIN
from controller.fx.language.cpu_model import FX2N, FX3U, CpuModel
from controller.fx.language.instruction import Constant, Instruction, Ladder
from controller.fx.language.instruction_set import FORMS, JOINS, steps
from controller.fx.language.parsing import TextErrors, Token, file_error, one_line, parse_instruction
from controller.fx.language.structure import Placed, checked_ladder
from controller.fx.language.wpg_operands import OperandCodeError, encode_operand, operand_text, record

HEADER_BYTES: Final = 0x40
MAGIC: Final = bytes((HEADER_BYTES, 0))
SUBHEADER: Final = bytes((0x04, 0x00, 0xFF, 0xFF))
CPU_OFFSET, SERIES_OFFSET, MODE_OFFSET = 0x26, 0x27, 0x2A
CPU_CODES: Final = {0x05: FX2N, 0x08: FX3U}
_OTHER_CPUS: Final = {0x01: "FX0", 0x02: "FX0N", 0x03: "FX1", 0x04: "FX2", 0x06: "FX1S", 0x07: "FX1N", 0x09: "FX3G"}
FX_SERIES, SFC_MODE = 0x02, 0x00
NOP: Final = bytes((2, 2))
MEMORY_BLOCK: Final = 500
"""Unit of the program memory, steps. NOP fills it after END: all published projects have 2,000 or 8,000 steps in total;
comments and file registers take blocks of 500 steps from it (from memory)."""
STATEMENT, NOTE, LABEL = 0x80, 0x82, 0x3C
_REMEDY: Final = "use Write to CSV File in GX Developer"

_OUT_PRESET: Final = 0x21
_SHORT: Final = {
    "LD": 0x00,
    "LDI": 0x01,
    "LDP": 0x02,
    "LDF": 0x03,
    "OR": 0x06,
    "ORI": 0x07,
    "ORP": 0x08,
    "ORF": 0x09,
    "AND": 0x0C,
    "ANI": 0x0D,
    "ANDP": 0x0E,
    "ANDF": 0x0F,
    "ORB": 0x18,
    "ANB": 0x19,
    "MPS": 0x1A,
    "MRD": 0x1B,
    "MPP": 0x1C,
    "OUT": 0x20,
    "SET": 0x23,
    "RST": 0x24,
    "MC": 0x2C,
    "MCR": 0x30,
    "FEND": 0x33,
    "END": 0x34,
}
"""Codes of the instructions whose record has one byte, or two with the step count. ORI, ORP and ANDF are computed: the
codes of the contacts are in the same order after LD, OR and AND."""
_LONG: Final = {
    "ADD": (0x49, 0x28),
    "DADD": (0x49, 0x29),
    "SUB": (0x49, 0x2A),
    "DSUB": (0x49, 0x2B),
    "MUL": (0x49, 0x2C),
    "DMUL": (0x49, 0x2D),
    "DIV": (0x49, 0x2E),
    "DDIV": (0x49, 0x2F),
    "DEADD": (0x49, 0x30),
    "DESUB": (0x49, 0x31),
    "DEMUL": (0x49, 0x32),
    "DEDIV": (0x49, 0x33),
    "INC": (0x4A, 0x00),
    "DINC": (0x4A, 0x01),
    "DEC": (0x4A, 0x02),
    "DDEC": (0x4A, 0x03),
    "DINT": (0x4B, 0x05),
    "DNEG": (0x4B, 0x0F),
    "MOV": (0x4C, 0x00),
    "DMOV": (0x4C, 0x01),
    "BMOV": (0x4C, 0x06),
    "DEMOV": (0x4C, 0x0F),
    "CJ": (0x4D, 0x00),
    "WAND": (0x4F, 0x01),
    "WOR": (0x4F, 0x03),
    "DWAND": (0x4F, 0x09),
    "DWOR": (0x4F, 0x0B),
    "DROL": (0x50, 0x06),
    "ZRST": (0x53, 0x19),
    "FLT": (0x53, 0x22),
    "DFLT": (0x53, 0x23),
    "CALL": (0x54, 0x01),
    "FROM": (0x56, 0x00),
    "TO": (0x56, 0x02),
    "DI": (0x69, 0x00),
    "EI": (0x69, 0x01),
    "IRET": (0x69, 0x03),
    "FOR": (0x6A, 0x00),
    "NEXT": (0x6A, 0x01),
    "SRET": (0x6A, 0x07),
}
"""First and third byte of the instructions whose record has three bytes. DADD, DDIV, DINC and DDEC are
computed, because the 32-bit form follows the 16-bit form, and occur in published projects with the step counts of these
instructions; DIV is computed from the same order."""
_COMPARISON: Final = 0x40
_RELATIONS: Final = ("=", "<>", ">", ">=", "<", "<=")
_FIRST_JOIN: Final = 0x10
"""Last byte of a contact comparison with LD; those with AND and OR follow."""

_COMPARISONS: Final = {
    f"{join}{wide}{relation}": bytes((n + len(_RELATIONS) * bool(wide), _FIRST_JOIN + at))
    for at, join in enumerate(JOINS)
    for wide in ("", "D")
    for n, relation in enumerate(_RELATIONS)
}
"""Last two bytes of each contact comparison."""


def encode(instruction: Instruction) -> bytes:
    """Return the records of an instruction.

    Raises:
        KeyError: The code of the instruction is unknown.
    """
    name, operands, count = instruction.name, instruction.operands, steps(instruction)
    if name in ("P", "I"):
        return record(bytes((LABEL,))) + encode_operand(operands[0], wide=False)
    if name == "NOP":
        return NOP
    if name in _SHORT:
        code = _OUT_PRESET if name == "OUT" and len(operands) > 1 else _SHORT[name]
        content = bytes((code,)) if count == 1 else bytes((code, count))
    elif name in _COMPARISONS:
        content = bytes((_COMPARISON, count)) + _COMPARISONS[name]
    else:
        first, third = _LONG[name]
        content = bytes((first, count, third))
    return record(content) + b"".join(encode_operand(operand, wide=_is_wide(instruction)) for operand in operands)


def _is_wide(instruction: Instruction) -> bool:
    """Return whether constants have the code of 32 bits: for OUT, only if they do not fit into 16 bits (assumed)."""
    match instruction:
        case Instruction("OUT", (_, Constant(value))):
            return not WORD_MIN <= value <= WORD_MAX
    return FORMS[instruction.name].wide


def _name(content: bytes) -> str | None:
    """Return the mnemonic of a record; None if it is unknown."""
    match len(content):
        case 1 | 2:
            if content[0] == _OUT_PRESET:
                return "OUT"
            return next((name for name, code in _SHORT.items() if code == content[0]), None)
        case 3:
            codes = (content[0], content[2])
            return next((name for name, known in _LONG.items() if known == codes), None)
        case 4 if content[0] == _COMPARISON:
            return next((name for name, known in _COMPARISONS.items() if known == content[2:]), None)
    return None


def read_wpg(data: bytes, source: str = "program", cpu: CpuModel = FX2N) -> Ladder:
    """Return the program in the program part of a GX Developer project.

    Args:
        data: File content.
        source: File name for messages; the line in a message is the number of the instruction, from 1.
        cpu: CPU for which the program is written.

    Raises:
        LadderError: The file is damaged, contains an unknown token or a step count that does not agree, or the program
            is not a valid program of the CPU.
    """
    _check_header(data, source, cpu)
    return _WpgReader(data, TextErrors(source, cpu)).ladder()


def _check_header(data: bytes, source: str, cpu: CpuModel) -> None:
    if len(data) < HEADER_BYTES + len(SUBHEADER) or not data.startswith(MAGIC):
        raise file_error(source, f"not the program part of a GX Developer project; {_REMEDY}")
    if data[SERIES_OFFSET] != FX_SERIES:
        raise file_error(source, f"a program of another series (code {data[SERIES_OFFSET]:02X}); only FX is supported")
    written = CPU_CODES.get(data[CPU_OFFSET])
    if written is not cpu:
        if written is None:
            remedy = "change the PLC type to FX2N(C) or FX3U(C) in GX Developer"
            name = _OTHER_CPUS.get(data[CPU_OFFSET], f"unknown PLC (type {data[CPU_OFFSET]:02X})")
            raise file_error(source, f"a program for an {name}; {remedy}")
        raise file_error(source, f"a program for an {written.name}; use --cpu {written.key}")
    if data[MODE_OFFSET] == SFC_MODE:
        raise file_error(source, f"an SFC program; change it to a ladder in GX Developer, or {_REMEDY}")
    if data[HEADER_BYTES : HEADER_BYTES + len(SUBHEADER)] != SUBHEADER:
        raise file_error(source, f"unknown bytes after the header; {_REMEDY}")


@dataclass(slots=True)
class _WpgReader:
    """Reader of the records.

    Attributes:
        data: File content.
        findings: Errors in the program.
        at: Position of the next record.
        program: Instructions.
        titles: Statements before an instruction.
    """

    data: bytes
    findings: TextErrors
    at: int = HEADER_BYTES + len(SUBHEADER)
    program: list[Placed] = field(default_factory=list)
    titles: dict[int, str] = field(default_factory=dict)

    def ladder(self) -> Ladder:
        records = self._records()
        for content in records:
            match content[:1]:
                case b"":
                    self._add("NOP", b"", NOP, iter(()))
                case first if first[0] in (STATEMENT, NOTE):
                    self._text(content)
                case first if first[0] == LABEL:
                    self._label(content, records)
                case _:
                    name = _name(content)
                    if name is None:
                        raise self._error(f"the token {content.hex(' ')} is unknown")
                    self._add(name, content, record(content), records)
            if self.program and self.program[-1].instruction.name == "END":
                self._check_rest(records)
        return checked_ladder(self.program, self.findings, self.titles, {})

    def _check_rest(self, records: Iterator[bytes]) -> None:
        """Check that NOP fill the program memory after END."""
        total = sum(steps(placed.instruction) for placed in self.program)
        for content in records:
            total += 1
            if content:
                raise self._error("there is a token after END")
        if total % MEMORY_BLOCK:
            raise self._error(f"{total} steps with NOP do not fill a program memory; the file is truncated")

    def _records(self) -> Iterator[bytes]:
        """Yield the contents of the records."""
        while self.at < len(self.data):
            length = self.data[self.at]
            end = self.at + length
            if length < len(NOP) or end > len(self.data) or self.data[end - 1] != length:
                raise self._error("the record is damaged or the file is truncated")
            content = self.data[self.at + 1 : end - 1]
            self.at = end
            yield content

    def _error(self, text: str) -> Exception:
        return file_error(self.findings.source, f"byte {self.at}: {text}; {_REMEDY}", len(self.program) + 1)

    def _text(self, content: bytes) -> None:
        """Store a statement as the title of the next instruction."""
        if content[0] == STATEMENT and (text := one_line(content[2:].decode("ascii", "replace"))):
            before = self.titles.get(len(self.program))
            self.titles[len(self.program)] = f"{before}\n{text}" if before else text

    def _label(self, content: bytes, records: Iterator[bytes]) -> None:
        if content != bytes((LABEL,)):
            raise self._error(f"the token {content.hex(' ')} is unknown")
        self._add("", content, record(content), records)

    def _add(self, name: str, content: bytes, used: bytes, records: Iterator[bytes]) -> None:
        """Add an instruction or, if the name is empty, a label, after encoding it again."""
        texts: list[str] = []
        try:
            for _ in range(self._count(name, content)):
                text, taken = operand_text(records)
                texts.append(text)
                used += taken
        except OperandCodeError as error:
            raise self._error(f"the operand {error} of {name or 'the label'} is unknown") from None
        line = len(self.program) + 1
        words = [Token(text, line, 1) for text in ([name] if name else []) + texts]
        before = len(self.findings.found)
        instruction = parse_instruction(words[0], words[1:], self.findings)
        if instruction is None:
            self.findings.found[before:] = self.findings.found[before : before + 1]
            self.findings.raise_if_any()
            return
        if encode(instruction) != used:
            raise self._error(f"{instruction} has another step count or form than in an {self.findings.cpu.name}")
        self.program.append(Placed(instruction, 1))

    def _count(self, name: str, content: bytes) -> int:
        """Return the number of operands."""
        match name:
            case "":
                return 1
            case "OUT":
                return 2 if content[0] == _OUT_PRESET else 1
        return len(FORMS[name].kind.operands)
