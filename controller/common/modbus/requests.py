"""Modbus requests: decoding by pymodbus, checks against the specification, execution by a device.

pymodbus accepts some requests that the specification forbids (invalid counts, lengths and coil values,
unsupported functions). They are rejected here before they reach the device. Source: Modbus Application Protocol V1.1b3,
sections 6 and 7.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Coroutine, Sequence
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
"""Limit of the specification, 0x7B0; pymodbus accepts 2,000."""
MAX_REGISTERS_WRITTEN: Final = 123
MAX_REGISTERS_WRITTEN_AND_READ: Final = 121
SINGLE_COIL_VALUES: Final = (b"\x00\x00", b"\xff\x00")
READ_IDENTITY: Final = 14
"""MEI type of function 43 for reading the device identification."""
_READ_CODES: Final = range(1, 5)
BASIC_IDENTITY: Final = 0x81
"""Conformity level: the three basic objects, by stream or individual access."""


class RequestRefusedError(Exception):
    """Raised for a request that is answered with an exception code."""

    def __init__(self, code: ExcCodes) -> None:
        super().__init__(code)
        self.code = code


class ModbusDevice:
    """Server side of one client connection.

    A device supports the functions of each table protocol below that it implements; other functions are refused. Every
    table method may raise `RequestRefusedError`; a write that raises must change nothing.
    """

    @property
    def has_name(self) -> bool:
        """True if the client has told the name of its operator."""
        return False

    def on_request(self) -> None:
        """Handle the arrival of a request from this client, whether valid or not."""

    def on_disconnect(self) -> None:
        """Handle the disconnection of this client."""


@runtime_checkable
class Coils(Protocol):
    """Readable and writable bits: functions 1, 5 and 15."""

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return consecutive coils."""

    async def write_coils(self, first: int, levels: Sequence[bool]) -> None:
        """Write consecutive coils, all of them or none; return when they can be read."""


@runtime_checkable
class DiscreteInputs(Protocol):
    """Read-only bits: function 2."""

    def read_inputs(self, first: int, count: int) -> list[bool]:
        """Return consecutive discrete inputs."""


@runtime_checkable
class HoldingRegisters(Protocol):
    """Readable and writable words: functions 3, 6, 16 and 23."""

    def read_holding(self, first: int, count: int) -> list[int]:
        """Return consecutive registers, unsigned."""

    async def write_registers(self, first: int, values: Sequence[int]) -> None:
        """Write consecutive registers, unsigned, all of them or none; return when they can be read."""


@runtime_checkable
class InputRegisters(Protocol):
    """Read-only words: function 4."""

    def read_input_registers(self, first: int, count: int) -> list[int]:
        """Return consecutive registers, unsigned."""


@runtime_checkable
class Identity(Protocol):
    """Device identification: function 43."""

    def identity(self) -> dict[int, str]:
        """Return vendor (0), product code (1) and revision (2)."""


async def answer(device: ModbusDevice, pdu: bytes) -> bytes:
    """Execute one request.

    Args:
        device: Device that receives the request.
        pdu: Function code and data, at least one byte.

    Returns:
        Response PDU, which may be an exception response.
    """
    function_code, body = pdu[0], pdu[1:]
    device.on_request()
    try:
        handler = _handlers(type(device)).get(function_code)  # type: ignore[arg-type]  # a class is hashable
        if handler is None:
            raise RequestRefusedError(ExcCodes.ILLEGAL_FUNCTION)
        reply = await handler(device, body)
    except RequestRefusedError as refused:
        return exception_pdu(function_code, refused.code)
    return _encode(reply)


def exception_pdu(function_code: int, code: ExcCodes) -> bytes:
    """Return the exception response to a request."""
    return _encode(ExceptionResponse(function_code, code))


def _encode(reply: ModbusPDU) -> bytes:
    return bytes([reply.function_code]) + reply.encode()


class _Packed(ModbusPDU):
    """Response with registers packed in one call; pymodbus packs them one by one and takes five times as long."""

    def encode(self) -> bytes:
        return struct.pack(f">B{len(self.registers)}H", 2 * len(self.registers), *self.registers)


class _HoldingRegisters(_Packed, ReadHoldingRegistersResponse):
    pass


class _InputRegisters(_Packed, ReadInputRegistersResponse):
    pass


Handler = Callable[[Any, bytes], Coroutine[Any, None, ModbusPDU]]
"""Function that executes a request; its arguments are a device that supports the request, and the request data."""
P = TypeVar("P", bound=ModbusPDU)


def _decode(request: P, body: bytes, *, size: int | None = 4) -> P:
    """Decode a request; reject data that pymodbus cannot decode or would truncate."""
    if size is not None and len(body) != size:
        raise RequestRefusedError(ExcCodes.ILLEGAL_VALUE)
    try:
        request.decode(body)
    except (ValueError, IndexError, struct.error, ModbusException) as error:
        raise RequestRefusedError(ExcCodes.ILLEGAL_VALUE) from error
    return request


def _require(condition: bool) -> None:
    if not condition:
        raise RequestRefusedError(ExcCodes.ILLEGAL_VALUE)


async def _read_coils(device: Coils, body: bytes) -> ModbusPDU:
    request = _decode(ReadCoilsRequest(), body)
    return ReadCoilsResponse(bits=device.read_coils(request.address, request.count))


async def _read_inputs(device: DiscreteInputs, body: bytes) -> ModbusPDU:
    request = _decode(ReadDiscreteInputsRequest(), body)
    return ReadDiscreteInputsResponse(bits=device.read_inputs(request.address, request.count))


async def _read_holding(device: HoldingRegisters, body: bytes) -> ModbusPDU:
    request = _decode(ReadHoldingRegistersRequest(), body)
    return _HoldingRegisters(registers=device.read_holding(request.address, request.count))


async def _read_input_registers(device: InputRegisters, body: bytes) -> ModbusPDU:
    request = _decode(ReadInputRegistersRequest(), body)
    return _InputRegisters(registers=device.read_input_registers(request.address, request.count))


async def _write_coil(device: Coils, body: bytes) -> ModbusPDU:
    _require(body[2:4] in SINGLE_COIL_VALUES)
    request = _decode(WriteSingleCoilRequest(), body)
    await device.write_coils(request.address, [bool(request.bits[0])])
    return WriteSingleCoilResponse(address=request.address, bits=request.bits)


async def _write_register(device: HoldingRegisters, body: bytes) -> ModbusPDU:
    request = _decode(WriteSingleRegisterRequest(), body)
    await device.write_registers(request.address, request.registers)
    return WriteSingleRegisterResponse(address=request.address, registers=request.registers)


async def _write_coils(device: Coils, body: bytes) -> ModbusPDU:
    request = _decode(WriteMultipleCoilsRequest(), body, size=None)
    byte_count = (request.count + 7) // 8
    _require(request.count <= MAX_COILS_WRITTEN and request.byte_count == request.data_byte_count == byte_count)
    await device.write_coils(request.address, list(request.bits[: request.count]))
    return WriteMultipleCoilsResponse(address=request.address, count=request.count)


async def _write_registers(device: HoldingRegisters, body: bytes) -> ModbusPDU:
    _require(len(body) >= 5 and len(body) == 5 + body[4] and body[4] == 2 * int.from_bytes(body[2:4]))
    request = _decode(WriteMultipleRegistersRequest(), body, size=None)
    _require(1 <= request.count <= MAX_REGISTERS_WRITTEN)
    await device.write_registers(request.address, request.registers)
    return WriteMultipleRegistersResponse(address=request.address, count=request.count)


async def _write_and_read(device: HoldingRegisters, body: bytes) -> ModbusPDU:
    _require(len(body) >= 9 and len(body) == 9 + body[8] and body[8] == 2 * int.from_bytes(body[6:8]))
    request = _decode(ReadWriteMultipleRegistersRequest(), body, size=None)
    _require(1 <= request.write_count <= MAX_REGISTERS_WRITTEN_AND_READ)
    device.read_holding(request.read_address, request.read_count)  # an invalid read must prevent the write
    await device.write_registers(request.write_address, request.write_registers)
    registers = device.read_holding(request.read_address, request.read_count)
    return ReadWriteMultipleRegistersResponse(registers=registers)


async def _identify(device: Identity, body: bytes) -> ModbusPDU:
    information = device.identity()
    if body[:1] != bytes([READ_IDENTITY]):
        raise RequestRefusedError(ExcCodes.ILLEGAL_FUNCTION)
    _require(len(body) == 3)
    read_code, object_id = body[1], body[2]
    _require(read_code in _READ_CODES)
    if read_code == _READ_CODES[-1]:  # individual access
        if object_id not in information:
            raise RequestRefusedError(ExcCodes.ILLEGAL_ADDRESS)
        information = {object_id: information[object_id]}
    objects = {number: text.encode() for number, text in information.items()}
    reply = ReadDeviceInformationResponse(read_code=read_code, information=objects)
    reply.conformity = BASIC_IDENTITY
    return reply


_TABLES: Final[dict[type, dict[int, Handler]]] = {
    Coils: {1: _read_coils, 5: _write_coil, 15: _write_coils},
    DiscreteInputs: {2: _read_inputs},
    HoldingRegisters: {3: _read_holding, 6: _write_register, 16: _write_registers, 23: _write_and_read},
    InputRegisters: {4: _read_input_registers},
    Identity: {43: _identify},
}


@cache
def _handlers(device_class: type[ModbusDevice]) -> dict[int, Handler]:
    """Return the handler of each function code that a device class supports."""
    supported = (handlers for table, handlers in _TABLES.items() if issubclass(device_class, table))
    return {code: handler for handlers in supported for code, handler in handlers.items()}
