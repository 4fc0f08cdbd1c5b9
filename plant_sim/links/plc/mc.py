"""Client of a PLC that is an MC protocol server: one exchange writes the inputs and reads the outputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from controller.common.mitsubishi.client import AsyncMcClient, ClientFrame
from controller.common.mitsubishi.devices import KINDS, Device
from controller.common.mitsubishi.mc1e import Frame1E
from controller.common.mitsubishi.mc3e import Frame3E
from controller.common.modbus.bits import levels_of, packed_words
from plant_sim.links.plc.port import PlcError
from plant_sim.links.plc.profile import PlcProfile, PlcProtocol

_FRAMES: Final[dict[PlcProtocol, ClientFrame]] = {PlcProtocol.MC_1E: Frame1E(), PlcProtocol.MC_3E: Frame3E()}


class McPlc:
    """PLC that is an MC protocol server.

    Attributes:
        address: Host and port.
    """

    def __init__(self, profile: PlcProfile, host: str, port: int, *, output_count: int, timeout_s: float) -> None:
        """Create a client that is not connected.

        Args:
            profile: Place of inputs and outputs.
            host: Name or address of the PLC.
            port: TCP port.
            output_count: Number of outputs, from Y0.
            timeout_s: Longest time for the connection and for an answer, s.
        """
        self.address = f"{host}:{port}"
        self._outputs, self._inputs = (Device.parsed(block.device) for block in (profile.outputs, profile.inputs))
        self._output_count, self._timeout_s = output_count, timeout_s
        self._client = AsyncMcClient(host, port, _FRAMES[profile.protocol], timeout_s=timeout_s)

    async def open(self) -> None:
        """Connect.

        Raises:
            PlcError: The PLC is not reachable.
        """
        try:
            await self._client.open()
        except OSError as error:
            raise self._failed(error) from error

    def close(self) -> None:
        """Disconnect; no effect if closed."""
        self._client.close()

    async def exchange(self, inputs: Sequence[bool]) -> list[bool]:
        """Write the input block, then read the outputs.

        Args:
            inputs: Levels of the input block.

        Returns:
            Levels of the outputs from Y0.

        Raises:
            PlcError: A reply is missing, wrong or a refusal.
        """
        client, count = self._client, self._output_count
        try:
            if KINDS[self._inputs.kind].is_bit:
                await client.write_bits(self._inputs, inputs)
            else:
                await client.write_words(self._inputs, packed_words(inputs))
            if KINDS[self._outputs.kind].is_bit:
                levels = list(await client.read_bits(self._outputs, count))
            else:
                levels = levels_of(await client.read_words(self._outputs, -(-count // 16)), count)
        except OSError as error:
            raise self._failed(error) from error
        if len(levels) != count:
            raise PlcError(f"reply has {len(levels)} outputs instead of {count}")
        return levels

    def _failed(self, error: OSError) -> PlcError:
        if isinstance(error, TimeoutError):
            return PlcError(f"no reply within {1e3 * self._timeout_s:.0f} ms")
        return PlcError(error.strerror or str(error))
