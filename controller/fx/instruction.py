"""One instruction of an FX2N program and its operands: the form that reader, writer, checks, engine and export share.

Numbers are plain integers here; X and Y are octal in text only: X10 is ``Device("X", 8)``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from controller.core.devices import device_name


class LadderError(ValueError):
    """What is wrong with a program; `str()` is one line a finding, each with its place and the remedy."""


@dataclass(frozen=True, slots=True)
class Device:
    """A device X Y M S T C D V or Z.

    Attributes:
        kind: Its letter.
        number: Its number, octal labels resolved.
        index: The V or Z that is added to the number at run time, as "V0"; empty = none.
    """

    kind: str
    number: int
    index: str = ""

    def __str__(self) -> str:
        return device_name(self.kind, self.number) + self.index


@dataclass(frozen=True, slots=True)
class Constant:
    """A number written as K (decimal) or H (hexadecimal)."""

    value: int
    base: Literal["K", "H"] = "K"
    index: str = ""

    def __str__(self) -> str:
        text = f"K{self.value}" if self.base == "K" else f"H{self.value:X}"
        return text + self.index


@dataclass(frozen=True, slots=True)
class Digits:
    """A group of bits as a number: K4M0 is the 4 x 4 bits M0 to M15, low bit first."""

    digits: int
    device: Device

    def __str__(self) -> str:
        return f"K{self.digits}{self.device}"


@dataclass(frozen=True, slots=True)
class WordBit:
    """One bit of a data register, D100.F: an FX3 has it, an FX2N has not. Programs that use it run here too."""

    number: int
    bit: int

    def __str__(self) -> str:
        return f"D{self.number}.{self.bit:X}"


@dataclass(frozen=True, slots=True)
class Pointer:
    """A label P0 to P127, or an interrupt label I."""

    kind: Literal["P", "I"]
    number: int

    def __str__(self) -> str:
        return f"{self.kind}{self.number}"


@dataclass(frozen=True, slots=True)
class Nest:
    """A level of master control, N0 to N7."""

    number: int

    def __str__(self) -> str:
        return f"N{self.number}"


Operand = Device | Constant | Digits | WordBit | Pointer | Nest


@dataclass(frozen=True, slots=True)
class Instruction:
    """One instruction.

    Attributes:
        name: Mnemonic in capitals with its prefix and suffix, as "DMOVP" or "LD="; a label is "P" or "I".
        operands: Its operands in order; a label's is the pointer.
        line: Line of the text it was read from, from 1; 0 = made, not read. Two instructions are equal wherever they
            stand.
        note: Comment on it.
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
    """A program as instructions.

    Attributes:
        instructions: In order; the last is END.
        titles: Statements in front of blocks, by index of the instruction that they precede.
        comments: Comment of each device, by its FX name.
        source: Where it was read from, for messages.
    """

    instructions: tuple[Instruction, ...]
    titles: dict[int, str] = field(default_factory=dict, compare=False)
    comments: dict[str, str] = field(default_factory=dict, compare=False)
    source: str = field(default="program", compare=False)
