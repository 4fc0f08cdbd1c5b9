"""Client of a PLC that is a Modbus server: one exchange writes the inputs and reads the outputs."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from plant_sim.links.plc.bits import levels_of, packed_bytes, packed_words
from plant_sim.links.plc.port import PlcError
from plant_sim.links.plc.profile import ModbusArea, PlcBlock, PlcProfile
from plant_sim.links.plc.transport import EXCEPTION, ModbusTransport

_READ: Final[dict[ModbusArea | None, int]] = {
    ModbusArea.COIL: 1,
    ModbusArea.DISCRETE_INPUT: 2,
    ModbusArea.HOLDING_REGISTER: 3,
    ModbusArea.INPUT_REGISTER: 4,
}
_WRITE_COILS: Final = 15
_WRITE_REGISTERS: Final = 16
_WRITE_AND_READ: Final = 23
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

    def __init__(self, profile: PlcProfile, transport: ModbusTransport, *, output_count: int) -> None:
        """Create a client that is not connected.

        Args:
            profile: Place of inputs and outputs.
            transport: Closed line to the PLC.
            output_count: Number of outputs, from Y0.
        """
        self.address = transport.address
        self._profile, self._transport, self._output_count = profile, transport, output_count

    async def open(self) -> None:
        """Connect.

        Raises:
            PlcError: The PLC is not reachable.
        """
        await self._transport.open()

    def close(self) -> None:
        """Disconnect; no effect if closed."""
        self._transport.close()

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
        if self._profile.function_23:
            count, words = outputs.length(self._output_count), packed_words(inputs)
            pdu = struct.pack(">HHHHB", outputs.first, count, block.first, len(words), 2 * len(words))
            return self._levels(await self._ask(_WRITE_AND_READ, pdu + struct.pack(f">{len(words)}H", *words)), outputs)
        if block.area is ModbusArea.HOLDING_REGISTER:
            words = packed_words(inputs)
            head = struct.pack(">HH", block.first, len(words))
            await self._write(_WRITE_REGISTERS, head, struct.pack(f">{len(words)}H", *words))
        else:
            await self._write(_WRITE_COILS, struct.pack(">HH", block.first, len(inputs)), packed_bytes(inputs))
        count = outputs.length(self._output_count)
        return self._levels(await self._ask(_READ[outputs.area], struct.pack(">HH", outputs.first, count)), outputs)

    async def _write(self, function: int, head: bytes, data: bytes) -> None:
        answer = await self._ask(function, head + bytes([len(data)]) + data)
        if answer != head:
            raise PlcError(f"answer to function {function} confirms another address or count")

    async def _ask(self, function: int, body: bytes) -> bytes:
        """Send a request and return the data of the answer."""
        answer = await self._transport.request(bytes([function]) + body)
        if answer[0] == function | EXCEPTION and len(answer) == 2:
            place = " and ".join(f"{b.device} ({b.area} {b.first})" for b in self._blocks(function))
            meaning = _EXCEPTIONS.get(answer[1], "see the manual of the PLC")
            raise PlcError(f"exception {answer[1]} ({meaning}) to function {function} at {place}; check the profile")
        if answer[0] != function:
            raise PlcError(f"answer has function {answer[0]} instead of {function}")
        return answer[1:]

    def _blocks(self, function: int) -> list[PlcBlock]:
        profile = self._profile
        if function == _WRITE_AND_READ:
            return [profile.outputs, profile.inputs]
        return [profile.inputs if function in {_WRITE_COILS, _WRITE_REGISTERS} else profile.outputs]

    def _levels(self, answer: bytes, block: PlcBlock) -> list[bool]:
        """Return the outputs in the data of an answer."""
        is_words = block.area is not None and block.area.is_words
        size = 2 * block.length(self._output_count) if is_words else (self._output_count + 7) // 8
        if len(answer) != 1 + size or answer[0] != size:
            raise PlcError(f"answer has {len(answer) - 1} bytes of outputs instead of {size}")
        if is_words:
            return levels_of(struct.unpack(f">{size // 2}H", answer[1:]), self._output_count)
        return levels_of(answer[1:], self._output_count, width=8)
