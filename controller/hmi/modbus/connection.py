"""Modbus TCP connection of a panel: one request at a time, which opens the connection if necessary."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from controller.common.modbus.async_client import AsyncTcpClient, ModbusClientError
from controller.common.modbus.bits import levels_of
from controller.common.modbus.client_requests import (
    AnswerError,
    ExceptionReplyError,
    ModbusRequest,
    read,
    unpacked,
    write_coil,
    write_register,
    write_registers,
)
from controller.common.modbus.io_map import ModbusTable
from controller.io.scan_writes import NO_SCAN_LIMIT_S

ANSWER_LIMIT_S: Final = NO_SCAN_LIMIT_S + 0.8
"""Longest wait for an answer, s: the controller says that it has withdrawn a write, on a busy computer later."""


class ModbusConnection:
    """Connection to a Modbus server, opened by the first request; for use in one event loop."""

    def __init__(
        self, host: str, port: int, *, timeout_s: float = ANSWER_LIMIT_S, introduction: ModbusRequest | None = None
    ) -> None:
        """Initialise the connection without opening it.

        Args:
            host: Host name or address of the server.
            port: TCP port.
            timeout_s: Timeout of the connection and of each response, s.
            introduction: First request of each connection, whose refusal is ignored; None = none.
        """
        self._introduction = introduction
        self._client = AsyncTcpClient(host, port, timeout_s=timeout_s)
        self._lock = asyncio.Lock()

    @property
    def connected(self) -> bool:
        """True if the connection is open."""
        return self._client.is_open

    async def read_bits(self, address: int, count: int, *, discrete: bool = False) -> list[bool]:
        """Read coils or discrete inputs.

        Raises:
            ModbusClientError: The server did not respond.
            ExceptionReplyError: The server refused the request.
        """
        table = ModbusTable.DISCRETE_INPUT if discrete else ModbusTable.COIL
        return levels_of(await self._data(read(table, address, count, "bits")), count, width=8)

    async def read_words(self, address: int, count: int, *, input_: bool = False) -> list[int]:
        """Read holding registers or input registers.

        Raises:
            ModbusClientError: The server did not respond.
            ExceptionReplyError: The server refused the request.
        """
        table = ModbusTable.INPUT_REGISTER if input_ else ModbusTable.HOLDING_REGISTER
        return unpacked(await self._data(read(table, address, count, "registers")))

    async def write_bit(self, address: int, value: bool) -> None:
        """Write one coil.

        Raises:
            ModbusClientError: The server did not respond; the coil may have been written.
            ExceptionReplyError: The server refused the request.
        """
        await self._data(write_coil(address, value))

    async def write_word(self, address: int, value: int) -> None:
        """Write one register.

        Raises:
            ModbusClientError: The server did not respond; the register may have been written.
            ExceptionReplyError: The server refused the request.
        """
        await self._data(write_register(address, value))

    async def write_words(self, address: int, values: Sequence[int]) -> None:
        """Write consecutive registers in one request.

        Raises:
            ModbusClientError: The server did not respond; the registers may have been written.
            ExceptionReplyError: The server refused the request.
        """
        await self._data(write_registers(address, values))

    def close(self) -> None:
        """Close the connection; no effect on a closed connection."""
        self._client.close()

    async def _data(self, request: ModbusRequest) -> bytes:
        """Return the data of the answer to a request."""
        async with self._lock:
            if not self._client.is_open:
                await self._open()
            try:
                return request.data(await self._client.request(request.pdu))
            except ExceptionReplyError:
                raise
            except AnswerError as error:
                self.close()
                raise ModbusClientError(f"{self._client.address}: {error}") from error

    async def _open(self) -> None:
        await self._client.open()
        if self._introduction is not None:
            with suppress(ExceptionReplyError):  # a controller without this register
                self._introduction.data(await self._client.request(self._introduction.pdu))
