"""Modbus TCP frames, independent of the request contents.

The pymodbus server loses pipelined requests and blocks on an invalid header. Therefore frames are split
here and only complete requests reach the device. Source: Modbus Messaging on TCP/IP Implementation Guide V1.0b,
section 3.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from controller.common.connections import Answered, ConnectionServer, LateAnswer, begun
from controller.common.modbus.requests import ModbusDevice, answer

HEADER = struct.Struct(">HHHB")
"""Header: transaction, protocol, length of the following data, unit."""
UNCOUNTED_BYTES = 6
"""Number of header bytes that the length field does not count: those up to and including the length field."""
MIN_LENGTH = 2
"""Smallest valid length: unit and function code."""
MAX_LENGTH = 254
"""Largest valid length: unit and the largest PDU of 253 bytes."""


class MbapSession:
    """Session of one client: splits the byte stream into complete requests and answers them in order."""

    def __init__(self, device: ModbusDevice) -> None:
        """Create the session of a client.

        Args:
            device: Device presented to the client.
        """
        self._device = device

    @property
    def has_name(self) -> bool:
        """True if the client has told the name of its operator."""
        return self._device.has_name

    def on_disconnect(self) -> None:
        """Notice that the client is gone."""
        self._device.on_disconnect()

    def answer(self, received: memoryview) -> Answered:
        """Answer the complete frames; the data is invalid if a header is not a Modbus TCP header."""
        used = requests = 0
        filled = len(received)
        answers: list[bytes] = []
        while filled - used >= HEADER.size:
            transaction, protocol, length, unit = HEADER.unpack_from(received, used)
            # without a valid length, the beginning of the next frame is not known (docs/sources/ecosystem.md 1)
            if protocol != 0 or not MIN_LENGTH <= length <= MAX_LENGTH:
                return Answered(used, b"".join(answers), requests, is_valid=False)
            end = used + UNCOUNTED_BYTES + length
            if end > filled:
                break
            answering = begun(self._answered(transaction, unit, bytes(received[used + HEADER.size : end])))
            requests += 1
            used = end
            if isinstance(answering, LateAnswer):
                return Answered(used, b"".join(answers), requests, late=answering)
            answers.append(answering)
        return Answered(used, b"".join(answers), requests)

    async def _answered(self, transaction: int, unit: int, request: bytes) -> bytes:
        pdu = await answer(self._device, request)
        return HEADER.pack(transaction, 0, len(pdu) + 1, unit) + pdu


class MbapServer(ConnectionServer):
    """Connections of a Modbus TCP server."""

    def __init__(
        self, device_for: Callable[[str], ModbusDevice], max_connections: int = 8, idle_timeout_s: float = 60.0
    ) -> None:
        """Initialise without connections.

        Args:
            device_for: Function that returns the device of a new client, given the client's address.
            max_connections: Number of places of the clients.
            idle_timeout_s: Time without a complete request after which a connection is closed, s.
        """
        super().__init__(lambda peer: MbapSession(device_for(peer)), max_connections, idle_timeout_s)
