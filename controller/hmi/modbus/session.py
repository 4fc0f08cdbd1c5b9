"""Modbus session of one client: translation of Modbus addresses into devices, and of refusals into exceptions.

A refused device is answered with exception 02, an invalid value with 03, and a request before the first scan, or a
write that no scan takes, with 06.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Final

from pymodbus.constants import ExcCodes

from controller.common.mitsubishi.devices import FIRST_32_BIT_COUNTER, Device
from controller.common.modbus.requests import ModbusDevice, RequestRefusedError
from controller.hmi.modbus.fx3u_map import HELD_SCAN, Span, Table, bit_spans, register_spans
from controller.hmi.serving.devices import AccessRefusal, AccessRefusedError, DeviceAccess
from controller.hmi.serving.snapshot import HELD_WORDS

_EXCEPTIONS: Final = {
    AccessRefusal.NOT_READY: ExcCodes.DEVICE_BUSY,
    AccessRefusal.NO_DEVICE: ExcCodes.ILLEGAL_ADDRESS,
    AccessRefusal.NOT_WRITABLE: ExcCodes.ILLEGAL_ADDRESS,
    AccessRefusal.BAD_VALUE: ExcCodes.ILLEGAL_VALUE,
    AccessRefusal.NOT_SUPPORTED: ExcCodes.ILLEGAL_FUNCTION,
}
_SPANS: Final[Mapping[Table, tuple[Span, ...]]] = {
    "coil": bit_spans("coil"),
    "discrete": bit_spans("discrete"),
    "holding": register_spans(),
}
_NOWHERE: Final = Device("X", -1)
"""Device of an address at which there is none; it cannot be read or written."""


class HmiSession(ModbusDevice):
    """Modbus device presented to one client."""

    def __init__(self, access: DeviceAccess, identity: Mapping[int, str]) -> None:
        """Initialise the session of a client.

        Args:
            access: Devices of the PLC as this client may read and write them.
            identity: Vendor, product and revision.
        """
        self._access = access
        self._identity = identity

    @property
    def has_name(self) -> bool:
        """True if the client has told the name of its operator."""
        return self._access.has_name

    def on_request(self) -> None:
        """Notice that the client is alive."""
        self._access.on_request()

    def on_disconnect(self) -> None:
        """Release what the client holds."""
        self._access.on_disconnect()

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return coils of the last scan, or of the one that is held."""
        return self._read_bits("coil", first, count)

    def read_inputs(self, first: int, count: int) -> list[bool]:
        """Return discrete inputs of the last scan, or of the one that is held, including X."""
        return self._read_bits("discrete", first, count)

    def read_holding(self, first: int, count: int) -> list[int]:
        """Return holding registers of the last scan, or of the one that is held."""
        with _translated():
            if first >= HELD_SCAN and first + count <= HELD_SCAN + HELD_WORDS:
                return self._access.snapshot.words()[first - HELD_SCAN :][:count]
            span = _span("holding", first, count)
            if span is None:
                raise AccessRefusedError(AccessRefusal.NO_DEVICE)
            device, is_high = _register(span, first)
            return self._access.read_words(_NOWHERE if is_high else device, count)

    def read_input_registers(self, first: int, count: int) -> list[int]:
        """Return input registers, which are identical to the holding registers."""
        return self.read_holding(first, count)

    async def write_coils(self, first: int, levels: Sequence[bool]) -> None:
        """Write consecutive bits."""
        with _translated():
            await self._access.write_bits([(_bit(first + index), level) for index, level in enumerate(levels)])

    async def write_registers(self, first: int, values: Sequence[int]) -> None:
        """Write consecutive words, or the request of the held scan."""
        with _translated():
            if first == HELD_SCAN and len(values) == 1:
                self._access.snapshot.request(values[0])
                return
            await self._access.write_words(_word_values(first, values))

    def identity(self) -> dict[int, str]:
        """Return the vendor, the product and the revision."""
        return dict(self._identity)

    def _read_bits(self, table: Table, first: int, count: int) -> list[bool]:
        with _translated():
            span = _span(table, first, count)
            if span is None:
                raise AccessRefusedError(AccessRefusal.NO_DEVICE)
            return self._access.read_bits(Device(span.kind, span.number + first - span.first), count)


@contextmanager
def _translated() -> Iterator[None]:
    """Raise the Modbus exception of a refusal."""
    try:
        yield
    except AccessRefusedError as error:
        raise RequestRefusedError(_EXCEPTIONS[error.refusal]) from error


def _span(table: Table, first: int, count: int) -> Span | None:
    """Return the span that contains all addresses; None if there is none."""
    return next((span for span in _SPANS[table] if span.first <= first and first + count <= span.end), None)


def _bit(address: int) -> Device:
    span = _span("coil", address, 1)
    return _NOWHERE if span is None else Device(span.kind, span.number + address - span.first)


def _register(span: Span, address: int) -> tuple[Device, int]:
    """Return the device of a register, and 1 if the register is the high word of its value, else 0."""
    number = span.number + address - span.first
    if span.kind != "CN" or number < FIRST_32_BIT_COUNTER:
        return Device(span.kind, number), 0
    counter, is_high = divmod(number - FIRST_32_BIT_COUNTER, 2)
    return Device("CN", FIRST_32_BIT_COUNTER + counter), is_high


def _word_values(first: int, values: Sequence[int]) -> list[tuple[Device, int]]:
    """Return devices and values of registers; the two registers of a 32-bit counter are one value."""
    pairs: list[tuple[Device, int]] = []
    index = 0
    while index < len(values):
        span = _span("holding", first + index, 1)
        device, is_high = (_NOWHERE, 0) if span is None else _register(span, first + index)
        value = values[index]
        index += 1
        if device.kind == "CN" and device.number >= FIRST_32_BIT_COUNTER:
            if is_high or index == len(values):
                device = _NOWHERE  # half of a value
            else:
                value |= values[index] << 16
                index += 1
        pairs.append((device, value))
    return pairs
