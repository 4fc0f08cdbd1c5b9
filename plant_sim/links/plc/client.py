"""Cyclic exchange of the plant with a PLC of which it is a client: the inputs out, the outputs in."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final, Protocol

from plant_sim.links.io_module import IoModule, ModuleFault
from plant_sim.links.output_lease import LeaseError
from plant_sim.links.plc.port import PlcError, PlcPort
from plant_sim.links.write_timing import PlcState

RETRY_S: Final = 0.1
"""Interval between attempts to reach a lost PLC, s."""


class Advance(Protocol):
    """Function that brings plant time up to date."""

    def __call__(self, *, exchanged: bool) -> bool:
        """Advance plant time; return False if the plant has ended.

        Args:
            exchanged: True after an exchange, which is a step of plant time in lock step.
        """


class PlcClient:
    """Client that exchanges the terminals of the plant with a PLC until it is cancelled.

    A failed exchange is repeated at once on a new connection. After a second failure the PLC is lost: this is told, and
    the client tries to connect again and again. In the meantime the output watchdog of the module runs: it sets the
    outputs to safe levels. When the PLC is back, the module accepts its outputs as soon as the PLC has switched all of
    them off.

    Attributes:
        errors: Number of failed connections and exchanges.
    """

    def __init__(
        self,
        port: PlcPort,
        module: IoModule,
        *,
        input_bits: int,
        ok_bit: int | None,
        period_s: float,
        tell: Callable[[str], None],
    ) -> None:
        """Create a client that is not connected.

        Args:
            port: PLC.
            module: Module of the plant.
            input_bits: Length of the input block.
            ok_bit: Bit of the input block that is on while the outputs take effect; None = no such bit.
            period_s: Time between the starts of two exchanges, s; 0 = as fast as possible.
            tell: Function that reports a line.
        """
        self.errors = 0
        self._port, self._module = port, module
        self._input_bits, self._ok_bit = input_bits, ok_bit
        self._period_s, self._tell = period_s, tell
        self._client = f"PLC {port.address}"
        self._wired = [point.number for point in module.io_map.outputs]
        self._failures = 0
        self._is_refused = False

    async def run(self, advance: Advance) -> None:
        """Exchange until the plant has ended or the task is cancelled."""
        self._module.timing.plc_state = PlcState.LOST
        try:
            while advance(exchanged=False):
                try:
                    await self._port.open()
                    await self._exchange_cyclically(advance)
                except PlcError as error:
                    self._note_failure(error)
                finally:
                    self._port.close()
                await asyncio.sleep(RETRY_S if self._failures > 1 else 0)
        finally:
            self._module.timing.plc_state = PlcState.LOST

    async def _exchange_cyclically(self, advance: Advance) -> None:
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while advance(exchanged=False):
            outputs = await self._port.exchange(self._input_block())
            self._note_success()
            advance(exchanged=False)
            self._write(outputs)
            advance(exchanged=True)
            due_s = max(due_s + self._period_s, loop.time())
            await asyncio.sleep(due_s - loop.time())

    def _input_block(self) -> list[bool]:
        block = self._module.inputs()
        block += [False] * (self._input_bits - len(block))
        if self._ok_bit is not None:
            block[self._ok_bit] = not self._module.tripped
        return block

    def _write(self, outputs: list[bool]) -> None:
        """Write the outputs of the PLC to the module; a refusal is told once."""
        try:
            self._module.write_as(self._client, {number: outputs[number] for number in self._wired})
        except (ModuleFault, LeaseError) as error:
            if not self._is_refused:
                self._tell(f"{self._client}: outputs refused: {error}")
            self._is_refused = True
        else:
            if self._is_refused:
                self._tell(f"{self._client}: outputs accepted again at {self._module.plant.time_ms} ms")
            self._is_refused = False

    def _note_failure(self, error: PlcError) -> None:
        self.errors += 1
        self._failures += 1
        timing = self._module.timing
        if self._failures == 2:
            timing.plc_losses += timing.plc_state is PlcState.CONNECTED
            timing.plc_state = PlcState.LOST
            self._tell(f"{self._client} does not answer at {self._module.plant.time_ms} ms: {error}; trying again")

    def _note_success(self) -> None:
        timing = self._module.timing
        if timing.plc_state is not PlcState.CONNECTED:
            timing.plc_state = PlcState.CONNECTED
            self._tell(f"{self._client} answers at {self._module.plant.time_ms} ms")
        self._failures = 0
