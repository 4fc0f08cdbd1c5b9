"""Devices of an FX PLC as the MC protocol names them.

X and Y have octal labels, and all frames contain the value of the label: X10 is number 8. Sources of the 1E codes:
FX3U-ENET user's manual 9.3 (device list, public scan), of the 3E codes: FX5 user's manual (MELSEC communication
protocol), "Device range", and the tables of plc-comm-slmp and pymcprotocol (PyPI), which agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from controller.common.errors import InputError


class DeviceTextError(InputError):
    """Raised for the text of a device that does not exist."""


@dataclass(frozen=True, slots=True)
class DeviceKind:
    """One kind of device.

    Attributes:
        name: Name in requests: X Y M S D R TN CN, T and C for the contacts of timers and counters, SM and SD for
            the special devices of the FX5 (SM8000 is M8000).
        is_bit: True for a bit, False for a word.
        code_1e: Code in a 1E frame; None if the frame does not have this device.
        code_3e: Code in a binary 3E or 4E frame.
        text_3e: Code in an ASCII 3E or 4E frame.
        is_hexadecimal: True if an ASCII 3E or 4E frame contains the number in hexadecimal instead of decimal digits.
    """

    name: str
    is_bit: bool
    code_1e: int | None
    code_3e: int
    text_3e: str
    is_hexadecimal: bool = False


KINDS: Final = {
    kind.name: kind
    for kind in (
        DeviceKind("X", True, 0x5820, 0x9C, "X*", is_hexadecimal=True),
        DeviceKind("Y", True, 0x5920, 0x9D, "Y*", is_hexadecimal=True),
        DeviceKind("M", True, 0x4D20, 0x90, "M*"),
        DeviceKind("S", True, 0x5320, 0x98, "S*"),
        DeviceKind("T", True, 0x5453, 0xC1, "TS"),
        DeviceKind("C", True, 0x4353, 0xC4, "CS"),
        DeviceKind("SM", True, None, 0x91, "SM"),
        DeviceKind("TN", False, 0x544E, 0xC2, "TN"),
        DeviceKind("CN", False, 0x434E, 0xC5, "CN"),
        DeviceKind("D", False, 0x4420, 0xA8, "D*"),
        DeviceKind("R", False, 0x5220, 0xAF, "R*"),
        DeviceKind("SD", False, None, 0xA9, "SD"),
    )
}
"""Kinds of devices by name."""

BY_CODE_1E: Final = {kind.code_1e: kind for kind in KINDS.values() if kind.code_1e is not None}
BY_CODE_3E: Final = {kind.code_3e: kind for kind in KINDS.values()}
BY_TEXT_3E: Final = {kind.text_3e: kind for kind in KINDS.values()}

FIRST_32_BIT_COUNTER: Final = 200
"""Number of the first counter whose current value has two words."""


@dataclass(frozen=True, slots=True)
class Device:
    """One device.

    Attributes:
        kind: Name of its kind, a key of `KINDS`.
        number: Number; for X and Y, the value of the octal label.
    """

    kind: str
    number: int

    @classmethod
    def parsed(cls, text: str) -> Device:
        """Return the device with an FX name.

        Raises:
            DeviceTextError: No device has this name.

        Examples:
            >>> Device.parsed("X10"), Device.parsed("TN4")
            (Device(kind='X', number=8), Device(kind='TN', number=4))
        """
        name = text.rstrip("0123456789")
        digits = text[len(name) :]
        base = 8 if name in ("X", "Y") else 10
        if name not in KINDS or not digits or (base == 8 and set(digits) & set("89")):
            raise DeviceTextError(
                f"device {text!r}: must be one of {', '.join(KINDS)} with a number; X and Y numbers are octal"
            )
        return cls(name, int(digits, base))

    def __str__(self) -> str:
        """Return the FX name."""
        return f"{self.kind}{self.number:o}" if self.kind in ("X", "Y") else f"{self.kind}{self.number}"


def splits_counter(first: Device, count: int) -> bool:
    """Return True if the last of several words is the low half of the value of a 32-bit counter."""
    if first.kind != "CN":
        return False
    single = max(0, min(FIRST_32_BIT_COUNTER - first.number, count))
    return (count - single) % 2 == 1
