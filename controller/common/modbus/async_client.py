"""Asynchronous Modbus clients of a TCP connection or a serial line, for one request at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Final, Protocol

from controller.common.modbus.client import ClientFrames, RtuFrames, TcpFrames, may_equal_request
from controller.common.modbus.rtu import LONGEST_FRAME, SerialLine, framed

_READ_OF_ONE_REGISTER: Final = bytes([3, 0, 0, 0, 1])
"""Request whose answer, be it an exception, is never equal to it."""


class ModbusClientError(OSError):
    """Raised if a server is not reachable or gives no valid answer; the message is the reason."""


class ConnectionClosedError(ModbusClientError):
    """Raised if the connection is closed, for example because the server has no place for it."""


def _closed() -> ModbusClientError:
    return ModbusClientError("closed during the request")


class AsyncModbusClient(Protocol):
    """Client of one server, for one request at a time.

    Attributes:
        address: Address for messages.
    """

    address: str

    async def open(self) -> None:
        """Connect.

        Raises:
            ModbusClientError: The server is not reachable.
        """

    async def request(self, pdu: bytes) -> bytes:
        """Send a request and return its answer, both from the function code on.

        Raises:
            ModbusClientError: The client is closed, or there is no valid answer in time.
        """

    def close(self) -> None:
        """Disconnect; a request that waits in another task fails. No effect if closed."""


class _Exchange:
    """Request that waits for its answer among the received bytes of a line."""

    def __init__(self, frames: ClientFrames) -> None:
        self._frames = frames
        self._waiting: asyncio.Future[bytes] | None = None

    def take_over(self, data: bytes) -> None:
        """Take over received bytes, among them perhaps the answer that is awaited."""
        self._frames.feed(data)
        if self._waiting is not None and (answer := self._frames.answer()) is not None:
            self._waiting.set_result(answer)
            self._waiting = None

    def fail(self, error: Exception) -> None:
        """End the request with an error; no effect if none waits."""
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.set_exception(error)

    async def answer(self, send: Callable[[], object], timeout_s: float) -> bytes | None:
        """Send the request and return its answer; None if there is none in time.

        An answer that has arrived counts, even if this process looks for it late.
        """
        waiting = self._waiting = asyncio.get_running_loop().create_future()
        try:
            send()
            await asyncio.wait({waiting}, timeout=timeout_s)
            return waiting.result() if waiting.done() else None
        finally:
            self._waiting = None


class _TcpConnection(asyncio.Protocol):
    def __init__(self, exchange: _Exchange) -> None:
        self._exchange = exchange

    def data_received(self, data: bytes) -> None:
        self._exchange.take_over(data)

    def connection_lost(self, _error: Exception | None) -> None:
        self._exchange.fail(ConnectionClosedError("connection closed by the server"))


class AsyncTcpClient:
    """Client of a TCP connection; a request without an answer, or a cancelled one, closes it.

    Attributes:
        address: Host and port.
    """

    def __init__(self, host: str, port: int, *, timeout_s: float, unit: int = 1) -> None:
        """Create a closed client.

        Args:
            host: Name or address of the server.
            port: TCP port.
            timeout_s: Longest time for the connection and for an answer, s.
            unit: Unit identifier.
        """
        self.address = f"{host}:{port}"
        self._host, self._port, self._unit, self._timeout_s = host, port, unit, timeout_s
        self._frames = TcpFrames()
        self._exchange = _Exchange(self._frames)
        self._transport: asyncio.Transport | None = None

    @property
    def is_open(self) -> bool:
        """True if the connection is established, and the server has not closed it."""
        return self._transport is not None and not self._transport.is_closing()

    async def open(self) -> None:
        """Connect.

        Raises:
            ModbusClientError: The server does not accept the connection in time.
        """
        self.close()
        try:
            async with asyncio.timeout(self._timeout_s):
                self._transport, _ = await asyncio.get_running_loop().create_connection(
                    lambda: _TcpConnection(self._exchange), self._host, self._port
                )
        except TimeoutError:
            raise ModbusClientError(f"not reachable within {1e3 * self._timeout_s:.0f} ms") from None
        except OSError as error:
            raise ModbusClientError(error.strerror or str(error)) from error

    async def request(self, pdu: bytes) -> bytes:
        """Send a request and return its answer, both from the function code on.

        Raises:
            ModbusClientError: The connection is closed, or there is no answer in time.
        """
        transport = self._transport
        if transport is None or transport.is_closing():
            raise ConnectionClosedError("not connected")
        answer = None
        try:
            frame = self._frames.request(self._unit, pdu)
            answer = await self._exchange.answer(lambda: transport.write(frame), self._timeout_s)
        finally:
            if answer is None:
                self.close()
        if answer is None:
            other = f", but a frame with {self._frames.other}" if self._frames.other else ""
            raise ModbusClientError(f"no answer within {1e3 * self._timeout_s:.0f} ms{other}")
        return answer

    def close(self) -> None:
        """Disconnect at once; a request that waits fails. No effect if closed."""
        self._exchange.fail(_closed())
        if self._transport is not None:
            self._transport.abort()
        self._frames.discard()


class AsyncRtuClient:
    """Client of one unit on a serial line; after a request without an answer, the line is silent for the timeout.

    Attributes:
        address: Device file of the line.
    """

    def __init__(self, line: SerialLine, *, timeout_s: float) -> None:
        """Create a client with a closed line.

        Args:
            line: Settings of the line, and unit address of the server.
            timeout_s: Longest time for an answer, s, in addition to the transmission of request and answer.
        """
        self.address = line.path
        self._line, self._timeout_s = line, timeout_s
        self._frames = RtuFrames(line.path)
        self._exchange = _Exchange(self._frames)
        self._port: Any = None
        self._quiet_until_s = 0.0

    async def open(self) -> None:
        """Open the line.

        Raises:
            ModbusClientError: The line cannot be opened.
            ModuleNotFoundError: pyserial is not installed.
        """
        self.close()
        try:
            self._port = self._line.open()
        except (OSError, ValueError, OverflowError) as error:
            raise ModbusClientError(f"serial line cannot be opened: {error}") from error
        self._frames.forget_adapter()
        asyncio.get_running_loop().add_reader(self._port.fileno(), self._read)

    async def request(self, pdu: bytes) -> bytes:
        """Send a request and return its answer, both from the function code on.

        A read precedes it if its answer could be mistaken for the request that an unknown adapter returns.

        Raises:
            ModbusClientError: The line is closed, or there is no valid answer in time.
        """
        if self._frames.returns_requests is None and may_equal_request(framed(self._line.unit, pdu)):
            await self._exchanged(_READ_OF_ONE_REGISTER)
        return await self._exchanged(pdu)

    async def _exchanged(self, pdu: bytes) -> bytes:
        if self._port is None:
            raise ModbusClientError("not connected")
        loop = asyncio.get_running_loop()
        await asyncio.sleep(max(0.0, self._quiet_until_s - loop.time()))
        frame = self._frames.request(self._line.unit, pdu)
        limit_s = self._timeout_s + self._line.wire_s(len(frame) + LONGEST_FRAME)
        self._quiet_until_s = loop.time() + limit_s + self._timeout_s
        try:
            answer = await self._exchange.answer(lambda: self._send(frame), limit_s)
        except ModbusClientError:
            raise
        except OSError as error:
            raise ModbusClientError(f"serial line: {error}") from error
        if answer is None:
            raise ModbusClientError(f"no valid answer within {1e3 * limit_s:.0f} ms")
        self._quiet_until_s = loop.time() + self._line.silence_s
        return answer

    def close(self) -> None:
        """Close the line; a request that waits fails. No effect if closed."""
        self._exchange.fail(_closed())
        if self._port is not None:
            asyncio.get_running_loop().remove_reader(self._port.fileno())
            self._port.close()
            self._port = None

    def _send(self, frame: bytes) -> None:
        self._port.reset_input_buffer()
        self._port.write(frame)

    def _read(self) -> None:
        try:
            self._exchange.take_over(self._port.read(LONGEST_FRAME))
        except OSError as error:
            self._exchange.fail(error)
            asyncio.get_running_loop().remove_reader(self._port.fileno())
