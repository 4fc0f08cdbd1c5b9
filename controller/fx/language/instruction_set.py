"""The instruction set of the FX2N: operands, forms and step counts of every instruction.

FNC numbers, operand order and step counts follow fx2n.md 1.1 and 1.2, whose verification marks apply here too. The
basic instructions, the FNC table and the rule "1 + 2 per 16-bit operand, 1 + 4 per 32-bit operand" are in independent
sources. The device kinds that each operand may have, and the step counts of OUT and RST by kind, are from memory and
have not been verified.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from controller.fx.language.instruction import (
    Constant,
    DeviceOperand,
    Digits,
    Instruction,
    Nest,
    Operand,
    Pointer,
    WordBit,
)

WORDS: Final = frozenset({"KnX", "KnY", "KnM", "KnS", "T", "C", "D", "V", "Z"})
OPERAND_KINDS: Final[dict[str, frozenset[str]]] = {
    "source": WORDS | {"K", "H"},
    "target": WORDS - {"KnX"},
    "number": frozenset({"K", "H"}),
    "count": frozenset({"K", "H", "D"}),
    "words": WORDS - {"V", "Z"},
    "target words": WORDS - {"KnX", "V", "Z"},
    "source words": (WORDS | {"K", "H"}) - {"V", "Z"},
    "contact": frozenset({"X", "Y", "M", "S", "T", "C", "D.b"}),
    "bit": frozenset({"X", "Y", "M", "S"}),
    "coil": frozenset({"Y", "M", "S"}),
    "pulse": frozenset({"Y", "M"}),
    "X or Y": frozenset({"X", "Y"}),
    "Y": frozenset({"Y"}),
    "S": frozenset({"S"}),
    "T": frozenset({"T"}),
    "C": frozenset({"C"}),
    "D": frozenset({"D"}),
    "clock": frozenset({"T", "C", "D"}),
    "zone": frozenset({"Y", "M", "S", "T", "C", "D"}),
    "bit or word": frozenset({"X", "Y", "M", "S", "T", "C", "D", "V", "Z", "K", "H"}),
    "bit or target": frozenset({"Y", "M", "S", "T", "C", "D", "V", "Z"}),
    "out": frozenset({"Y", "M", "S", "T", "C", "D.b"}),
    "set": frozenset({"Y", "M", "S", "D.b"}),
    "reset": frozenset({"Y", "M", "S", "T", "C", "D", "V", "Z", "D.b"}),
    "preset": frozenset({"K", "H", "D"}),
    "float": frozenset({"K", "H", "D"}),
    "N": frozenset({"N"}),
    "P": frozenset({"P"}),
}
"""Accepted operand kinds by operand role."""


@dataclass(frozen=True, slots=True)
class InstructionKind:
    """One instruction of the instruction set.

    Attributes:
        name: Mnemonic without prefix and suffix.
        operands: Operand roles, keys of `OPERAND_KINDS`.
        fnc: Function number of an applied instruction; None = basic.
        wide: "no" = 16 bits only; "both" = 16 or 32 bits; "only" = 32 bits only, with the prefix D.
        pulsed: Whether the suffix P exists.
        supported: Whether the engine executes the instruction.
        optional: Number of trailing operands that may be omitted.
    """

    name: str
    operands: tuple[str, ...] = ()
    fnc: int | None = None
    wide: str = "no"
    pulsed: bool = False
    supported: bool = True
    optional: int = 0


@dataclass(frozen=True, slots=True)
class Form:
    """One spelling of an instruction: DMOVP is the wide, pulsed form of MOV."""

    kind: InstructionKind
    wide: bool = False
    pulsed: bool = False


RELATIONS: Final = {"=": "==", ">": ">", "<": "<", "<>": "!=", "<=": "<=", ">=": ">="}
"""Python operator for each contact comparison."""
JOINS: Final = ("LD", "AND", "OR")

_BASIC: Final = (
    *(
        InstructionKind(name, ("contact",))
        for name in ("LD", "LDI", "LDP", "LDF", "AND", "ANI", "ANDP", "ANDF", "OR", "ORI", "ORP", "ORF")
    ),
    *(InstructionKind(name) for name in ("ANB", "ORB", "MPS", "MRD", "MPP", "INV", "NOP", "END", "RET")),
    InstructionKind("MC", ("N", "pulse")),
    InstructionKind("MCR", ("N",)),
    InstructionKind("OUT", ("out", "preset"), optional=1),
    InstructionKind("SET", ("set",)),
    InstructionKind("RST", ("reset",)),
    InstructionKind("PLS", ("pulse",)),
    InstructionKind("PLF", ("pulse",)),
    InstructionKind("STL", ("S",)),
)


def _applied(fnc: int, name: str, operands: str = "", wide: str = "no", *, pulsed: bool = True) -> InstructionKind:
    return InstructionKind(name, tuple(operands.split(", ")) if operands else (), fnc, wide, pulsed)


def _refused(fnc: int, name: str, wide: str = "no", *, pulsed: bool = False) -> InstructionKind:
    return InstructionKind(name, (), fnc, wide, pulsed, supported=False)


_APPLIED: Final = (
    _applied(0, "CJ", "P"),
    _applied(1, "CALL", "P"),
    _applied(2, "SRET", pulsed=False),
    _refused(3, "IRET"),
    _refused(4, "EI"),
    _refused(5, "DI"),
    _applied(6, "FEND", pulsed=False),
    _applied(7, "WDT"),
    _applied(8, "FOR", "source", pulsed=False),
    _applied(9, "NEXT", pulsed=False),
    _applied(10, "CMP", "source, source, coil", "both"),
    _applied(11, "ZCP", "source, source, source, coil", "both"),
    _applied(12, "MOV", "source, target", "both"),
    _refused(13, "SMOV", pulsed=True),
    _applied(14, "CML", "source, target", "both"),
    _applied(15, "BMOV", "words, target words, count"),
    _applied(16, "FMOV", "source, target words, number", "both"),
    _applied(17, "XCH", "target, target", "both"),
    _applied(18, "BCD", "source, target", "both"),
    _applied(19, "BIN", "source, target", "both"),
    _applied(20, "ADD", "source, source, target", "both"),
    _applied(21, "SUB", "source, source, target", "both"),
    _applied(22, "MUL", "source, source, target", "both"),
    _applied(23, "DIV", "source, source, target", "both"),
    _applied(24, "INC", "target", "both"),
    _applied(25, "DEC", "target", "both"),
    _applied(26, "WAND", "source, source, target", "both"),
    _applied(27, "WOR", "source, source, target", "both"),
    _applied(28, "WXOR", "source, source, target", "both"),
    _applied(29, "NEG", "target", "both"),
    _applied(30, "ROR", "target, number", "both"),
    _applied(31, "ROL", "target, number", "both"),
    _applied(32, "RCR", "target, number", "both"),
    _applied(33, "RCL", "target, number", "both"),
    _applied(34, "SFTR", "bit, coil, number, number"),
    _applied(35, "SFTL", "bit, coil, number, number"),
    _applied(36, "WSFR", "words, target words, number, number"),
    _applied(37, "WSFL", "words, target words, number, number"),
    _applied(38, "SFWR", "source, target words, number"),
    _applied(39, "SFRD", "target words, target, number"),
    _applied(40, "ZRST", "zone, zone"),
    _applied(41, "DECO", "bit or word, bit or target, number"),
    _applied(42, "ENCO", "bit or word, target, number"),
    _applied(43, "SUM", "source, target", "both"),
    _applied(44, "BON", "source, coil, count", "both"),
    _applied(45, "MEAN", "words, target, count", "both"),
    _applied(46, "ANS", "T, count, S", pulsed=False),
    _applied(47, "ANR"),
    _applied(48, "SQR", "float, D", "both"),
    _applied(49, "FLT", "D, D", "both"),
    _applied(50, "REF", "X or Y, number"),
    _applied(51, "REFF", "count"),
    _refused(52, "MTR"),
    _refused(53, "HSCS", "only"),
    _refused(54, "HSCR", "only"),
    _refused(55, "HSZ", "only"),
    _refused(56, "SPD"),
    _applied(57, "PLSY", "source, source, Y", "both", pulsed=False),
    _applied(58, "PWM", "source, source, Y", pulsed=False),
    _applied(59, "PLSR", "source, source, source, Y", "both", pulsed=False),
    _applied(60, "IST", "bit, S, S", pulsed=False),
    _refused(61, "SER", "both", pulsed=True),
    _applied(62, "ABSD", "words, C, coil, number", "both", pulsed=False),
    _applied(63, "INCD", "words, C, coil, number", pulsed=False),
    _applied(64, "TTMR", "D, count", pulsed=False),
    _applied(65, "STMR", "T, count, coil", pulsed=False),
    _applied(66, "ALT", "coil"),
    _applied(67, "RAMP", "D, D, D, count", pulsed=False),
    _refused(68, "ROTC"),
    _refused(69, "SORT"),
    _refused(70, "TKY", "both"),
    _refused(71, "HKY", "both"),
    _refused(72, "DSW"),
    _applied(73, "SEGD", "source, target"),
    _refused(74, "SEGL"),
    _refused(75, "ARWS"),
    _refused(76, "ASC"),
    _refused(77, "PR"),
    _refused(78, "FROM", "both", pulsed=True),
    _refused(79, "TO", "both", pulsed=True),
    _refused(80, "RS"),
    _refused(81, "PRUN", "both", pulsed=True),
    _refused(82, "ASCI", pulsed=True),
    _refused(83, "HEX", pulsed=True),
    _refused(84, "CCD", pulsed=True),
    _refused(85, "VRRD", pulsed=True),
    _refused(86, "VRSC", pulsed=True),
    _refused(88, "PID"),
    _applied(110, "ECMP", "float, float, coil", "only"),
    _applied(111, "EZCP", "float, float, float, coil", "only"),
    _refused(118, "EBCD", "only", pulsed=True),
    _refused(119, "EBIN", "only", pulsed=True),
    _applied(120, "EADD", "float, float, D", "only"),
    _applied(121, "ESUB", "float, float, D", "only"),
    _applied(122, "EMUL", "float, float, D", "only"),
    _applied(123, "EDIV", "float, float, D", "only"),
    _refused(127, "ESQR", "only", pulsed=True),
    _applied(129, "INT", "D, D", "both"),
    _refused(130, "SIN", "only", pulsed=True),
    _refused(131, "COS", "only", pulsed=True),
    _refused(132, "TAN", "only", pulsed=True),
    _refused(147, "SWAP", "both", pulsed=True),
    _refused(155, "ABS", "only"),
    _refused(156, "ZRN", "both"),
    _refused(157, "PLSV", "both"),
    _refused(158, "DRVI", "both"),
    _refused(159, "DRVA", "both"),
    _applied(160, "TCMP", "source, source, source, clock, coil"),
    _applied(161, "TZCP", "clock, clock, clock, coil"),
    _refused(162, "TADD", pulsed=True),
    _refused(163, "TSUB", pulsed=True),
    _applied(166, "TRD", "clock"),
    _refused(167, "TWR", pulsed=True),
    _refused(169, "HOUR", "both"),
    _refused(170, "GRY", "both", pulsed=True),
    _refused(171, "GBIN", "both", pulsed=True),
)

_COMPARISONS: Final = tuple(
    InstructionKind(f"{join}{relation}", ("source", "source"), first + n, "both")
    for join, first in zip(JOINS, (224, 232, 240), strict=True)
    for relation, n in (("=", 0), (">", 1), ("<", 2), ("<>", 4), ("<=", 5), (">=", 6))
)

KINDS: Final = (*_BASIC, *_APPLIED, *_COMPARISONS)
"""All instructions of the FX2N."""

_ALIASES: Final = {"DAND": "DWAND", "DOR": "DWOR", "DXOR": "DWXOR"}
"""Alternative spellings of the 32-bit forms (from memory)."""


def _forms() -> Iterator[tuple[str, Form]]:
    for kind in (*_BASIC, *_APPLIED):
        for wide in {"no": (False,), "both": (False, True), "only": (True,)}[kind.wide]:
            name = f"D{kind.name}" if wide else kind.name
            yield name, Form(kind, wide)
            if kind.pulsed:
                yield f"{name}P", Form(kind, wide, pulsed=True)
    for kind in _COMPARISONS:
        yield kind.name, Form(kind)
        join = next(join for join in JOINS if kind.name.startswith(join))
        yield f"{join}D{kind.name.removeprefix(join)}", Form(kind, wide=True)


FORMS: Final[dict[str, Form]] = dict(_forms())
"""All mnemonics of the FX2N."""
FORMS.update({alias + end: FORMS[name + end] for alias, name in _ALIASES.items() for end in ("", "P")})


def kind_of(operand: Operand) -> str:
    """Return the kind of an operand as named in `OPERAND_KINDS`.

    Examples:
        >>> kind_of(DeviceOperand("X", 0)), kind_of(Digits(4, DeviceOperand("M", 0))), kind_of(Constant(5))
        ('X', 'KnM', 'K')
    """
    match operand:
        case DeviceOperand(kind):
            return kind
        case Digits(_, device):
            return f"Kn{device.kind}"
        case Constant(_, base):
            return base
        case WordBit():
            return "D.b"
        case Pointer(kind):
            return kind
        case Nest():
            return "N"


def steps(instruction: Instruction) -> int:
    """Return the number of program steps of an instruction in an FX2N (docs/sources/fx2n.md 1.1)."""
    name, operands = instruction.name, instruction.operands
    if name in ("P", "I"):
        return 1
    form = FORMS[name]
    if form.kind.fnc is not None:
        return 1 + (4 if form.wide else 2) * len(operands)
    base = {"MC": 3, "MCR": 2, "PLS": 2, "PLF": 2}.get(name)
    if base is not None or not operands:
        return base or 1
    device = operands[0]
    if isinstance(device, WordBit):
        return 3
    assert isinstance(device, DeviceOperand)  # noqa: S101 - narrows the union; operands were checked
    far = int(device.kind == "M" and 1536 <= device.number < 3072)
    if name in ("OUT", "SET", "RST"):
        return _coil_steps(name, device) + far
    return (2 if name[-1] in "PF" else 1) + far


def _coil_steps(name: str, device: DeviceOperand) -> int:
    if device.kind == "S" or (device.kind == "M" and device.number >= 8000):
        return 2
    if device.kind in "TC":
        if name == "RST":
            return 2
        return 5 if device.kind == "C" and device.number >= 200 else 3
    return 3 if device.kind in "DVZ" else 1
