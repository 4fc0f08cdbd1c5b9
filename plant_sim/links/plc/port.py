"""Port of a PLC, whatever its protocol."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class PlcError(Exception):
    """Failed connection or exchange; the message is a part of a line, without the address."""


class PlcPort(Protocol):
    """PLC whose outputs can be read and whose memory can be written.

    Attributes:
        address: Address for messages.
    """

    address: str

    async def open(self) -> None:
        """Connect. Raises: PlcError."""

    async def exchange(self, inputs: Sequence[bool]) -> list[bool]:
        """Write the input block, then read the outputs from Y0. Raises: PlcError."""

    def close(self) -> None:
        """Disconnect; no effect if closed."""
