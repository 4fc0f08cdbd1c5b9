"""Lines to a Modbus server: a TCP connection or an RTU line, for one request at a time.

An answer is accepted only if transaction, unit, function, length and, on a serial line, checksum are those expected. On
TCP any other answer ends the connection, so that a late answer is never taken for that of the next request.
"""

from __future__ import annotations

import asyncio
from typing import Any, Final, Protocol

from controller.common.modbus.mbap import HEADER, MAX_LENGTH, MIN_LENGTH
from controller.common.modbus.rtu import LONGEST_FRAME, SerialLine, framed, is_checksum_valid
from plant_sim.links.plc.port import PlcError

EXCEPTION: Final = 0x80
"""Bit of the function code in an exception response."""
_COUNTED: Final = frozenset({1, 2, 3, 4, 23})
"""Functions whose answers begin with a byte count; the answers of the others have 5 bytes."""


class ModbusTransport(Protocol):
    """Line to a Modbus server, for one request at a time.

    Attributes:
        address: Address for messages.
    """

    address: str

    async def open(self) -> None:
        """Connect. Raises: PlcError."""

    async def request(self, pdu: bytes) -> bytes:
        """Send a request and return the answer, both without address and checksum. Raises: PlcError."""

    def close(self) -> None:
        """Disconnect; no effect if closed."""


class TcpTransport:
    """Modbus TCP connection.

    Attributes:
        address: Host and port.
    """

    def __init__(self, host: str, port: int, *, unit: int, timeout_s: float) -> None:
        """Create a closed connection.

        Args:
            host: Name or address of the PLC.
            port: TCP port.
            unit: Unit identifier.
            timeout_s: Longest time for the connection and for an answer, s.
        """
        self.address = f"{host}:{port}"
        self._host, self._port, self._unit, self._timeout_s = host, port, unit, timeout_s
        self._reader: asyncio.StreamReader
        self._writer: asyncio.StreamWriter | None = None
        self._transaction = 0

    async def open(self) -> None:
        """Connect.

        Raises:
            PlcError: The PLC does not accept the connection in time.
        """
        try:
            async with asyncio.timeout(self._timeout_s):
                self._reader, self._writer = await asyncio.open_connection(self._host, self._port)
        except TimeoutError:
            raise PlcError(f"not reachable within {1e3 * self._timeout_s:.0f} ms") from None
        except OSError as error:
            raise PlcError(error.strerror or str(error)) from error

    async def request(self, pdu: bytes) -> bytes:
        """Send a request and return the answer.

        Raises:
            PlcError: The connection is closed, or the answer is late or not that of the request.
        """
        if self._writer is None:
            raise PlcError("not connected")
        self._transaction = (self._transaction + 1) % 65_536
        self._writer.write(HEADER.pack(self._transaction, 0, len(pdu) + 1, self._unit) + pdu)
        try:
            async with asyncio.timeout(self._timeout_s):
                transaction, protocol, length, unit = HEADER.unpack(await self._reader.readexactly(HEADER.size))
                if (transaction, protocol, unit) != (self._transaction, 0, self._unit):
                    raise PlcError(f"answer has transaction {transaction}, protocol {protocol}, unit {unit}")
                if not MIN_LENGTH <= length <= MAX_LENGTH:
                    raise PlcError(f"answer has the length {length}")
                return await self._reader.readexactly(length - 1)
        except TimeoutError:
            raise PlcError(f"no answer within {1e3 * self._timeout_s:.0f} ms") from None
        except asyncio.IncompleteReadError:
            raise PlcError("connection closed by the PLC") from None
        except OSError as error:
            raise PlcError(error.strerror or str(error)) from error

    def close(self) -> None:
        """Disconnect at once; no effect if closed."""
        if self._writer is not None:
            self._writer.transport.abort()
            self._writer = None


class RtuTransport:
    """Modbus RTU line to one server.

    Attributes:
        address: Device file of the line.
    """

    def __init__(self, line: SerialLine, *, timeout_s: float) -> None:
        """Create a closed line.

        Args:
            line: Settings of the line, and unit address of the PLC.
            timeout_s: Longest time for an answer, s, in addition to the transmission of request and answer.
        """
        self.address = line.path
        self._line, self._timeout_s = line, timeout_s
        self._port: Any = None
        self._buffer = bytearray()
        self._answer: asyncio.Future[bytes] | None = None
        self._quiet_from_s = 0.0

    async def open(self) -> None:
        """Open the line.

        Raises:
            PlcError: The line cannot be opened.
            ModuleNotFoundError: pyserial is not installed.
        """
        try:
            self._port = self._line.open()
        except (OSError, ValueError, OverflowError) as error:
            raise PlcError(f"serial line cannot be opened: {error}") from error
        asyncio.get_running_loop().add_reader(self._port.fileno(), self._read)

    async def request(self, pdu: bytes) -> bytes:
        """Send a request and return the answer.

        Raises:
            PlcError: The line is closed, or the answer is late or not that of the request.
        """
        if self._port is None:
            raise PlcError("not connected")
        loop = asyncio.get_running_loop()
        # The silence between two frames; after a late answer, the time in which it may still arrive.
        await asyncio.sleep(max(0.0, self._quiet_from_s - loop.time()))
        self._buffer.clear()
        self._answer = loop.create_future()
        frame = framed(self._line.unit, pdu)
        wire_s = self._line.wire_s(len(frame) + LONGEST_FRAME)
        try:
            self._port.reset_input_buffer()
            self._port.write(frame)
            async with asyncio.timeout(self._timeout_s + wire_s):
                answer = await self._answer
        except TimeoutError:
            self._quiet_from_s = loop.time() + self._timeout_s
            raise PlcError(f"no valid answer within {1e3 * (self._timeout_s + wire_s):.0f} ms") from None
        except OSError as error:
            raise PlcError(f"serial line: {error}") from error
        finally:
            self._answer = None
        self._quiet_from_s = loop.time() + self._line.silence_s
        return answer

    def close(self) -> None:
        """Close the line; no effect if closed."""
        if self._port is not None:
            asyncio.get_running_loop().remove_reader(self._port.fileno())
            self._port.close()
            self._port = None

    def _read(self) -> None:
        """Collect an answer; a frame with another unit or an invalid checksum is not one."""
        try:
            self._buffer += self._port.read(LONGEST_FRAME)
        except OSError as error:
            if self._answer is not None and not self._answer.done():
                self._answer.set_exception(PlcError(f"serial line: {error}"))
            asyncio.get_running_loop().remove_reader(self._port.fileno())
            return
        length = answer_length(self._buffer)
        if length is None or len(self._buffer) < length or self._answer is None or self._answer.done():
            return
        frame = bytes(self._buffer[:length])
        if frame[0] == self._line.unit and is_checksum_valid(frame):
            self._answer.set_result(frame[1:-2])


def answer_length(received: bytes | bytearray) -> int | None:
    """Return the length of the answer at the start of the data, with address and checksum; None if not known yet."""
    if len(received) < 3:
        return None
    if received[1] & EXCEPTION:
        return 5
    return 5 + received[2] if received[1] in _COUNTED else 8
