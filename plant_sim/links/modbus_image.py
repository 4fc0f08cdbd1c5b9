"""Modbus address space of the plant, and the effect of reads and writes.

Supported functions: 1 read coils, 2 read discrete inputs, 4 read input registers, 5 write single
coil, 15 write multiple coils; with output registers in the I/O map also 3 read holding registers, 6 and 16 write
holding registers, 23 write and read holding registers.

Writes to the outputs and the output registers are subject to the lease of the module; the buttons of the operator box
are not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TypeVar

from pymodbus.constants import ExcCodes

from controller.common.modbus.io_map import IoMap
from controller.common.modbus.output_owner import REPORT_OFFSET
from controller.common.modbus.requests import ModbusDevice, RequestRefusedError
from controller.iomap.loader import IoMapError
from plant_sim.links.box import BOX_COILS, BoxCoil
from plant_sim.links.io_module import IoModule, ModuleFault
from plant_sim.links.output_lease import LeaseError
from plant_sim.links.telemetry import encode_telemetry

T = TypeVar("T")


class ModbusImage(ModbusDevice):
    """I/O module, operator box and telemetry of a plant, as the Modbus device of one client.

    Access to an undeclared address is refused with exception 02, and a write to outputs that belong to another client
    with exception 06. A write that includes such an address or output has no effect.
    """

    def __init__(
        self,
        module: IoModule,
        client: str,
        written: Callable[[], None] = lambda: None,
        requested: Callable[[], None] = lambda: None,
    ) -> None:
        """Map the terminals of the module and the operator box to Modbus addresses.

        Args:
            module: Module to serve.
            client: Address of the client.
            written: Function called after a write to the coils; may raise `RequestRefusedError`.
            requested: Function called before a request is executed.

        Raises:
            IoMapError: An output in the I/O map has the address of a button of the operator box.
        """
        self._module = module
        self._client = client
        self._written = written
        self._requested = requested
        self._inputs_by_offset = {point.offset: point.number for point in module.io_map.inputs}
        self._coils_by_offset = _coil_table(module.io_map)

    def on_request(self) -> None:
        """Bring plant time up to date."""
        self._requested()

    def read_inputs(self, first: int, count: int) -> list[bool]:
        """Return input levels."""
        x = self._module.inputs()
        return [x[number] for number in _look_up(self._inputs_by_offset, first, count)]

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return output levels and button states."""
        y, box = self._module.outputs, self._module.plant.box
        coils = _look_up(self._coils_by_offset, first, count)
        return [y[coil] if isinstance(coil, int) else coil.pressed(box) for coil in coils]

    def read_input_registers(self, first: int, count: int) -> list[int]:
        """Return telemetry registers, or registers of the report on the owner of the outputs."""
        if first >= REPORT_OFFSET:
            first -= REPORT_OFFSET
            registers = self._module.owner_report.encode()
        else:
            registers = encode_telemetry(self._module)
        if first + count > len(registers):
            raise RequestRefusedError(ExcCodes.ILLEGAL_ADDRESS)
        return registers[first : first + count]

    async def write_coils(self, first: int, levels: Sequence[bool]) -> None:
        """Write outputs and operate buttons."""
        pairs = list(zip(_look_up(self._coils_by_offset, first, len(levels)), levels, strict=True))
        outputs = {coil: level for coil, level in pairs if isinstance(coil, int)}
        if outputs:
            with self._refusals():
                self._module.write_as(self._client, outputs)
        for coil, level in pairs:
            if isinstance(coil, BoxCoil):
                coil.press(self._module.plant.box, level)
        self._written()

    def on_disconnect(self) -> None:
        """End the lease of this client."""
        self._module.lease.end(self._client)

    @contextmanager
    def _refusals(self) -> Iterator[None]:
        """Answer a refusal by lease or watchdog with its exception."""
        try:
            yield
        except LeaseError as error:
            raise RequestRefusedError(ExcCodes.DEVICE_BUSY) from error
        except ModuleFault as error:
            raise RequestRefusedError(ExcCodes.DEVICE_FAILURE) from error


class RegisterImage(ModbusImage):
    """Modbus device of a plant whose I/O map has output registers."""

    def __init__(
        self,
        module: IoModule,
        client: str,
        written: Callable[[], None] = lambda: None,
        requested: Callable[[], None] = lambda: None,
    ) -> None:
        """Map the output registers as well; see `ModbusImage`."""
        super().__init__(module, client, written, requested)
        self._registers_by_offset = {register.offset: register.number for register in module.io_map.registers}

    def read_holding(self, first: int, count: int) -> list[int]:
        """Return output registers."""
        registers = self._module.registers
        return [registers[number] for number in _look_up(self._registers_by_offset, first, count)]

    async def write_registers(self, first: int, values: Sequence[int]) -> None:
        """Write output registers."""
        numbers = _look_up(self._registers_by_offset, first, len(values))
        with self._refusals():
            self._module.lease.check(self._client)
            self._module.write_registers(dict(zip(numbers, values, strict=True)))


def image_of(
    module: IoModule,
    client: str,
    written: Callable[[], None] = lambda: None,
    requested: Callable[[], None] = lambda: None,
) -> ModbusImage:
    """Return the Modbus device of a client; holding registers exist only if the I/O map has output registers."""
    return (RegisterImage if module.io_map.registers else ModbusImage)(module, client, written, requested)


def _coil_table(io_map: IoMap) -> dict[int, int | BoxCoil]:
    """Return the target of each coil: a Y number or a button."""
    table: dict[int, int | BoxCoil] = {coil.offset: coil for coil in BOX_COILS}
    for point in io_map.outputs:
        if point.offset in table:
            raise IoMapError(
                f"{io_map.path}:{point.line}: {point.tag}: coil offset {point.offset} is reserved for the "
                "operator box of the plant; choose another offset"
            )
        table[point.offset] = point.number
    return table


def _look_up(table: Mapping[int, T], first: int, count: int) -> list[T]:
    try:
        return [table[offset] for offset in range(first, first + count)]
    except KeyError:
        raise RequestRefusedError(ExcCodes.ILLEGAL_ADDRESS) from None
