"""Clients of the MC protocol over TCP, blocking and asynchronous; one request at a time.

Examples:
    A plant that writes X as M or D bits of a PLC and reads its Y::

        with McClient("192.168.3.250", 5007, Frame3E()) as plc:
            plc.write_bits(Device("M", 100), levels)
            outputs = plc.read_bits(Device("Y", 0), 16)
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Sequence
from types import TracebackType
from typing import Final, Protocol, Self, cast

from controller.common.mitsubishi.devices import Device
from controller.common.mitsubishi.requests import (
    FrameError,
    ReadBits,
    ReadTypeName,
    ReadWords,
    RefusedError,
    Reply,
    Request,
    TypeName,
    WriteBits,
    WriteWords,
)

_RECEIVE_BYTES: Final = 4_096


class ClientFrame(Protocol):
    """Frame of a client: `Frame1E` or `Frame3E`."""

    def encode_request(self, request: Request) -> bytes:
        """Return the frame of a request."""

    def reply_length(self, data: bytes, request: Request) -> int | None:
        """Return the length of the reply, or None if more data is needed to determine it."""

    def decode_reply(self, frame: bytes, request: Request) -> Reply:
        """Return the reply in a complete frame."""


class ReplyError(OSError):
    """Raised for data that is not the reply to the request; the connection is closed."""


class _Exchange:
    """Reply to one request that is received in pieces."""

    def __init__(self, frame: ClientFrame, request: Request) -> None:
        self._frame = frame
        self._request = request
        self._received = b""

    def missing(self, data: bytes) -> bool:
        """Accept received data and return True until the reply is complete."""
        if not data:
            raise ReplyError("the PLC has closed the connection")
        self._received += data
        try:
            length = self._frame.reply_length(self._received, self._request)
        except FrameError as error:
            raise ReplyError(str(error)) from error
        if length is not None and len(self._received) > length:
            raise ReplyError(f"{len(self._received) - length} bytes after the reply")
        return length is None or len(self._received) < length

    def reply(self) -> Reply:
        """Return the complete reply."""
        try:
            return self._frame.decode_reply(self._received, self._request)
        except FrameError as error:
            raise ReplyError(str(error)) from error


class McClient:
    """Blocking client; a context manager that is connected between `__enter__` and `__exit__`.

    All methods raise OSError: TimeoutError without a reply in time, `ReplyError` for other data, `RefusedError` for an
    end code. After any of them except `RefusedError` the connection is closed, so that no late reply answers a later
    request; `open` connects again.
    """

    def __init__(self, host: str, port: int, frame: ClientFrame, *, timeout_s: float = 1.0) -> None:
        """Create a client that is not connected.

        Args:
            host: Address of the PLC.
            port: TCP port.
            frame: Frame and code that the PLC is configured for.
            timeout_s: Time limit of connecting, and of each piece of a reply (usually there is one), s.
        """
        self._address = (host, port)
        self._frame = frame
        self._timeout_s = timeout_s
        self._socket: socket.socket | None = None

    def __enter__(self) -> Self:
        """Connect."""
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the connection."""
        self.close()

    @property
    def is_open(self) -> bool:
        """True while connected."""
        return self._socket is not None

    def open(self) -> None:
        """Connect unless connected."""
        if self._socket is None:
            self._socket = socket.create_connection(self._address, self._timeout_s)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        """Close the connection if there is one."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def request(self, request: Request) -> Reply:
        """Send a request and return its reply.

        Raises:
            OSError: There is no connection, or no valid reply.
        """
        if self._socket is None:
            raise ConnectionError("not connected to the PLC")
        exchange = _Exchange(self._frame, request)
        try:
            self._socket.sendall(self._frame.encode_request(request))
            while exchange.missing(self._socket.recv(_RECEIVE_BYTES)):
                pass
            return exchange.reply()
        except RefusedError:
            raise
        except OSError:
            self.close()
            raise

    def read_bits(self, first: Device, count: int) -> tuple[bool, ...]:
        """Return consecutive bits."""
        return cast(tuple[bool, ...], self.request(ReadBits(first, count)))

    def read_words(self, first: Device, count: int) -> tuple[int, ...]:
        """Return consecutive words, unsigned."""
        return cast(tuple[int, ...], self.request(ReadWords(first, count)))

    def write_bits(self, first: Device, levels: Sequence[bool]) -> None:
        """Write consecutive bits."""
        self.request(WriteBits(first, tuple(levels)))

    def write_words(self, first: Device, values: Sequence[int]) -> None:
        """Write consecutive words, unsigned."""
        self.request(WriteWords(first, tuple(values)))

    def type_name(self) -> TypeName:
        """Return the model of the PLC."""
        return cast(TypeName, self.request(ReadTypeName()))


class AsyncMcClient:
    """Asynchronous client with the methods and errors of `McClient`."""

    def __init__(self, host: str, port: int, frame: ClientFrame, *, timeout_s: float = 1.0) -> None:
        """Create a client that is not connected; the arguments are those of `McClient`, `timeout_s` is for a whole request."""
        self._address = (host, port)
        self._frame = frame
        self._timeout_s = timeout_s
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    @property
    def is_open(self) -> bool:
        """True while connected."""
        return self._streams is not None

    async def open(self) -> None:
        """Connect unless connected."""
        if self._streams is None:
            async with asyncio.timeout(self._timeout_s):
                self._streams = await asyncio.open_connection(*self._address)

    def close(self) -> None:
        """Close the connection if there is one."""
        if self._streams is not None:
            self._streams[1].close()
            self._streams = None

    async def request(self, request: Request) -> Reply:
        """Send a request and return its reply.

        Raises:
            OSError: There is no connection, or no valid reply.
        """
        if self._streams is None:
            raise ConnectionError("not connected to the PLC")
        reader, writer = self._streams
        exchange = _Exchange(self._frame, request)
        try:
            async with asyncio.timeout(self._timeout_s):
                writer.write(self._frame.encode_request(request))
                while exchange.missing(await reader.read(_RECEIVE_BYTES)):
                    pass
            return exchange.reply()
        except RefusedError:
            raise
        except (OSError, asyncio.CancelledError):
            self.close()
            raise

    async def read_bits(self, first: Device, count: int) -> tuple[bool, ...]:
        """Return consecutive bits."""
        return cast(tuple[bool, ...], await self.request(ReadBits(first, count)))

    async def read_words(self, first: Device, count: int) -> tuple[int, ...]:
        """Return consecutive words, unsigned."""
        return cast(tuple[int, ...], await self.request(ReadWords(first, count)))

    async def write_bits(self, first: Device, levels: Sequence[bool]) -> None:
        """Write consecutive bits."""
        await self.request(WriteBits(first, tuple(levels)))

    async def write_words(self, first: Device, values: Sequence[int]) -> None:
        """Write consecutive words, unsigned."""
        await self.request(WriteWords(first, tuple(values)))
