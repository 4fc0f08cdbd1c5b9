"""Operands in the program part of a GX Developer project: records of prefixes, devices and constants.

The codes are those of the tables in source [13] (verified, docs/sources/fx2n.md 2.3). A number has as few bytes as
possible, low byte first; a negative constant has four.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final

from controller.core.devices import device_name
from controller.fx.language.instruction import (
    Constant,
    DeviceOperand,
    Digits,
    Nest,
    Operand,
    Pointer,
    RealConstant,
    WordBit,
)

DEVICES: Final = {"M": 0x90, "S": 0x98, "X": 0x9C, "Y": 0x9D, "T": 0xC2, "C": 0xC5, "D": 0xA8, "Z": 0xCC, "V": 0xCD}
LABELS: Final = {"P": 0xD0, "I": 0xD1}
_NEST: Final = 0xD2
_Z_PREFIX, _DIGITS_PREFIX, _BIT_PREFIX, _V_PREFIX = 0xF0, 0xF1, 0xF2, 0xF4
_PREFIXES: Final = frozenset({_Z_PREFIX, _DIGITS_PREFIX, _BIT_PREFIX, _V_PREFIX})
_CONSTANTS: Final = {("K", False): 0xE8, ("K", True): 0xE9, ("H", False): 0xEA, ("H", True): 0xEB}
_REAL: Final = 0xEC
_NAMES: Final = {code: kind for kind, code in (DEVICES | LABELS).items()}
_MOST_BYTES: Final = 4


class OperandCodeError(ValueError):
    """Raised for records that are not an operand; the message is the unknown content."""


def record(content: bytes) -> bytes:
    """Return a record: its length, the content, and its length."""
    length = len(content) + 2
    return bytes((length, *content, length))


def _number(code: int, value: int, size: int | None = None) -> bytes:
    """Return the record of a code with a number."""
    value &= 0xFFFF_FFFF
    return record(bytes((code,)) + value.to_bytes(size or max(1, -(-value.bit_length() // 8)), "little"))


def encode_operand(operand: Operand, *, wide: bool) -> bytes:
    """Return the records of an operand; `wide` selects the code of a 32-bit constant."""
    match operand:
        case Constant(value, base, index):
            return _prefix(index) + _number(_CONSTANTS[base, wide], value)
        case RealConstant(value):
            return record(bytes((_REAL,)) + struct.pack("<f", value))
        case Digits(digits, device):
            return _number(_DIGITS_PREFIX, digits) + encode_operand(device, wide=wide)
        case WordBit(number, bit):
            return _number(_BIT_PREFIX, bit) + _number(DEVICES["D"], number)
        case DeviceOperand(kind, number, index):
            return _prefix(index) + _number(DEVICES[kind], number)
        case Pointer(kind, number):
            return _number(LABELS[kind], number)
        case Nest(number):
            return _number(_NEST, number)


def _prefix(index: str) -> bytes:
    return _number(_V_PREFIX if index[0] == "V" else _Z_PREFIX, int(index[1:])) if index else b""


def operand_text(records: Iterator[bytes]) -> tuple[str, bytes]:
    """Return the next operand as text, and its records.

    Args:
        records: Contents of the following records.

    Raises:
        OperandCodeError: The records are not an operand.
    """
    digits = index = bit = ""
    used = b""
    while True:
        content = next(records, b"")
        used += record(content)
        code, value = _decoded(content)
        match code:
            case _ if code == _DIGITS_PREFIX:
                digits = f"K{value}"
            case _ if code == _Z_PREFIX:
                index = f"Z{value}"
            case _ if code == _V_PREFIX:
                index = f"V{value}"
            case _ if code == _BIT_PREFIX:
                bit = f".{value:X}"
            case _:
                return f"{digits}{_base(code, value, content)}{bit}{index}", used


def _decoded(content: bytes) -> tuple[int, int]:
    """Return the code and the number of a record."""
    if not 1 < len(content) <= _MOST_BYTES + 1:
        raise OperandCodeError(content.hex(" ") or "nothing")
    return content[0], int.from_bytes(content[1:], "little")


def _base(code: int, value: int, content: bytes) -> str:
    """Return a device or constant as text."""
    if code in _NAMES:
        name = _NAMES[code]
        return f"I{value:03}" if name == "I" else device_name(name, value)
    if code == _NEST:
        return f"N{value}"
    if code == _REAL and len(content) == _MOST_BYTES + 1:
        return str(RealConstant(struct.unpack("<f", content[1:])[0]))
    base = next((base for (base, _), known in _CONSTANTS.items() if known == code), None)
    if base is None:
        raise OperandCodeError(content.hex(" "))
    signed = value - 2**32 if base == "K" and value >= 2**31 else value
    return f"{base}{signed:X}" if base == "H" else f"{base}{signed}"
