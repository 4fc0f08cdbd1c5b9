"""The instruction set of the FX2N and FX3U: operands, forms and step counts of every instruction.

FNC numbers, operand order and step counts follow fx2n.md 1.1 and 1.2, whose verification marks apply here too. The
basic instructions, the FNC table and the rule "1 + 2 per 16-bit operand, 1 + 4 per 32-bit operand" are in independent
sources. The device kinds that each operand may have, and the step counts of OUT and RST by kind, are from memory and
have not been verified.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import Final

from controller.fx.language.instruction import (
    Constant,
    DeviceOperand,
    Digits,
    Instruction,
    Nest,
    Operand,
    Pointer,
    RealConstant,
    WordBit,
)

WORDS: Final = frozenset({"KnX", "KnY", "KnM", "KnS", "T", "C", "D", "R", "V", "Z"})
OPERAND_KINDS: Final[dict[str, frozenset[str]]] = {
    "source": WORDS | {"K", "H"},
    "target": WORDS - {"KnX"},
    "number": frozenset({"K", "H"}),
    "count": frozenset({"K", "H", "D", "R"}),
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
    "D": frozenset({"D", "R"}),
    "clock": frozenset({"T", "C", "D", "R"}),
    "zone": frozenset({"Y", "M", "S", "T", "C", "D", "R"}),
    "bit or word": frozenset({"X", "Y", "M", "S", "T", "C", "D", "R", "V", "Z", "K", "H"}),
    "bit or target": frozenset({"Y", "M", "S", "T", "C", "D", "R", "V", "Z"}),
    "out": frozenset({"Y", "M", "S", "T", "C", "D.b"}),
    "set": frozenset({"Y", "M", "S", "D.b"}),
    "reset": frozenset({"Y", "M", "S", "T", "C", "D", "R", "V", "Z", "D.b"}),
    "preset": frozenset({"K", "H", "D", "R"}),
    "float": frozenset({"K", "H", "D", "R", "E"}),
    "real": frozenset({"D", "R", "E"}),
    "X": frozenset({"X"}),
    "set at once": frozenset({"Y", "M", "S", "I"}),
    "reset at once": frozenset({"Y", "M", "S", "C"}),
    "direction": frozenset({"Y", "M", "S", "D.b"}),
    "N": frozenset({"N"}),
    "P": frozenset({"P"}),
}
"""Accepted operand kinds by operand role; only an FX3U has E, R and D.b."""
READ: Final = frozenset(
    {
        "contact",
        "bit",
        "source",
        "source words",
        "words",
        "number",
        "count",
        "preset",
        "float",
        "bit or word",
        "clock",
        "C",
        "S",
        "T",
        "X",
        "D",
    }
)
"""Operand roles that read a device."""
DRIVEN: Final = frozenset(
    {
        "out",
        "set",
        "pulse",
        "coil",
        "target",
        "target words",
        "bit or target",
        "clock",
        "S",
        "T",
        "set at once",
        "direction",
    }
)
"""Operand roles that drive a device. "S", "T" and "clock" are also in `READ` because their effect depends on the
instruction."""


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
        fx3: Whether only an FX3U has the instruction.
    """

    name: str
    operands: tuple[str, ...] = ()
    fnc: int | None = None
    wide: str = "no"
    pulsed: bool = False
    supported: bool = True
    optional: int = 0
    fx3: bool = False


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


def _fx3(fnc: int, name: str, operands: str, wide: str, *, pulsed: bool = True) -> InstructionKind:
    return InstructionKind(name, tuple(operands.split(", ")), fnc, wide, pulsed, fx3=True)


def _refused(fnc: int, name: str, wide: str = "no", *, pulsed: bool = False) -> InstructionKind:
    return InstructionKind(name, (), fnc, wide, pulsed, supported=False)


_APPLIED: Final = (
    _applied(0, "CJ", "P"),
    _applied(1, "CALL", "P"),
    _applied(2, "SRET", pulsed=False),
    _applied(3, "IRET", pulsed=False),
    _applied(4, "EI", pulsed=False),
    _applied(5, "DI", pulsed=False),
    _applied(6, "FEND", pulsed=False),
    _applied(7, "WDT"),
    _applied(8, "FOR", "source", pulsed=False),
    _applied(9, "NEXT", pulsed=False),
    _applied(10, "CMP", "source, source, coil", "both"),
    _applied(11, "ZCP", "source, source, source, coil", "both"),
    _applied(12, "MOV", "source, target", "both"),
    _applied(13, "SMOV", "source, number, number, target, number"),
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
    _applied(52, "MTR", "X, Y, coil, number", pulsed=False),
    _applied(53, "HSCS", "source, C, set at once", "only", pulsed=False),
    _applied(54, "HSCR", "source, C, reset at once", "only", pulsed=False),
    _applied(55, "HSZ", "source, source, C, coil", "only", pulsed=False),
    _applied(56, "SPD", "X, source, D", pulsed=False),
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
    _applied(78, "FROM", "count, count, target, count", "both"),
    _applied(79, "TO", "count, count, source, count", "both"),
    _applied(80, "RS", "D, count, D, count", pulsed=False),
    _refused(81, "PRUN", "both", pulsed=True),
    _applied(82, "ASCI", "source, target words, number"),
    _applied(83, "HEX", "source words, target, number"),
    _applied(84, "CCD", "words, target words, count"),
    _refused(85, "VRRD", pulsed=True),
    _refused(86, "VRSC", pulsed=True),
    _applied(88, "PID", "D, D, D, D", pulsed=False),
    _applied(110, "ECMP", "float, float, coil", "only"),
    _applied(111, "EZCP", "float, float, float, coil", "only"),
    _fx3(112, "EMOV", "float, D", "only"),
    _refused(118, "EBCD", "only", pulsed=True),
    _refused(119, "EBIN", "only", pulsed=True),
    _applied(120, "EADD", "float, float, D", "only"),
    _applied(121, "ESUB", "float, float, D", "only"),
    _applied(122, "EMUL", "float, float, D", "only"),
    _applied(123, "EDIV", "float, float, D", "only"),
    _applied(127, "ESQR", "float, D", "only"),
    _fx3(128, "ENEG", "D", "only"),
    _applied(129, "INT", "D, D", "both"),
    _applied(130, "SIN", "real, D", "only"),
    _applied(131, "COS", "real, D", "only"),
    _applied(132, "TAN", "real, D", "only"),
    _fx3(136, "RAD", "real, D", "only"),
    _fx3(137, "DEG", "real, D", "only"),
    _applied(147, "SWAP", "target", "both"),
    _refused(155, "ABS", "only"),
    _refused(156, "ZRN", "both"),
    _refused(157, "PLSV", "both"),
    _fx3(158, "DRVI", "source, source, Y, direction", "both", pulsed=False),
    _fx3(159, "DRVA", "source, source, Y, direction", "both", pulsed=False),
    _applied(160, "TCMP", "source, source, source, clock, coil"),
    _applied(161, "TZCP", "clock, clock, clock, coil"),
    _refused(162, "TADD", pulsed=True),
    _refused(163, "TSUB", pulsed=True),
    _applied(166, "TRD", "clock"),
    _refused(167, "TWR", pulsed=True),
    _refused(169, "HOUR", "both"),
    _refused(170, "GRY", "both", pulsed=True),
    _refused(171, "GBIN", "both", pulsed=True),
    _applied(176, "RD3A", "count, count, target"),
    _applied(177, "WR3A", "count, count, source"),
)

_COMPARISONS: Final = tuple(
    InstructionKind(f"{join}{relation}", ("source", "source"), first + n, "both")
    for join, first in zip(JOINS, (224, 232, 240), strict=True)
    for relation, n in (("=", 0), (">", 1), ("<", 2), ("<>", 4), ("<=", 5), (">=", 6))
)

KINDS: Final = (*_BASIC, *_APPLIED, *_COMPARISONS)
"""All instructions of the FX2N, and the supported ones that only an FX3U has."""

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
"""All mnemonics of `KINDS`."""
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
        case RealConstant():
            return "E"
        case WordBit():
            return "D.b"
        case Pointer(kind):
            return kind
        case Nest():
            return "N"


def steps(instruction: Instruction) -> int:
    """Return the number of program steps of an instruction (docs/sources/fx2n.md 1.1)."""
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
    if name in ("OUT", "SET", "RST"):
        return _coil_steps(name, device) + (_far(device) if device.kind == "M" else 0)
    return _far(device) + (2 if name[-1] in "PF" else 1)


def step_numbers(instructions: Iterable[Instruction]) -> list[int]:
    """Return the program step of each instruction of a program."""
    return list(accumulate(map(steps, instructions), initial=0))[:-1]


def _far(device: DeviceOperand) -> int:
    """Return the additional steps of a relay or state with a high number; those above M3071 exist on an FX3U only."""
    match device:
        case DeviceOperand("M", number) if 1536 <= number < 8000:
            return 1 if number < 3584 else 2
        case DeviceOperand("M", number) if number >= 8256:
            return 1
        case DeviceOperand("S", number) if number > 1023:
            return 1
    return 0


def _coil_steps(name: str, device: DeviceOperand) -> int:
    if device.kind == "S" or (device.kind == "M" and device.number >= 8000):
        return 2 - (device.kind == "M" and device.number >= 8256)
    if device.kind in "TC":
        if name == "RST":
            return 2
        return 5 if device.kind == "C" and device.number >= 200 else 3
    return 3 if device.kind in "DRVZ" else 1
