"""Simulated operator of a running plant: push buttons and telemetry over Modbus TCP."""

from __future__ import annotations

import threading
import time
from dataclasses import fields
from types import TracebackType
from typing import Self

from controller.common.modbus.client_requests import ModbusRequest, read, unpacked, write_coil
from controller.common.modbus.io_map import ModbusTable
from controller.io.field.line import Exchange, exchange_all
from controller.io.field.tcp_line import TcpBus
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.links.box import BOX_COILS
from plant_sim.links.telemetry import TELEMETRY_REGISTERS, read_telemetry

PRESS_MS = 200
POLL_S = 0.005
STANDSTILL_LIMIT_S = 60.0
TIMEOUT_S = 2.0
UNIT = 1
SEEDLING_PLACES = tuple(field.name for field in fields(SeedlingCounts))


class Operator:
    """Client of the plant's Modbus server.

    Every method raises `OSError` if the plant does not answer.
    """

    def __init__(self, host: str, port: int) -> None:
        self._line = TcpBus(host, port)

    def __enter__(self) -> Self:
        try:
            self._line.begin()
            self._line.finish(time.perf_counter() + TIMEOUT_S)
        except OSError as error:
            raise ConnectionError(f"plant at {self._line.address} does not respond") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._line.close()

    def press(self, button: str, for_ms: int = PRESS_MS) -> None:
        """Press and release a button, then wait for the same time, so that two presses remain distinct.

        The times are in plant time, regardless of the pace.

        Raises:
            TimeoutError: Plant time does not advance.
        """
        for pressed in (True, False):
            self.hold(button, pressed=pressed)
            self._wait(for_ms)

    def hold(self, button: str, *, pressed: bool) -> None:
        """Press or release a button."""
        offset = next(coil.offset for coil in BOX_COILS if coil.button == button)
        self._data(write_coil(offset, pressed))

    def telemetry(self) -> dict[str, float]:
        """Read the plant's telemetry."""
        request = read(ModbusTable.INPUT_REGISTER, 0, TELEMETRY_REGISTERS, "registers of telemetry")
        return read_telemetry(unpacked(self._data(request)))

    def _data(self, request: ModbusRequest) -> bytes:
        """Return the data of the answer to a request."""
        exchange = Exchange(self._line, UNIT, TIMEOUT_S, request)
        exchange_all([exchange])
        if exchange.data is None:
            raise ConnectionError(f"plant at {self._line.address}: {request.operation}: {exchange.error}")
        return exchange.data

    def _wait(self, for_ms: int) -> None:
        until_ms = self.telemetry()["time_ms"] + for_ms
        deadline_s = time.perf_counter() + STANDSTILL_LIMIT_S
        while self.telemetry()["time_ms"] < until_ms:
            if time.perf_counter() > deadline_s:
                raise TimeoutError(f"plant at {self._line.address}: plant time does not advance")
            threading.Event().wait(POLL_S)


def counts_of(telemetry: dict[str, float]) -> SeedlingCounts:
    """Return the seedling counts of a telemetry reading."""
    return SeedlingCounts(**{name: int(telemetry[name]) for name in SEEDLING_PLACES})
