"""Modbus requests of a client and the checks of their answers.

Source: Modbus Application Protocol V1.1b3, section 6.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from pymodbus.constants import ExcCodes

from controller.common.modbus.client import EXCEPTION
from controller.common.modbus.io_map import ModbusTable

READ_FUNCTION: Final = {
    ModbusTable.COIL: 1,
    ModbusTable.DISCRETE_INPUT: 2,
    ModbusTable.HOLDING_REGISTER: 3,
    ModbusTable.INPUT_REGISTER: 4,
}
WORD_TABLES: Final = (ModbusTable.HOLDING_REGISTER, ModbusTable.INPUT_REGISTER)
WRITE_SINGLE_REGISTER: Final = 6
DIAGNOSTICS: Final = 8
WRITE_COILS: Final = 15
WRITE_REGISTERS: Final = 16
READ_WRITE_REGISTERS: Final = 23
_READS: Final = {1, 2, 3, 4, READ_WRITE_REGISTERS}
_ADDRESS_AND_COUNT: Final = 5
"""Bytes of a write request that its answer repeats: function, address and count or value."""


class AnswerError(Exception):
    """Raised for an answer that is not valid for its request; the message is the reason."""


class ExceptionReplyError(AnswerError):
    """Raised for an exception response.

    Attributes:
        code: Exception code.
    """

    def __init__(self, code: int) -> None:
        name = ExcCodes(code).name.lower().replace("_", " ") if code in set(ExcCodes) else "unknown"
        super().__init__(f"refused with exception {code:02d} ({name})")
        self.code = code


@dataclass(frozen=True, slots=True)
class ModbusRequest:
    """Request to a device.

    Attributes:
        operation: Description for messages.
        pdu: Function code and data.
    """

    operation: str
    pdu: bytes

    @property
    def function(self) -> int:
        """Function code."""
        return self.pdu[0]

    def data(self, answer: bytes) -> bytes:
        """Return the data of an answer to a read; empty for a write that is confirmed.

        Raises:
            AnswerError: The answer is an exception response, or not valid for this request.
        """
        function = self.function
        if answer[:1] == bytes([function | EXCEPTION]) and len(answer) == 2:
            raise ExceptionReplyError(answer[1])
        if answer[:1] != self.pdu[:1]:
            raise AnswerError(f"answer to another function ({answer[0] if answer else 'none'})")
        if function not in _READS:
            self._check_confirmation(answer)
            return b""
        count = int.from_bytes(self.pdu[3:5])
        expected = (count + 7) // 8 if function in (1, 2) else 2 * count
        if len(answer) < 2 or answer[1] != expected or len(answer) != 2 + expected:
            size = len(answer) - 2
            content = f"{8 * size} bits" if function in (1, 2) else f"{size // 2} registers"
            raise AnswerError(f"answer contains {content}")
        return answer[2:]

    def _check_confirmation(self, answer: bytes) -> None:
        if self.function == DIAGNOSTICS and answer != self.pdu:
            raise AnswerError("the echo differs")
        if answer[:_ADDRESS_AND_COUNT] != self.pdu[:_ADDRESS_AND_COUNT] or len(answer) != _ADDRESS_AND_COUNT:
            first, count = int.from_bytes(answer[1:3]), int.from_bytes(answer[3:5])
            raise AnswerError(f"answer confirms {count} from {first}")


def read(table: ModbusTable, first: int, count: int, what: str) -> ModbusRequest:
    """Return a request that reads consecutive bits or registers."""
    return ModbusRequest(
        f"read of {count} {what} from offset {first}", struct.pack(">BHH", READ_FUNCTION[table], first, count)
    )


def write_coils(first: int, count: int, bits: int, what: str) -> ModbusRequest:
    """Return a request that writes consecutive coils; bit 0 of `bits` is the first coil."""
    data = bits.to_bytes((count + 7) // 8, "little")
    pdu = struct.pack(">BHHB", WRITE_COILS, first, count, len(data)) + data
    return ModbusRequest(f"write of {count} {what} from offset {first}", pdu)


def write_registers(first: int, values: Sequence[int], what: str = "registers") -> ModbusRequest:
    """Return a request that writes consecutive registers."""
    pdu = struct.pack(">BHHB", WRITE_REGISTERS, first, len(values), 2 * len(values)) + packed(values)
    return ModbusRequest(f"write of {len(values)} {what} from offset {first}", pdu)


def write_register(address: int, value: int) -> ModbusRequest:
    """Return a request that writes one register."""
    return ModbusRequest(
        f"write of register {address:#06x}", struct.pack(">BHH", WRITE_SINGLE_REGISTER, address, value)
    )


def write_coil(address: int, value: int) -> ModbusRequest:
    """Return a request that writes one coil."""
    return ModbusRequest(f"write of coil {address}", struct.pack(">BHH", 5, address, 0xFF00 if value else 0))


def write_and_read(first: int, values: Sequence[int], read_first: int, read_count: int) -> ModbusRequest:
    """Return a request that writes registers and then reads others."""
    pdu = struct.pack(">BHHHHB", READ_WRITE_REGISTERS, read_first, read_count, first, len(values), 2 * len(values))
    operation = f"write of {len(values)} registers from offset {first} and read of {read_count} from {read_first}"
    return ModbusRequest(operation, pdu + packed(values))


def echo(number: int) -> ModbusRequest:
    """Return a request for an echo of a number (function 8, sub-function 0)."""
    return ModbusRequest("echo", struct.pack(">BHH", DIAGNOSTICS, 0, number))


def packed(values: Iterable[int]) -> bytes:
    """Return registers as bytes, high byte first."""
    return b"".join(value.to_bytes(2) for value in values)


def unpacked(data: bytes) -> list[int]:
    """Return bytes as registers, high byte first."""
    return [int.from_bytes(data[n : n + 2]) for n in range(0, len(data), 2)]
