"""One Modbus TCP connection of the panel: a request at a time, each with a bounded wait.

pymodbus' asynchronous client is given no second chances (`retries=0`) and never reconnects by itself. Whatever goes
wrong closes the connection, so that a late answer never meets a new question; the next request connects anew.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # every failure below becomes one LineError

ILLEGAL_ADDRESS, ILLEGAL_VALUE = 2, 3
"""Exceptions with which the controller refuses a write."""

Request = Callable[[AsyncModbusTcpClient], Awaitable[ModbusPDU]]


class LineError(OSError):
    """No answer came; the connection is closed."""


class RefusedError(Exception):
    """The server refused a request.

    Attributes:
        code: Modbus exception code.
    """

    def __init__(self, code: int) -> None:
        """Take the exception code."""
        super().__init__(f"refused with Modbus exception {code:02d}")
        self.code = code


class Line:
    """A connection to a Modbus server, made by the first request. Use from one event loop."""

    def __init__(self, host: str, port: int, *, timeout_s: float = 0.25) -> None:
        """Prepare the connection.

        Args:
            host: Name or address of the server.
            port: TCP port.
            timeout_s: Longest wait for the connection, and for each answer, s.
        """
        self._where = (host, port)
        self._timeout_s = timeout_s
        self._client: AsyncModbusTcpClient | None = None
        self._one_at_a_time = asyncio.Lock()

    @property
    def connected(self) -> bool:
        """Whether the connection stands."""
        return self._client is not None and self._client.connected

    async def read_bits(self, address: int, count: int, *, discrete: bool = False) -> list[bool]:
        """Read coils, or discrete inputs.

        Raises:
            LineError: No answer.
            RefusedError: The server refused.
        """

        def request(client: AsyncModbusTcpClient) -> Awaitable[ModbusPDU]:
            read = client.read_discrete_inputs if discrete else client.read_coils
            return read(address, count=count)

        bits = (await self._ask(request)).bits
        if len(bits) < count:
            raise self._broken(f"{len(bits)} bits came back, not {count}")
        return list(bits[:count])

    async def read_words(self, address: int, count: int, *, input_: bool = False) -> list[int]:
        """Read holding registers, or input registers.

        Raises:
            LineError: No answer.
            RefusedError: The server refused.
        """

        def request(client: AsyncModbusTcpClient) -> Awaitable[ModbusPDU]:
            read = client.read_input_registers if input_ else client.read_holding_registers
            return read(address, count=count)

        words = (await self._ask(request)).registers
        if len(words) != count:
            raise self._broken(f"{len(words)} registers came back, not {count}")
        return list(words)

    async def write_bit(self, address: int, value: bool) -> None:
        """Write one coil.

        Raises:
            LineError: No answer; it may have been written.
            RefusedError: The server refused.
        """
        await self._ask(lambda client: client.write_coil(address, value))

    async def write_word(self, address: int, value: int) -> None:
        """Write one register.

        Raises:
            LineError: No answer; it may have been written.
            RefusedError: The server refused.
        """
        await self._ask(lambda client: client.write_register(address, value))

    async def write_words(self, address: int, values: Sequence[int]) -> None:
        """Write neighbouring registers in one request.

        Raises:
            LineError: No answer; they may have been written.
            RefusedError: The server refused.
        """
        await self._ask(lambda client: client.write_registers(address, list(values)))

    def close(self) -> None:
        """Close the connection; does nothing when closed."""
        if self._client is not None:
            self._client.close()
            self._client = None

    async def _ask(self, request: Request) -> ModbusPDU:
        async with self._one_at_a_time:
            client = await self._open()
            try:
                async with asyncio.timeout(2 * self._timeout_s):
                    reply = await request(client)
            except asyncio.CancelledError:
                self.close()
                raise
            except (ModbusException, OSError, TimeoutError) as error:
                raise self._broken("no answer") from error
        if reply.isError():
            raise RefusedError(reply.exception_code)
        return reply

    async def _open(self) -> AsyncModbusTcpClient:
        if self._client is not None and self._client.connected:
            return self._client
        self.close()
        host, port = self._where
        self._client = AsyncModbusTcpClient(host, port=port, timeout=self._timeout_s, retries=0, reconnect_delay=0)
        try:
            connected = await self._client.connect()
        except asyncio.CancelledError:
            self.close()
            raise
        if not connected:
            raise self._broken("not reachable")
        return self._client

    def _broken(self, why: str) -> LineError:
        self.close()
        host, port = self._where
        return LineError(f"{host}:{port}: {why}")
