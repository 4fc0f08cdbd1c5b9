"""The plant as Modbus sees it: which addresses exist, and what reading and writing them does.

Functions allowed: 1 read coils, 2 read discrete inputs, 4 read input registers, 5 write single
coil, 15 write multiple coils. pymodbus encodes and decodes; what it lets pass and the
specification does not is refused here first. Source: Modbus Application Protocol V1.1b3, 6 and 7.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import TypeVar

from pymodbus.constants import ExcCodes
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
from pymodbus.pdu.register_message import ReadInputRegistersRequest, ReadInputRegistersResponse

from controller.io_map import IoMap, IoMapError
from plant_sim.links.box import BOX_COILS, BoxCoil
from plant_sim.links.io_module import IoModule, ModuleFault
from plant_sim.links.telemetry import encode_telemetry

MAX_COILS_WRITTEN = 1_968  # 0x7B0; pymodbus lets 2,000 pass
SINGLE_COIL_VALUES = (b"\x00\x00", b"\xff\x00")

T = TypeVar("T")


class RefusedError(Exception):
    """A request that is answered by an exception code."""

    def __init__(self, code: ExcCodes) -> None:
        super().__init__(code)
        self.code = code


class ModbusImage:
    """Answers request PDUs from an I/O module, its plant's operator box and telemetry.

    An address that is not declared is refused (exception 02), it never reads 0; a write that
    touches one changes nothing.
    """

    def __init__(self, module: IoModule) -> None:
        """Lay the module's terminals and the operator box out in the Modbus tables.

        Raises:
            IoMapError: the I/O map puts an output where the operator box is.
        """
        self._module = module
        self._inputs_by_offset = {point.offset: point.number for point in module.io_map.inputs}
        self._coils_by_offset = _coil_table(module.io_map)
        self._functions = {
            1: self._read_coils,
            2: self._read_inputs,
            4: self._read_registers,
            5: self._write_coil,
            15: self._write_coils,
        }

    def answer(self, pdu: bytes) -> bytes:
        """Carry out one request.

        Args:
            pdu: Function code and data, at least one byte.

        Returns:
            The answer PDU, which may be an exception.
        """
        function_code, body = pdu[0], pdu[1:]
        try:
            if function_code not in self._functions:
                raise RefusedError(ExcCodes.ILLEGAL_FUNCTION)
            return _encode(self._functions[function_code](body))
        except RefusedError as refused:
            return exception_pdu(function_code, refused.code)
        except ModuleFault:
            return exception_pdu(function_code, ExcCodes.DEVICE_FAILURE)

    def _read_inputs(self, body: bytes) -> ModbusPDU:
        request = _decode(ReadDiscreteInputsRequest(), body, size=4)
        x = self._module.inputs()
        numbers = _look_up(self._inputs_by_offset, request.address, request.count)
        return ReadDiscreteInputsResponse(bits=[x[number] for number in numbers])

    def _read_coils(self, body: bytes) -> ModbusPDU:
        request = _decode(ReadCoilsRequest(), body, size=4)
        y, box = self._module.outputs, self._module.plant.box
        coils = _look_up(self._coils_by_offset, request.address, request.count)
        return ReadCoilsResponse(bits=[y[coil] if isinstance(coil, int) else coil.pressed(box) for coil in coils])

    def _read_registers(self, body: bytes) -> ModbusPDU:
        request = _decode(ReadInputRegistersRequest(), body, size=4)
        registers = encode_telemetry(self._module)
        end = request.address + request.count
        if end > len(registers):
            raise RefusedError(ExcCodes.ILLEGAL_ADDRESS)
        return ReadInputRegistersResponse(registers=registers[request.address : end])

    def _write_coil(self, body: bytes) -> ModbusPDU:
        if body[2:4] not in SINGLE_COIL_VALUES:
            raise RefusedError(ExcCodes.ILLEGAL_VALUE)
        request = _decode(WriteSingleCoilRequest(), body, size=4)
        self._write(request.address, [bool(request.bits[0])])
        return WriteSingleCoilResponse(address=request.address, bits=request.bits)

    def _write_coils(self, body: bytes) -> ModbusPDU:
        request = _decode(WriteMultipleCoilsRequest(), body, size=None)
        byte_count = (request.count + 7) // 8
        if request.count > MAX_COILS_WRITTEN or request.byte_count != byte_count:
            raise RefusedError(ExcCodes.ILLEGAL_VALUE)
        if request.data_byte_count != byte_count:
            raise RefusedError(ExcCodes.ILLEGAL_VALUE)
        self._write(request.address, list(request.bits))
        return WriteMultipleCoilsResponse(address=request.address, count=request.count)

    def _write(self, first: int, levels: list[bool]) -> None:
        """Write neighbouring coils, all of them or none."""
        coils = _look_up(self._coils_by_offset, first, len(levels))
        pairs = list(zip(coils, levels, strict=True))
        self._module.write({coil: level for coil, level in pairs if isinstance(coil, int)})
        for coil, level in pairs:
            if isinstance(coil, BoxCoil):
                coil.press(self._module.plant.box, level)


def exception_pdu(function_code: int, code: ExcCodes) -> bytes:
    """The answer that refuses a request."""
    return _encode(ExceptionResponse(function_code, code))


def _encode(reply: ModbusPDU) -> bytes:
    return bytes([reply.function_code]) + reply.encode()


def _coil_table(io_map: IoMap) -> dict[int, int | BoxCoil]:
    """What lies behind each coil: an output, by Y number, or a button."""
    table: dict[int, int | BoxCoil] = {coil.offset: coil for coil in BOX_COILS}
    for point in io_map.outputs:
        if point.offset in table:
            raise IoMapError(
                f"{io_map.path}:{point.line}: {point.tag}: coil offset {point.offset} is the "
                "plant's operator box; choose another offset"
            )
        table[point.offset] = point.number
    return table


P = TypeVar("P", bound=ModbusPDU)


def _decode(request: P, body: bytes, *, size: int | None) -> P:
    """Fill in a request, refusing what pymodbus cannot decode and what it would cut off."""
    if size is not None and len(body) != size:
        raise RefusedError(ExcCodes.ILLEGAL_VALUE)
    try:
        request.decode(body)
    except (ValueError, struct.error) as error:
        raise RefusedError(ExcCodes.ILLEGAL_VALUE) from error
    return request


def _look_up(table: Mapping[int, T], first: int, count: int) -> list[T]:
    try:
        return [table[offset] for offset in range(first, first + count)]
    except KeyError:
        raise RefusedError(ExcCodes.ILLEGAL_ADDRESS) from None
