"""Simulated operator of a running plant: push buttons and telemetry over Modbus TCP."""

from __future__ import annotations

import threading
import time
from dataclasses import fields
from types import TracebackType
from typing import Self

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.links.box import BOX_COILS
from plant_sim.links.telemetry import TELEMETRY_REGISTERS, read_telemetry

PRESS_MS = 200
POLL_S = 0.005
STANDSTILL_LIMIT_S = 60.0
SEEDLING_PLACES = tuple(field.name for field in fields(SeedlingCounts))


class Operator:
    """Client of the plant's Modbus server.

    Every method raises `OSError` if the plant does not answer.
    """

    def __init__(self, host: str, port: int) -> None:
        self._address = f"{host}:{port}"
        self._client = ModbusTcpClient(host, port=port, timeout=2.0, retries=0)

    def __enter__(self) -> Self:
        if not self._client.connect():  # type: ignore[no-untyped-call]
            raise ConnectionError(f"plant at {self._address} does not respond")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._client.close()  # type: ignore[no-untyped-call]

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
        try:
            reply = self._client.write_coil(offset, pressed)
        except ModbusException as error:
            raise ConnectionError(f"plant at {self._address}: {error}") from error
        if reply.isError():
            raise ConnectionError(f"plant at {self._address} refused the button {button}")

    def telemetry(self) -> dict[str, float]:
        """Read the plant's telemetry."""
        try:
            reply = self._client.read_input_registers(0, count=TELEMETRY_REGISTERS)
        except ModbusException as error:
            raise ConnectionError(f"plant at {self._address}: {error}") from error
        if reply.isError():
            raise ConnectionError(f"plant at {self._address} refused telemetry")
        return read_telemetry(reply.registers)

    def _wait(self, for_ms: int) -> None:
        until_ms = self.telemetry()["time_ms"] + for_ms
        deadline_s = time.perf_counter() + STANDSTILL_LIMIT_S
        while self.telemetry()["time_ms"] < until_ms:
            if time.perf_counter() > deadline_s:
                raise TimeoutError(f"plant at {self._address}: plant time does not advance")
            threading.Event().wait(POLL_S)


def counts_of(telemetry: dict[str, float]) -> SeedlingCounts:
    """Return the seedling counts of a telemetry reading."""
    return SeedlingCounts(**{name: int(telemetry[name]) for name in SEEDLING_PLACES})
