"""Modbus TCP connection of the panel: one request at a time, each with a timeout.

The asynchronous pymodbus client runs without retries (`retries=0`) and without automatic reconnection. Every error
closes the connection, so a late response is never taken for the response to a later request; the next request
reconnects.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # every failure is raised as ModbusConnectionError

ILLEGAL_ADDRESS, ILLEGAL_VALUE = 2, 3
"""Modbus exception codes of refused writes."""

Request = Callable[[AsyncModbusTcpClient], Awaitable[ModbusPDU]]


class ModbusConnectionError(OSError):
    """Raised if the server does not respond; the connection is closed."""


class ExceptionResponseError(Exception):
    """Raised for a Modbus exception response: the server refused the request.

    Attributes:
        code: Modbus exception code.
    """

    def __init__(self, code: int) -> None:
        """Initialise the error with the exception code."""
        super().__init__(f"refused with Modbus exception {code:02d}")
        self.code = code


class ModbusConnection:
    """Connection to a Modbus server, opened by the first request; for use in one event loop."""

    def __init__(self, host: str, port: int, *, timeout_s: float = 0.25) -> None:
        """Initialise the connection without opening it.

        Args:
            host: Host name or address of the server.
            port: TCP port.
            timeout_s: Timeout of the connection and of each response, s.
        """
        self._address = (host, port)
        self._timeout_s = timeout_s
        self._client: AsyncModbusTcpClient | None = None
        self._lock = asyncio.Lock()

    @property
    def connected(self) -> bool:
        """True if the connection is open."""
        return self._client is not None and self._client.connected

    async def read_bits(self, address: int, count: int, *, discrete: bool = False) -> list[bool]:
        """Read coils or discrete inputs.

        Raises:
            ModbusConnectionError: The server did not respond.
            ExceptionResponseError: The server refused the request.
        """

        def request(client: AsyncModbusTcpClient) -> Awaitable[ModbusPDU]:
            read = client.read_discrete_inputs if discrete else client.read_coils
            return read(address, count=count)

        bits = (await self._request(request)).bits
        if len(bits) < count:
            raise self._connection_error(f"response has {len(bits)} bits instead of {count}")
        return list(bits[:count])

    async def read_words(self, address: int, count: int, *, input_: bool = False) -> list[int]:
        """Read holding registers or input registers.

        Raises:
            ModbusConnectionError: The server did not respond.
            ExceptionResponseError: The server refused the request.
        """

        def request(client: AsyncModbusTcpClient) -> Awaitable[ModbusPDU]:
            read = client.read_input_registers if input_ else client.read_holding_registers
            return read(address, count=count)

        words = (await self._request(request)).registers
        if len(words) != count:
            raise self._connection_error(f"response has {len(words)} registers instead of {count}")
        return list(words)

    async def write_bit(self, address: int, value: bool) -> None:
        """Write one coil.

        Raises:
            ModbusConnectionError: The server did not respond; the coil may have been written.
            ExceptionResponseError: The server refused the request.
        """
        await self._request(lambda client: client.write_coil(address, value))

    async def write_word(self, address: int, value: int) -> None:
        """Write one register.

        Raises:
            ModbusConnectionError: The server did not respond; the register may have been written.
            ExceptionResponseError: The server refused the request.
        """
        await self._request(lambda client: client.write_register(address, value))

    async def write_words(self, address: int, values: Sequence[int]) -> None:
        """Write consecutive registers in one request.

        Raises:
            ModbusConnectionError: The server did not respond; the registers may have been written.
            ExceptionResponseError: The server refused the request.
        """
        await self._request(lambda client: client.write_registers(address, list(values)))

    def close(self) -> None:
        """Close the connection; no effect on a closed connection."""
        if self._client is not None:
            self._client.close()
            self._client = None

    async def _request(self, request: Request) -> ModbusPDU:
        async with self._lock:
            client = await self._open()
            try:
                async with asyncio.timeout(2 * self._timeout_s):
                    reply = await request(client)
            except asyncio.CancelledError:
                self.close()
                raise
            except (ModbusException, OSError, TimeoutError) as error:
                raise self._connection_error("no response") from error
        if reply.isError():
            raise ExceptionResponseError(reply.exception_code)
        return reply

    async def _open(self) -> AsyncModbusTcpClient:
        if self._client is not None and self._client.connected:
            return self._client
        self.close()
        host, port = self._address
        self._client = AsyncModbusTcpClient(host, port=port, timeout=self._timeout_s, retries=0, reconnect_delay=0)
        try:
            connected = await self._client.connect()
        except asyncio.CancelledError:
            self.close()
            raise
        if not connected:
            raise self._connection_error("not reachable")
        return self._client

    def _connection_error(self, why: str) -> ModbusConnectionError:
        self.close()
        host, port = self._address
        return ModbusConnectionError(f"{host}:{port}: {why}")
