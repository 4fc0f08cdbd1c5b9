"""The plant as Modbus sees it: which addresses exist, and what reading and writing them does.

Functions offered: 1 read coils, 2 read discrete inputs, 4 read input registers, 5 write single
coil, 15 write multiple coils.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from pymodbus.constants import ExcCodes

from controller.io_map import IoMap, IoMapError
from controller.modbus.requests import Device, RefusedError
from plant_sim.links.box import BOX_COILS, BoxCoil
from plant_sim.links.io_module import IoModule, ModuleFault
from plant_sim.links.telemetry import encode_telemetry

T = TypeVar("T")


class ModbusImage(Device):
    """An I/O module, its plant's operator box and telemetry, to any client.

    An address that is not declared is refused (exception 02), it never reads 0; a write that
    touches one changes nothing.
    """

    def __init__(self, module: IoModule, written: Callable[[], None] = lambda: None) -> None:
        """Lay the module's terminals and the operator box out in the Modbus tables.

        Args:
            module: What is served.
            written: Called after a write to the coils; may raise `RefusedError`.

        Raises:
            IoMapError: the I/O map puts an output where the operator box is.
        """
        self._module = module
        self._written = written
        self._inputs_by_offset = {point.offset: point.number for point in module.io_map.inputs}
        self._coils_by_offset = _coil_table(module.io_map)

    def read_inputs(self, first: int, count: int) -> list[bool]:
        """Return X levels."""
        x = self._module.inputs()
        return [x[number] for number in _look_up(self._inputs_by_offset, first, count)]

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return Y levels and pressed buttons."""
        y, box = self._module.outputs, self._module.plant.box
        coils = _look_up(self._coils_by_offset, first, count)
        return [y[coil] if isinstance(coil, int) else coil.pressed(box) for coil in coils]

    def read_input_registers(self, first: int, count: int) -> list[int]:
        """Return telemetry."""
        registers = encode_telemetry(self._module)
        if first + count > len(registers):
            raise RefusedError(ExcCodes.ILLEGAL_ADDRESS)
        return registers[first : first + count]

    def write_coils(self, first: int, levels: Sequence[bool]) -> None:
        """Write outputs and press buttons."""
        pairs = list(zip(_look_up(self._coils_by_offset, first, len(levels)), levels, strict=True))
        try:
            self._module.write({coil: level for coil, level in pairs if isinstance(coil, int)})
        except ModuleFault as error:
            raise RefusedError(ExcCodes.DEVICE_FAILURE) from error
        for coil, level in pairs:
            if isinstance(coil, BoxCoil):
                coil.press(self._module.plant.box, level)
        self._written()


def _coil_table(io_map: IoMap) -> dict[int, int | BoxCoil]:
    """What lies behind each coil: an output, by Y number, or a button."""
    table: dict[int, int | BoxCoil] = {coil.offset: coil for coil in BOX_COILS}
    for point in io_map.outputs:
        if point.offset in table:
            raise IoMapError(
                f"{io_map.path}:{point.line}: {point.tag}: coil offset {point.offset} is the "
                "plant's operator box; choose another offset"
            )
        table[point.offset] = point.number
    return table


def _look_up(table: Mapping[int, T], first: int, count: int) -> list[T]:
    try:
        return [table[offset] for offset in range(first, first + count)]
    except KeyError:
        raise RefusedError(ExcCodes.ILLEGAL_ADDRESS) from None
