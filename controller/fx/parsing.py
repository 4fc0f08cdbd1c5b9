"""Mnemonics and operands in text as instructions of an FX2N, and the findings about what cannot be one."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Final, NamedTuple

from controller.fx.instruction import (
    Constant,
    Device,
    Digits,
    Instruction,
    LadderError,
    Nest,
    Operand,
    Pointer,
    WordBit,
)
from controller.fx.instruction_set import FORMS, JOINS, OPERAND_KINDS, RELATIONS, Form, kind_of
from controller.fx.operand_rules import OperandError, check_operand, check_together, within


class Token(NamedTuple):
    """A word of a program text and its place, line and column from 1."""

    text: str
    line: int
    column: int


@dataclass(slots=True)
class Findings:
    """Everything that is wrong with one text, so that a user sees it all at once.

    Attributes:
        source: Name of the text.
        found: Line, column and text of each finding.
    """

    source: str
    found: list[tuple[int, int, str]] = field(default_factory=list)

    def add(self, line: int, column: int, instruction: str, text: str) -> None:
        """Note a finding; `text` is what is wrong and, after a semicolon, what was expected or helps."""
        self.found.append((line, column, f"{printable(one_line(instruction))}: {text}"))

    def raise_if_any(self) -> None:
        """Raise LadderError with one line a finding, in the order of the text."""
        if self.found:
            lines = (f"{self.source}:{line}:{column}: {text}" for line, column, text in sorted(self.found))
            raise LadderError("\n".join(lines))


def file_error(source: str, text: str, line: int = 1) -> LadderError:
    """Return the error about a file as a whole; `text` is what is wrong and, after a semicolon, what helps."""
    return LadderError(f"{source}:{line}:1: file: {text}")


def printable(text: str, longest: int = 48) -> str:
    r"""Return any text as one short line that a message can hold.

    Examples:
        >>> printable("LD X0")
        'LD X0'
        >>> printable("L" + chr(10) + "D", longest=3)
        'L\\n'
    """
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return shown[:longest] or "(nothing)"


def one_line(text: str) -> str:
    """Return a comment as one line, its blanks single."""
    return " ".join(text.split())


_INDEX: Final = r"(?P<index>[VZ][0-7]?)?"
_NUMBER: Final = r"0*(?P<number>[0-9]{1,12})"
_OPERANDS: Final = {
    name: re.compile(pattern)
    for name, pattern in {
        "decimal": rf"K(?P<value>-?[0-9]{{1,12}}){_INDEX}",
        "hexadecimal": rf"H(?P<value>[0-9A-F]{{1,12}}){_INDEX}",
        "digits": rf"K(?P<digits>[0-9]{{1,3}})(?P<kind>[XYMS]){_NUMBER}{_INDEX}",
        "bit of a word": rf"D{_NUMBER}\.(?P<bit>[0-9A-F])",
        "device": rf"(?P<kind>[XYMSTCD]){_NUMBER}{_INDEX}",
        "index register": r"(?P<kind>[VZ])(?P<number>[0-9]{0,3})",
        "pointer": r"(?P<kind>[PI])(?P<number>[0-9]{1,4})",
        "nest": r"N(?P<number>[0-9]{1,4})",
    }.items()
}
_FX3_OPERANDS: Final = {
    "a real number (E)": re.compile(r"E[-+]?[0-9].*"),
    "an extension register (R)": re.compile(r"E?R[0-9]+.*"),
    "a buffer memory of a module (U\\G)": re.compile(r"U[0-9A-F]+\\G[0-9]+.*"),
    "a text": re.compile(r"\".*"),
}
_LABEL: Final = re.compile(r"([PI][0-9]{1,4}):?")


def parse_operand(text: str) -> Operand:
    """Return the operand that a text is, in upper or lower case.

    Examples:
        >>> parse_operand("x010"), str(parse_operand("K4M0Z"))
        (Device(kind='X', number=8, index=''), 'K4M0Z0')

    Raises:
        OperandError: It is no operand of an FX2N, or lies outside the range of its device.
    """
    upper = text.upper() if text.isascii() else text
    for name, pattern in _OPERANDS.items():
        if match := pattern.fullmatch(upper):
            return _operand(name, match.groupdict())
    for name, pattern in _FX3_OPERANDS.items():
        if pattern.fullmatch(upper):
            raise OperandError(f"{printable(text)} is {name}, which only an FX3 has; use D, K or H")
    raise OperandError(f"{printable(text)} is no operand; write a device as X0 or D100Z0, K or H, KnM0, P0 or N0")


def _operand(name: str, part: dict[str, str | None]) -> Operand:
    """Return the operand of a text that has its form."""
    index = _index(part.get("index"))
    match name:
        case "decimal":
            return Constant(int(part["value"] or ""), "K", index)
        case "hexadecimal":
            return Constant(int(part["value"] or "", 16), "H", index)
        case "digits":
            return Digits(int(part["digits"] or ""), _device(part, index))
        case "bit of a word":
            number = int(part["number"] or "")
            within("D", number)
            return WordBit(number, int(part["bit"] or "", 16))
        case "pointer":
            return _pointer(part)
        case "nest":
            number = int(part["number"] or "")
            within("N", number)
            return Nest(number)
        case _:
            return _device(part, index)


def _index(text: str | None) -> str:
    """Return the full name of an index register: V is V0."""
    return (text if len(text) > 1 else f"{text}0") if text else ""


def _device(part: dict[str, str | None], index: str) -> Device:
    kind, digits = part["kind"] or "", part["number"] or "0"
    if kind in "XY" and not set(digits) <= set("01234567"):
        raise OperandError(f"{kind}{digits} has a digit 8 or 9; {kind} is octal: after {kind}7 comes {kind}10")
    number = int(digits, 8 if kind in "XY" else 10)
    within(kind, number)
    return Device(kind, number, index)


def _pointer(part: dict[str, str | None]) -> Pointer:
    number = int(part["number"] or "")
    if part["kind"] == "I":
        return Pointer("I", number)
    within("P", number)
    return Pointer("P", number)


_FX3_NAMES: Final = (
    "MEP MEF EMOV ESTR EVAL EXP LOGE LOG10 ENEG ASIN ACOS ATAN RAD DEG WSUM WTOB BTOW UNI DIS SORT2 DSZR DVIT TBL "
    "ZPUSH ZPOP HTOS STOH COMRD RND DUTY CRC HCMOV BK+ BK- BKCMP= BKCMP> BKCMP< BKCMP<> BKCMP<= BKCMP>= STR VAL LEN "
    "RIGHT LEFT MIDR MIDW INSTR FDEL FINS POP SFR SFL LIMIT BAND ZONE SCL SCL2 DABIN BINDA IVCK IVDR IVRD IVWR IVBWR "
    "IVMC ADPRW LOADR SAVER INITR LOGR RWER INITER RS2 RBFM WBFM HSCT FLCRT FLDEL FLWR FLRD FLCMD FLSTRD"
)
_FX3_ONLY: Final = frozenset(_FX3_NAMES.split())
"""Mnemonics of an FX3 that an FX2N does not have, without D and P (GK)."""
_REMEDIES: Final = {"TMR": "OUT T0 K10", "CNT": "OUT C0 K10", "JMP": "CJ P0", "LDN": "LDI", "ANDN": "ANI", "ORN": "ORI"}
"""What other PLCs' mnemonics are called here."""


def mnemonic(text: str) -> str:
    """Return a mnemonic as the instruction set spells it: in capitals, DLD= as LDD=."""
    upper = text.upper() if text.isascii() else text
    for join in JOINS:
        if upper.startswith(f"D{join}") and upper.removeprefix(f"D{join}") in RELATIONS:
            return f"{join}D{upper.removeprefix(f'D{join}')}"
    return upper


def is_label(text: str) -> bool:
    """Tell whether a word is a label, P0 or P0:."""
    return text.isascii() and _LABEL.fullmatch(text.upper()) is not None


def parse_instruction(name: Token, operands: Sequence[Token], findings: Findings, note: str = "") -> Instruction | None:
    """Return the instruction that a mnemonic and its operands are, checked against the instruction set.

    Args:
        name: The mnemonic, or a label.
        operands: Its operands.
        findings: Where everything that is wrong goes.
        note: Comment on it.

    Returns:
        None if something is wrong with it.
    """
    shown = " ".join((name.text, *(operand.text for operand in operands)))
    if is_label(name.text):
        return _label(name, operands, findings, note)
    spelled = mnemonic(name.text)
    form = FORMS.get(spelled)
    if form is None or not form.kind.supported:
        wrong = _unknown(spelled) if form is None else f"{spelled} of the FX2N is not executed here; replace it"
        findings.add(name.line, name.column, shown, wrong)
        return None
    parsed: list[Operand] = []
    for operand in operands:
        try:
            parsed.append(parse_operand(operand.text))
        except OperandError as error:
            second = mnemonic(operand.text) in FORMS
            wrong = f"{operand.text} is a second instruction; write it on the next line" if second else str(error)
            findings.add(operand.line, operand.column, shown, wrong)
    if len(parsed) < len(operands):
        return None
    instruction = Instruction(spelled, tuple(parsed), name.line, note)
    wrongs = list(_wrongs(instruction, form))
    for place, wrong in wrongs:
        at = name if place is None else operands[place]
        findings.add(at.line, at.column, shown, wrong)
    return None if wrongs else instruction


def _label(name: Token, operands: Sequence[Token], findings: Findings, note: str) -> Instruction | None:
    """Return a label as an instruction."""
    wrong, at = "", name
    if operands:
        wrong, at = "there is text behind a label; write the label on a line of its own", operands[0]
    elif name.text[0] in "iI":
        wrong = "interrupts of the FX2N are not executed here; read the input in the scan"
    else:
        try:
            pointer = parse_operand(name.text.rstrip(":"))
        except OperandError as error:
            wrong = str(error)
        else:
            if pointer == Pointer("P", 63):
                wrong = "P63 is END itself and no label; use another one of P0 to P127"
    if wrong:
        findings.add(at.line, at.column, name.text, wrong)
        return None
    return Instruction("P", (pointer,), name.line, note)


def _unknown(name: str) -> str:
    """Tell what is wrong with a mnemonic that an FX2N does not have."""
    stems = {name, name.removeprefix("D")}
    if (stems | {stem.removesuffix("P") for stem in stems}) & _FX3_ONLY:
        return f"{name} exists only on an FX3; write it with the instructions of an FX2N"
    if remedy := _REMEDIES.get(name):
        return f"an FX2N has no {name}; write {remedy}"
    near = get_close_matches(name[:16], FORMS, n=1, cutoff=0.5)
    advice = f"did you mean {near[0]}?" if near else "write one as LD, OUT or MOV"
    return f"{printable(name, 16)} is no instruction; {advice}"


def _wrongs(instruction: Instruction, form: Form) -> Iterator[tuple[int | None, str]]:
    """Yield what is wrong with the operands of an instruction: the operand's place, None = the whole, and the text."""
    places, operands = form.kind.operands, instruction.operands
    least = len(places) - form.kind.optional
    if not least <= len(operands) <= len(places):
        yield None, f"has {_count(len(operands))}; expected {' '.join((instruction.name, *places)).strip()}"
        return
    sound = True
    for n, (operand, place) in enumerate(zip(operands, places, strict=False)):
        wrong = _wrong_kind(instruction.name, operand, place) or check_operand(instruction, form, n)
        if wrong:
            sound = False
            yield n, wrong
    if sound and (wrong := check_together(instruction, form)):
        yield None, wrong


def _count(number: int) -> str:
    return f"{number or 'no'} operand{'s' * (number != 1)}"


def _wrong_kind(name: str, operand: Operand, place: str) -> str | None:
    kinds = OPERAND_KINDS[place]
    if kind_of(operand) in kinds:
        return None
    if name in ("OUT", "SET", "RST", "PLS", "PLF") and kind_of(operand) == "X":
        return f"{operand} is an input and cannot be driven; drive Y, M or S"
    return f"{operand} cannot be the {place} of {name}; expected {', '.join(sorted(kinds))}"
