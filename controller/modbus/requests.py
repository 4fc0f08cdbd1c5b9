"""Requests of a Modbus client: decoded by pymodbus, checked by the specification, answered by a device.

What pymodbus lets pass and the specification does not (counts, lengths, values of a single coil, functions that were
never offered) is refused here before the device sees it. Source: Modbus Application Protocol V1.1b3, 6 and 7.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Final, Protocol, TypeVar, runtime_checkable

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ExceptionResponse, ModbusPDU, ReadCoilsRequest
from pymodbus.pdu.bit_message import (
    ReadCoilsResponse,
    ReadDiscreteInputsRequest,
    ReadDiscreteInputsResponse,
    WriteMultipleCoilsRequest,
    WriteMultipleCoilsResponse,
    WriteSingleCoilRequest,
    WriteSingleCoilResponse,
)
from pymodbus.pdu.mei_message import ReadDeviceInformationResponse
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    ReadInputRegistersRequest,
    ReadInputRegistersResponse,
    ReadWriteMultipleRegistersRequest,
    ReadWriteMultipleRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

MAX_COILS_WRITTEN: Final = 1_968
"""0x7B0; pymodbus lets 2,000 pass."""
MAX_REGISTERS_WRITTEN: Final = 123
MAX_REGISTERS_WRITTEN_AND_READ: Final = 121
SINGLE_COIL_VALUES: Final = (b"\x00\x00", b"\xff\x00")
READ_IDENTITY: Final = 14
"""Kind of function 43 that asks who answers."""
_READ_CODES: Final = range(1, 5)
BASIC_IDENTITY: Final = 0x81
"""Conformity level: the three basic objects, as a whole or one by one."""


class RefusedError(Exception):
    """A request that is answered by an exception code."""

    def __init__(self, code: ExcCodes) -> None:
        super().__init__(code)
        self.code = code


class Device:
    """What a client talks to.

    It offers the functions of those tables below whose methods it has; any other function is refused. Every method of a
    table may raise `RefusedError`; a write that raises has changed nothing.
    """

    def heard(self) -> None:
        """Take note that a request of this client has come, whatever it will turn out to be."""

    def end(self) -> None:
        """Take note that this client is gone."""


@runtime_checkable
class Coils(Protocol):
    """Bits to read and write: functions 1, 5 and 15."""

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return neighbouring coils."""

    def write_coils(self, first: int, levels: Sequence[bool]) -> None:
        """Write neighbouring coils, all of them or none."""


@runtime_checkable
class Inputs(Protocol):
    """Bits to read: function 2."""

    def read_inputs(self, first: int, count: int) -> list[bool]:
        """Return neighbouring discrete inputs."""


@runtime_checkable
class HoldingRegisters(Protocol):
    """Words to read and write: functions 3, 6, 16 and 23."""

    def read_holding(self, first: int, count: int) -> list[int]:
        """Return neighbouring registers, unsigned."""

    def write_registers(self, first: int, values: Sequence[int]) -> None:
        """Write neighbouring registers, unsigned, all of them or none."""


@runtime_checkable
class InputRegisters(Protocol):
    """Words to read: function 4."""

    def read_input_registers(self, first: int, count: int) -> list[int]:
        """Return neighbouring registers, unsigned."""


@runtime_checkable
class Identity(Protocol):
    """Who answers: function 43."""

    def identity(self) -> dict[int, str]:
        """Return vendor (0), product code (1) and revision (2)."""


def answer(device: Device, pdu: bytes) -> bytes:
    """Carry out one request.

    Args:
        device: What is asked.
        pdu: Function code and data, at least one byte.

    Returns:
        The answer PDU, which may be an exception.
    """
    function_code, body = pdu[0], pdu[1:]
    device.heard()
    try:
        carry_out = _offered(type(device)).get(function_code)  # type: ignore[arg-type]  # a class can be hashed
        if carry_out is None:
            raise RefusedError(ExcCodes.ILLEGAL_FUNCTION)
        reply = carry_out(device, body)
    except RefusedError as refused:
        return exception_pdu(function_code, refused.code)
    return _encode(reply)


def exception_pdu(function_code: int, code: ExcCodes) -> bytes:
    """Return the answer that refuses a request."""
    return _encode(ExceptionResponse(function_code, code))


def _encode(reply: ModbusPDU) -> bytes:
    return bytes([reply.function_code]) + reply.encode()


class _Packed(ModbusPDU):
    """Registers that were read, packed at once; pymodbus packs one after the other, which takes five times as long."""

    def encode(self) -> bytes:
        return struct.pack(f">B{len(self.registers)}H", 2 * len(self.registers), *self.registers)


class _HoldingRegisters(_Packed, ReadHoldingRegistersResponse):
    pass


class _InputRegisters(_Packed, ReadInputRegistersResponse):
    pass


CarryOut = Callable[[Any, bytes], ModbusPDU]
"""Takes a device that has the table, and the data of the request."""
P = TypeVar("P", bound=ModbusPDU)


def _decode(request: P, body: bytes, *, size: int | None = 4) -> P:
    """Fill in a request, refusing what pymodbus cannot decode and what it would cut off."""
    if size is not None and len(body) != size:
        raise RefusedError(ExcCodes.ILLEGAL_VALUE)
    try:
        request.decode(body)
    except (ValueError, IndexError, struct.error, ModbusException) as error:
        raise RefusedError(ExcCodes.ILLEGAL_VALUE) from error
    return request


def _require(condition: bool) -> None:
    if not condition:
        raise RefusedError(ExcCodes.ILLEGAL_VALUE)


def _read_coils(device: Coils, body: bytes) -> ModbusPDU:
    request = _decode(ReadCoilsRequest(), body)
    return ReadCoilsResponse(bits=device.read_coils(request.address, request.count))


def _read_inputs(device: Inputs, body: bytes) -> ModbusPDU:
    request = _decode(ReadDiscreteInputsRequest(), body)
    return ReadDiscreteInputsResponse(bits=device.read_inputs(request.address, request.count))


def _read_holding(device: HoldingRegisters, body: bytes) -> ModbusPDU:
    request = _decode(ReadHoldingRegistersRequest(), body)
    return _HoldingRegisters(registers=device.read_holding(request.address, request.count))


def _read_input_registers(device: InputRegisters, body: bytes) -> ModbusPDU:
    request = _decode(ReadInputRegistersRequest(), body)
    return _InputRegisters(registers=device.read_input_registers(request.address, request.count))


def _write_coil(device: Coils, body: bytes) -> ModbusPDU:
    _require(body[2:4] in SINGLE_COIL_VALUES)
    request = _decode(WriteSingleCoilRequest(), body)
    device.write_coils(request.address, [bool(request.bits[0])])
    return WriteSingleCoilResponse(address=request.address, bits=request.bits)


def _write_register(device: HoldingRegisters, body: bytes) -> ModbusPDU:
    request = _decode(WriteSingleRegisterRequest(), body)
    device.write_registers(request.address, request.registers)
    return WriteSingleRegisterResponse(address=request.address, registers=request.registers)


def _write_coils(device: Coils, body: bytes) -> ModbusPDU:
    request = _decode(WriteMultipleCoilsRequest(), body, size=None)
    byte_count = (request.count + 7) // 8
    _require(request.count <= MAX_COILS_WRITTEN and request.byte_count == request.data_byte_count == byte_count)
    device.write_coils(request.address, list(request.bits[: request.count]))
    return WriteMultipleCoilsResponse(address=request.address, count=request.count)


def _write_registers(device: HoldingRegisters, body: bytes) -> ModbusPDU:
    _require(len(body) >= 5 and len(body) == 5 + body[4] and body[4] == 2 * int.from_bytes(body[2:4]))
    request = _decode(WriteMultipleRegistersRequest(), body, size=None)
    _require(1 <= request.count <= MAX_REGISTERS_WRITTEN)
    device.write_registers(request.address, request.registers)
    return WriteMultipleRegistersResponse(address=request.address, count=request.count)


def _write_and_read(device: HoldingRegisters, body: bytes) -> ModbusPDU:
    _require(len(body) >= 9 and len(body) == 9 + body[8] and body[8] == 2 * int.from_bytes(body[6:8]))
    request = _decode(ReadWriteMultipleRegistersRequest(), body, size=None)
    _require(1 <= request.write_count <= MAX_REGISTERS_WRITTEN_AND_READ)
    device.read_holding(request.read_address, request.read_count)  # what cannot be read must not be half done
    device.write_registers(request.write_address, request.write_registers)
    registers = device.read_holding(request.read_address, request.read_count)
    return ReadWriteMultipleRegistersResponse(registers=registers)


def _identify(device: Identity, body: bytes) -> ModbusPDU:
    information = device.identity()
    if body[:1] != bytes([READ_IDENTITY]):
        raise RefusedError(ExcCodes.ILLEGAL_FUNCTION)
    _require(len(body) == 3)
    read_code, wanted = body[1], body[2]
    _require(read_code in _READ_CODES)
    if read_code == _READ_CODES[-1]:  # one object by its number
        if wanted not in information:
            raise RefusedError(ExcCodes.ILLEGAL_ADDRESS)
        information = {wanted: information[wanted]}
    objects = {number: text.encode() for number, text in information.items()}
    reply = ReadDeviceInformationResponse(read_code=read_code, information=objects)
    reply.conformity = BASIC_IDENTITY
    return reply


_TABLES: Final[dict[type, dict[int, CarryOut]]] = {
    Coils: {1: _read_coils, 5: _write_coil, 15: _write_coils},
    Inputs: {2: _read_inputs},
    HoldingRegisters: {3: _read_holding, 6: _write_register, 16: _write_registers, 23: _write_and_read},
    InputRegisters: {4: _read_input_registers},
    Identity: {43: _identify},
}


@cache
def _offered(kind: type[Device]) -> dict[int, CarryOut]:
    """Return what carries out each function that a kind of device offers."""
    offered = (functions for table, functions in _TABLES.items() if issubclass(kind, table))
    return {code: carry_out for functions in offered for code, carry_out in functions.items()}
