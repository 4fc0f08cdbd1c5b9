"""Parser of mnemonics and operands, and its error messages."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Final, NamedTuple

from controller.fx.language.combination_rules import check_combination
from controller.fx.language.cpu_model import FX2N, CpuModel
from controller.fx.language.instruction import (
    Constant,
    DeviceOperand,
    Digits,
    Instruction,
    LadderError,
    Nest,
    Operand,
    Pointer,
    RealConstant,
    WordBit,
)
from controller.fx.language.instruction_set import FORMS, JOINS, OPERAND_KINDS, RELATIONS, Form, kind_of
from controller.fx.language.operand_rules import (
    OperandError,
    check_operand,
    require_in_range,
    require_interrupt,
)


class Token(NamedTuple):
    """Word of the program text with its line and column, counted from 1."""

    text: str
    line: int
    column: int


@dataclass(slots=True)
class TextErrors:
    """Errors in one text, collected so that they are reported together.

    Attributes:
        source: File name.
        cpu: CPU for which the text is written.
        found: Line, column and text of each error.
    """

    source: str
    cpu: CpuModel = FX2N
    found: list[tuple[int, int, str]] = field(default_factory=list)

    def add(self, line: int, column: int, instruction: str, text: str) -> None:
        """Add an error; `text` states the error and, after a semicolon, the expected form or the remedy."""
        self.found.append((line, column, f"{printable(one_line(instruction))}: {text}"))

    def raise_if_any(self) -> None:
        """Raise LadderError with one line for each error, in text order."""
        if self.found:
            lines = (f"{self.source}:{line}:{column}: {text}" for line, column, text in sorted(self.found))
            raise LadderError("\n".join(lines))


def file_error(source: str, text: str, line: int = 1) -> LadderError:
    """Return an error about an entire file; `text` states the error and, after a semicolon, the remedy."""
    return LadderError(f"{source}:{line}:1: file: {text}")


def printable(text: str, longest: int = 48) -> str:
    r"""Return any text as one short line for a message.

    Examples:
        >>> printable("LD X0")
        'LD X0'
        >>> printable("L" + chr(10) + "D", longest=3)
        'L\\n'
    """
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return shown[:longest] or "(nothing)"


def one_line(text: str) -> str:
    """Return a comment as one line, with runs of blanks reduced to one."""
    return " ".join(text.split())


SMALLEST: Final = 2.0**-126
"""Smallest positive normal single."""
LARGEST: Final = (2 - 2**-23) * 2.0**127
"""Largest finite single."""

_INDEX: Final = r"(?P<index>[VZ][0-7]?)?"
_NUMBER: Final = r"0*(?P<number>[0-9]{1,12})"
_OPERANDS: Final = {
    name: re.compile(pattern)
    for name, pattern in {
        "decimal": rf"K(?P<value>-?[0-9]{{1,12}}){_INDEX}",
        "hexadecimal": rf"H(?P<value>[0-9A-F]{{1,12}}){_INDEX}",
        "digits": rf"K(?P<digits>[0-9]{{1,3}})(?P<kind>[XYMS]){_NUMBER}{_INDEX}",
        "bit of a word": rf"D{_NUMBER}\.(?P<bit>[0-9A-F])",
        "real": r"E(?P<real>[-+]?[0-9]{1,20}(\.[0-9]{1,40})?)(?P<exponent>[-+][0-9]{1,2})?",
        "device": rf"(?P<kind>[XYMSTCDR]){_NUMBER}{_INDEX}",
        "index register": r"(?P<kind>[VZ])(?P<number>[0-9]{0,3})",
        "pointer": r"(?P<kind>[PI])(?P<number>[0-9]{1,4})",
        "nest": r"N(?P<number>[0-9]{1,4})",
    }.items()
}
_FX3_OPERANDS: Final = {
    "an extension file register (ER)": re.compile(r"ER[0-9]+.*"),
    "a buffer memory of a module (U\\G)": re.compile(r"U[0-9A-F]+\\G[0-9]+.*"),
    "a text": re.compile(r"\".*"),
}
_LABEL: Final = re.compile(r"([PI][0-9]{1,4}):?")


def parse_operand(text: str, cpu: CpuModel = FX2N) -> Operand:
    """Parse an operand in upper or lower case.

    Examples:
        >>> parse_operand("x010"), str(parse_operand("K4M0Z"))
        (DeviceOperand(kind='X', number=8, index=''), 'K4M0Z0')

    Raises:
        OperandError: The text is not an operand of the CPU, or the number is out of range for its device.
    """
    upper = text.upper() if text.isascii() else text
    for name, pattern in _OPERANDS.items():
        if match := pattern.fullmatch(upper):
            return _operand(name, match.groupdict(), cpu)
    for name, pattern in _FX3_OPERANDS.items():
        if pattern.fullmatch(upper):
            raise OperandError(
                f"{printable(text)} is {name}, which only an FX3 has and this engine does not support; use D, K or H"
            )
    raise OperandError(f"{printable(text)} is not an operand; write one such as X0, D100Z0, K5, H1F, K4M0, P0 or N0")


def _operand(name: str, part: dict[str, str | None], cpu: CpuModel) -> Operand:
    """Return the operand described by the groups that the pattern `name` has matched."""
    index = _index(part.get("index"))
    match name:
        case "decimal":
            return Constant(int(part["value"] or ""), "K", index)
        case "hexadecimal":
            return Constant(int(part["value"] or "", 16), "H", index)
        case "digits":
            return Digits(int(part["digits"] or ""), _device(part, index, cpu))
        case "real":
            return _real(part, cpu)
        case "bit of a word":
            number = int(part["number"] or "")
            _require_fx3(f"D{number}.{part['bit']} is a bit of a data register", cpu, "use M")
            require_in_range("D", number, cpu=cpu)
            return WordBit(number, int(part["bit"] or "", 16))
        case "pointer":
            return _pointer(part, cpu)
        case "nest":
            number = int(part["number"] or "")
            require_in_range("N", number)
            return Nest(number)
        case _:
            return _device(part, index, cpu)


def _require_fx3(text: str, cpu: CpuModel, remedy: str) -> None:
    if not cpu.is_fx3:
        raise OperandError(f"{text}, which only an FX3U has; {remedy}, or use --cpu fx3u")


def _real(part: dict[str, str | None], cpu: CpuModel) -> RealConstant:
    """Return a real constant in single precision; E1.5+3 is 1500."""
    text = f"{part['real']}e{part['exponent'] or 0}"
    value = float(text)
    shown = f"E{part['real']}{part['exponent'] or ''}"
    _require_fx3(f"{shown} is a real number (E)", cpu, "use D, K or H")
    if value and not SMALLEST <= abs(value) <= LARGEST:
        raise OperandError(f"{shown} does not fit into 32 bits; expected 0 or a size of E1.18-38 to E3.40+38")
    return RealConstant(struct.unpack("f", struct.pack("f", value))[0])


def _index(text: str | None) -> str:
    """Return the complete name of an index register, for example V0 for V."""
    return (text if len(text) > 1 else f"{text}0") if text else ""


def _device(part: dict[str, str | None], index: str, cpu: CpuModel) -> DeviceOperand:
    kind, digits = part["kind"] or "", part["number"] or "0"
    if kind in "XY" and not set(digits) <= set("01234567"):
        raise OperandError(f"{kind}{digits} has a digit 8 or 9, but {kind} is octal; {kind}7 is followed by {kind}10")
    number = int(digits, 8 if kind in "XY" else 10)
    if kind == "R":
        _require_fx3(f"R{number} is an extension register", cpu, "use D")
    require_in_range(kind, number, cpu=cpu)
    return DeviceOperand(kind, number, index)


def _pointer(part: dict[str, str | None], cpu: CpuModel) -> Pointer:
    number = int(part["number"] or "")
    if part["kind"] == "I":
        require_interrupt(number)
        return Pointer("I", number)
    require_in_range("P", number, cpu=cpu)
    return Pointer("P", number)


_FX3_NAMES: Final = (
    "MEP MEF ESTR EVAL EXP LOGE LOG10 ASIN ACOS ATAN WSUM WTOB BTOW UNI DIS SORT2 DSZR DVIT TBL "
    "ZPUSH ZPOP HTOS STOH COMRD RND DUTY CRC HCMOV BK+ BK- BKCMP= BKCMP> BKCMP< BKCMP<> BKCMP<= BKCMP>= STR VAL LEN "
    "RIGHT LEFT MIDR MIDW INSTR FDEL FINS POP SFR SFL LIMIT BAND ZONE SCL SCL2 DABIN BINDA IVCK IVDR IVRD IVWR IVBWR "
    "IVMC ADPRW LOADR SAVER INITR LOGR RWER INITER RS2 RBFM WBFM HSCT FLCRT FLDEL FLWR FLRD FLCMD FLSTRD"
)
_FX3_ONLY: Final = frozenset(_FX3_NAMES.split())
"""Mnemonics of an FX3 that an FX2N lacks, without D and P (from memory)."""
_REMEDIES: Final = {"TMR": "OUT T0 K10", "CNT": "OUT C0 K10", "JMP": "CJ P0", "LDN": "LDI", "ANDN": "ANI", "ORN": "ORI"}
"""FX2N equivalents of other PLCs' mnemonics."""


def mnemonic(text: str) -> str:
    """Return a mnemonic as spelled in the instruction set: in capitals, with DLD= converted to LDD=."""
    upper = text.upper() if text.isascii() else text
    for join in JOINS:
        if upper.startswith(f"D{join}") and upper.removeprefix(f"D{join}") in RELATIONS:
            return f"{join}D{upper.removeprefix(f'D{join}')}"
    return upper


def is_label(text: str) -> bool:
    """Return whether a word is a label such as ``P0`` or ``P0:``."""
    return text.isascii() and _LABEL.fullmatch(text.upper()) is not None


def parse_instruction(
    name: Token, operands: Sequence[Token], findings: TextErrors, note: str = ""
) -> Instruction | None:
    """Parse a mnemonic and its operands, checked against the instruction set.

    Args:
        name: Mnemonic or label.
        operands: Operands in order.
        findings: Collector of errors.
        note: Comment on the instruction.

    Returns:
        The instruction; None after an error.
    """
    shown = " ".join((name.text, *(operand.text for operand in operands)))
    if is_label(name.text):
        return _label(name, operands, findings, note)
    spelled = mnemonic(name.text)
    form = FORMS.get(spelled)
    if form is None or (unsupported := _unsupported(spelled, form, findings.cpu)):
        findings.add(name.line, name.column, shown, _unknown_mnemonic(spelled) if form is None else unsupported)
        return None
    parsed: list[Operand] = []
    for operand in operands:
        try:
            parsed.append(parse_operand(operand.text, findings.cpu))
        except OperandError as error:
            second = mnemonic(operand.text) in FORMS
            message = f"{operand.text} is a second instruction; write it on the next line" if second else str(error)
            findings.add(operand.line, operand.column, shown, message)
    if len(parsed) < len(operands):
        return None
    instruction = Instruction(spelled, tuple(parsed), name.line, note)
    errors = list(_operand_errors(instruction, form, findings.cpu))
    for place, message in errors:
        at = name if place is None else operands[place]
        findings.add(at.line, at.column, shown, message)
    return None if errors else instruction


def _unsupported(name: str, form: Form, cpu: CpuModel) -> str:
    """Return the error message for an instruction that the engine or the CPU does not have; empty = none."""
    if not form.kind.supported:
        return f"this engine does not support {name}; replace it"
    if form.kind.fx3 and not cpu.is_fx3:
        return f"{name} exists only on an FX3U; use --cpu fx3u, or the instructions of an FX2N"
    return ""


def _label(name: Token, operands: Sequence[Token], findings: TextErrors, note: str) -> Instruction | None:
    """Return a label as an instruction."""
    message, at = "", name
    if operands:
        message, at = "there is text after the label; write the label on a separate line", operands[0]
    else:
        try:
            pointer = parse_operand(name.text.rstrip(":"), findings.cpu)
        except OperandError as error:
            message = str(error)
        else:
            if pointer == Pointer("P", 63):
                message = "P63 is END and needs no label; use another one of P0 to P127"
    if message:
        findings.add(at.line, at.column, name.text, message)
        return None
    return Instruction(name.text[0].upper(), (pointer,), name.line, note)


def _unknown_mnemonic(name: str) -> str:
    """Return the error message for a mnemonic that an FX2N does not have."""
    stems = {name, name.removeprefix("D")}
    if (stems | {stem.removesuffix("P") for stem in stems}) & _FX3_ONLY:
        return f"{name} exists only on an FX3; write it with the instructions of an FX2N"
    if remedy := _REMEDIES.get(name):
        return f"an FX2N has no {name}; write {remedy}"
    near = get_close_matches(name[:16], FORMS, n=1, cutoff=0.5)
    advice = f"did you mean {near[0]}?" if near else "write one such as LD, OUT or MOV"
    return f"{printable(name, 16)} is not an instruction; {advice}"


def _operand_errors(instruction: Instruction, form: Form, cpu: CpuModel) -> Iterator[tuple[int | None, str]]:
    """Yield the index of the operand (None = entire instruction) and the message of each operand error."""
    places, operands = form.kind.operands, instruction.operands
    least = len(places) - form.kind.optional
    if not least <= len(operands) <= len(places):
        yield None, f"has {_count(len(operands))}; expected {' '.join((instruction.name, *places)).strip()}"
        return
    valid = True
    for n, (operand, place) in enumerate(zip(operands, places, strict=False)):
        message = _kind_error(instruction.name, operand, place) or check_operand(instruction, form, n, cpu)
        if message:
            valid = False
            yield n, message
    if valid and (message := check_combination(instruction, form)):
        yield None, message


def _count(number: int) -> str:
    return f"{number or 'no'} operand{'s' * (number != 1)}"


def _kind_error(name: str, operand: Operand, place: str) -> str | None:
    kinds = OPERAND_KINDS[place]
    if kind_of(operand) in kinds:
        return None
    if name in ("OUT", "SET", "RST", "PLS", "PLF") and kind_of(operand) == "X":
        return f"{operand} is an input and cannot be driven; drive Y, M or S"
    return f"{operand} cannot be the {place} of {name}; expected {', '.join(sorted(kinds))}"
