"""An operator at a running plant: presses buttons and reads telemetry over Modbus TCP."""

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
LOOK_S = 0.005
STANDSTILL_LIMIT_S = 60.0
SEEDLING_PLACES = tuple(field.name for field in fields(SeedlingCounts))


class Operator:
    """A client of the plant's Modbus server.

    Every method raises `OSError` when the plant does not answer.
    """

    def __init__(self, host: str, port: int) -> None:
        self._where = f"{host}:{port}"
        self._client = ModbusTcpClient(host, port=port, timeout=2.0, retries=0)

    def __enter__(self) -> Self:
        if not self._client.connect():  # type: ignore[no-untyped-call]
            raise ConnectionError(f"no plant at {self._where}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._client.close()  # type: ignore[no-untyped-call]

    def press(self, button: str, for_ms: int = PRESS_MS) -> None:
        """Press a button, let it go, and keep the finger off as long: two presses never look like one.

        Time is the plant's, whatever its pace.

        Raises:
            TimeoutError: The plant's time stood still.
        """
        for pressed in (True, False):
            self.hold(button, pressed=pressed)
            self._wait(for_ms)

    def hold(self, button: str, *, pressed: bool) -> None:
        """Press a button, or let it go."""
        offset = next(coil.offset for coil in BOX_COILS if coil.button == button)
        try:
            reply = self._client.write_coil(offset, pressed)
        except ModbusException as error:
            raise ConnectionError(f"plant at {self._where}: {error}") from error
        if reply.isError():
            raise ConnectionError(f"plant at {self._where} refused the button {button}")

    def telemetry(self) -> dict[str, float]:
        """Read the plant's telemetry."""
        try:
            reply = self._client.read_input_registers(0, count=TELEMETRY_REGISTERS)
        except ModbusException as error:
            raise ConnectionError(f"plant at {self._where}: {error}") from error
        if reply.isError():
            raise ConnectionError(f"plant at {self._where} refused telemetry")
        return read_telemetry(reply.registers)

    def _wait(self, for_ms: int) -> None:
        until_ms = self.telemetry()["time_ms"] + for_ms
        deadline_s = time.perf_counter() + STANDSTILL_LIMIT_S
        while self.telemetry()["time_ms"] < until_ms:
            if time.perf_counter() > deadline_s:
                raise TimeoutError(f"plant at {self._where}: its time stands still")
            threading.Event().wait(LOOK_S)


def counts_of(telemetry: dict[str, float]) -> SeedlingCounts:
    """Return the seedling counts a telemetry reading holds."""
    return SeedlingCounts(**{name: int(telemetry[name]) for name in SEEDLING_PLACES})
