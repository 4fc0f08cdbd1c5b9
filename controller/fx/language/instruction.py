"""Instruction and operand types of an FX2N program, shared by reader, writer, checks, engine and export.

Numbers are plain integers; X and Y are octal in text only: X10 is ``DeviceOperand("X", 8)``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from controller.common.errors import InputError
from controller.core.devices import device_name
from controller.fx.language.cpu_model import FX2N, CpuModel


class LadderError(InputError):
    """Raised for an invalid program; the message has one line for each finding, with its location and the remedy."""


@dataclass(frozen=True, slots=True)
class DeviceOperand:
    """Device operand: X, Y, M, S, T, C, D, V or Z; with an FX3U also R.

    Attributes:
        kind: Device letter.
        number: Device number; for X and Y, the value of the octal label.
        index: V or Z register added to the number at run time, for example "V0"; empty = none.
    """

    kind: str
    number: int
    index: str = ""

    def __str__(self) -> str:
        return device_name(self.kind, self.number) + self.index


@dataclass(frozen=True, slots=True)
class Constant:
    """Number in K (decimal) or H (hexadecimal) notation."""

    value: int
    base: Literal["K", "H"] = "K"
    index: str = ""

    def __str__(self) -> str:
        text = f"K{self.value}" if self.base == "K" else f"H{self.value:X}"
        return text + self.index


@dataclass(frozen=True, slots=True)
class RealConstant:
    """Real number in E notation, for example E1.5. Only an FX3U has it.

    Attributes:
        value: Number in single precision.
    """

    value: float

    def __str__(self) -> str:
        digits, _, exponent = repr(self.value).partition("e")
        return f"E{digits}{int(exponent):+d}" if exponent else f"E{digits}"


@dataclass(frozen=True, slots=True)
class Digits:
    """Group of bits used as a number: K4M0 consists of the 4 x 4 bits M0 to M15, low bit first."""

    digits: int
    device: DeviceOperand

    def __str__(self) -> str:
        return f"K{self.digits}{self.device}"


@dataclass(frozen=True, slots=True)
class WordBit:
    """One bit of a data register, for example D100.F. Only an FX3U has it."""

    number: int
    bit: int

    def __str__(self) -> str:
        return f"D{self.number}.{self.bit:X}"


@dataclass(frozen=True, slots=True)
class Pointer:
    """Label P0 to P127, or label of an interrupt routine, for example I001."""

    kind: Literal["P", "I"]
    number: int

    def __str__(self) -> str:
        return f"{self.kind}{self.number:03}" if self.kind == "I" else f"{self.kind}{self.number}"


@dataclass(frozen=True, slots=True)
class Nest:
    """Nesting level of master control, N0 to N7."""

    number: int

    def __str__(self) -> str:
        return f"N{self.number}"


Operand = DeviceOperand | Constant | RealConstant | Digits | WordBit | Pointer | Nest


@dataclass(frozen=True, slots=True)
class Instruction:
    """One instruction.

    Attributes:
        name: Mnemonic in capitals with its prefix and suffix, for example "DMOVP" or "LD="; "P" or "I" for a label.
        operands: Operands in order; for a label, its pointer.
        line: Source line, from 1; 0 = generated. Ignored when instructions are compared.
        note: Comment.
    """

    name: str
    operands: tuple[Operand, ...] = ()
    line: int = field(default=0, compare=False)
    note: str = field(default="", compare=False)

    def __str__(self) -> str:
        if self.name in ("P", "I"):
            return str(self.operands[0])
        return " ".join((self.name, *map(str, self.operands)))


@dataclass(frozen=True, slots=True)
class Ladder:
    """Program as a list of instructions.

    Attributes:
        instructions: Instructions in order; the last one is END.
        titles: Titles of blocks, by index of the instruction that follows.
        comments: Comment of each device, by its FX name.
        source: File name for messages.
        cpu: CPU for which the program is written.
        notes: Assumptions about the format of the file, such as its encoding.
    """

    instructions: tuple[Instruction, ...]
    titles: dict[int, str] = field(default_factory=dict, compare=False)
    comments: dict[str, str] = field(default_factory=dict, compare=False)
    source: str = field(default="program", compare=False)
    cpu: CpuModel = field(default=FX2N, compare=False)
    notes: tuple[str, ...] = field(default=(), compare=False)
