"""Client of a PLC that is a Modbus server: one exchange writes the inputs and reads the outputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from controller.common.modbus.async_client import AsyncModbusClient, ModbusClientError
from controller.common.modbus.bits import levels_of, packed_bytes, packed_words
from controller.common.modbus.client_requests import (
    READ_WRITE_REGISTERS,
    WORD_TABLES,
    WRITE_COILS,
    WRITE_REGISTERS,
    AnswerError,
    ExceptionReplyError,
    ModbusRequest,
    read,
    unpacked,
    write_and_read,
    write_coils,
    write_registers,
)
from controller.common.modbus.io_map import ModbusTable
from plant_sim.links.plc.port import PlcError
from plant_sim.links.plc.profile import PlcBlock, PlcProfile

_EXCEPTIONS: Final = {
    1: "function not supported",
    2: "no such address",
    3: "invalid count or value",
    4: "device failure",
    6: "busy",
}
"""Meanings of exception codes. Source: Modbus Application Protocol V1.1b3, 7."""


class ModbusPlc:
    """PLC that is a Modbus server.

    Attributes:
        address: Address for messages.
    """

    def __init__(self, profile: PlcProfile, client: AsyncModbusClient, *, output_count: int) -> None:
        """Create a client that is not connected.

        Args:
            profile: Place of inputs and outputs.
            client: Closed client of the PLC.
            output_count: Number of outputs, from Y0.

        Raises:
            ValueError: The profile is for the MC protocol.
        """
        if profile.outputs.area is None:
            raise ValueError(f"{profile.title}: is no profile for Modbus")
        self._output_table = profile.outputs.area
        self.address = client.address
        self._profile, self._client, self._output_count = profile, client, output_count

    async def open(self) -> None:
        """Connect.

        Raises:
            PlcError: The PLC is not reachable.
        """
        try:
            await self._client.open()
        except ModbusClientError as error:
            raise PlcError(str(error)) from error

    def close(self) -> None:
        """Disconnect; no effect if closed."""
        self._client.close()

    async def exchange(self, inputs: Sequence[bool]) -> list[bool]:
        """Write the input block, then read the outputs.

        Args:
            inputs: Levels of the input block.

        Returns:
            Levels of the outputs from Y0.

        Raises:
            PlcError: An answer is missing, wrong or an exception.
        """
        outputs, block = self._profile.outputs, self._profile.inputs
        count = outputs.length(self._output_count)
        if self._profile.function_23:
            request = write_and_read(block.first, packed_words(inputs), outputs.first, count)
            return self._levels(await self._data(request), outputs)
        if block.area is ModbusTable.HOLDING_REGISTER:
            await self._data(write_registers(block.first, packed_words(inputs)))
        else:
            bits = int.from_bytes(packed_bytes(inputs), "little")
            await self._data(write_coils(block.first, len(inputs), bits, "inputs"))
        return self._levels(await self._data(read(self._output_table, outputs.first, count, "outputs")), outputs)

    async def _data(self, request: ModbusRequest) -> bytes:
        """Send a request and return the data of the answer."""
        try:
            return request.data(await self._client.request(request.pdu))
        except ExceptionReplyError as error:
            place = " and ".join(f"{b.device} ({b.area} {b.first})" for b in self._blocks(request.function))
            meaning = _EXCEPTIONS.get(error.code, "see the manual of the PLC")
            raise PlcError(
                f"exception {error.code} ({meaning}) to function {request.function} at {place}; check the profile"
            ) from error
        except (AnswerError, ModbusClientError) as error:
            raise PlcError(str(error)) from error

    def _blocks(self, function: int) -> list[PlcBlock]:
        profile = self._profile
        if function == READ_WRITE_REGISTERS:
            return [profile.outputs, profile.inputs]
        return [profile.inputs if function in {WRITE_COILS, WRITE_REGISTERS} else profile.outputs]

    def _levels(self, data: bytes, block: PlcBlock) -> list[bool]:
        """Return the outputs in the data of an answer."""
        if block.area in WORD_TABLES:
            return levels_of(unpacked(data), self._output_count)
        return levels_of(data, self._output_count, width=8)
