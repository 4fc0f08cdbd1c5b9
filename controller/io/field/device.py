"""One device of the field: its requests, its settings and its output watchdog.

*Output safe* means that every coil of the device is off within the time of its output watchdog (`watchdog_ms`): the
controller writes the safe image, and if its writes stop, the module itself switches the outputs off.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Generator, Sequence
from typing import Final

from controller.common.modbus.client_requests import (
    ModbusRequest,
    echo,
    read,
    unpacked,
    write_and_read,
    write_coil,
    write_register,
    write_registers,
)
from controller.common.modbus.io_map import ModbusTable
from controller.common.modbus.output_owner import REPORT_OFFSET, REPORT_WORDS, OwnerReport
from controller.io.field.blocks import PointBlock, blocks_of, register_runs
from controller.io.field.field_file import DevicePlan
from controller.io.field.line import BusLine, Exchange
from controller.io.field.schema import TripEntry, WriteEntry
from controller.io.link import LinkError

DEVICE_BUSY: Final = 6
"""Exception code with which a module that lends its outputs refuses the write of another client."""
ILLEGAL_FUNCTION: Final = 1
_BITS: Final = (ModbusTable.COIL, ModbusTable.DISCRETE_INPUT)
Steps = Generator[Exchange, None, None]
"""Exchanges one after another, each of which may depend on the ones before."""
Asking = Generator[Exchange, None, bytes]


class DeviceRefusalError(LinkError):
    """Raised for an exception response, or for an answer that shows that the device has another function there."""


class FieldDevice:
    """Device of the field on its line.

    Attributes:
        plan: Plan of the device.
        line: Its line.
        tripped: True if its output watchdog has tripped and has not been reset; its outputs are not written.
        error: Reason for which the device is closed; empty if it is open or was never opened.
        confirmed: Image written last, if the device has confirmed it since it was opened or reset; else None.
        has_inputs: True if the inputs have been read since the device was opened.
        lends: True if it lends its outputs to one client and reports the owner.
        watchdog_ms: Time of its output watchdog, ms; None = unknown.
        had_gap: True if its output watchdog may have tripped between two writes that it has confirmed.
        model: Values of the registers in which it has reported its model first; empty if it has not.
        answers: Number of its answers, refusals included.
        waited_s: Total time that scans have waited for its answers, s.
        inputs: Blocks of X points.
        outputs: Blocks of Y points.
        registers: First offset and D numbers of each run of output registers.
    """

    def __init__(self, plan: DevicePlan, line: BusLine, now_s: Callable[[], float]) -> None:
        """Create a closed device.

        Args:
            plan: Plan of the device.
            line: Its line.
            now_s: Clock of its output watchdog, s.
        """
        self._now_s = now_s
        self.plan = plan
        self.line = line
        self.tripped = self.lends = self.had_gap = False
        self.watchdog_ms = plan.watchdog_ms
        self.error = ""
        self.model: tuple[int, ...] = ()
        self.answers, self.waited_s = 0, 0.0
        self.inputs = blocks_of("X", plan.inputs, plan.traits)
        self.outputs = blocks_of("Y", plan.outputs, plan.traits)
        self.registers = register_runs(plan.registers)
        self._combines = bool(
            plan.traits.combined
            and len(self.inputs) == len(self.outputs) == 1
            and all(block.table is ModbusTable.HOLDING_REGISTER for block in (*self.inputs, *self.outputs))
        )
        self.confirmed: Sequence[bool] | None = None
        self.has_inputs = False
        self._is_ready = False
        self._received: bytes | None = None
        self._trips: int | None = 0
        """Value of the trip counter at the last reset; 0 = at power-up: a trip may be older than this process."""
        self._written_s: float | None = None
        self._begun_s: float | None = None
        """Time before the latest write."""
        self._served_s: float | None = None
        """Time before the latest confirmed write, also of an earlier connection: the module has received it later."""
        self._reported_trips: int | None = None
        """Number of trips that the module has reported last; None = not read since gaps were forgotten."""
        self._echoes = random.Random()

    @property
    def is_open(self) -> bool:
        """True if the device has answered since its line was opened, and has its settings."""
        return self._is_ready and self.line.is_open

    @property
    def label(self) -> str:
        """Name and address for messages."""
        return f"{self.plan.name} ({self.line.address})" if self.plan.name else f"at {self.line.address}"

    def open(self) -> Steps:
        """Prepare the device on its open line.

        The adapter is known; no earlier answer can follow; the model is compared; a trip is noted; the settings are
        compared and written.

        Raises:
            LinkError: The device does not answer, reports another model, or refuses a setting.
        """
        self.close()
        if not self.line.sequenced:
            yield from self._show_adapter()
            if self.plan.echo:
                yield from self._synchronise()
        yield from self._compare_model()
        yield from self.note_trip()
        if not self.tripped:
            yield from self._prepare()
        self._is_ready, self.error = True, ""

    def reset(self) -> Steps:
        """Reset the output watchdog after a trip, and compare the settings.

        Raises:
            LinkError: The device does not answer, or remains tripped.
        """
        for entry in self.plan.traits.reset or ():
            yield from self._write(entry)
        self.tripped, self._trips, self.confirmed = False, None, None
        self.forget_gap()
        yield from self.note_trip()
        if self.tripped:
            raise self.failed("reset of the output watchdog", "the device remains tripped")
        yield from self._prepare()

    def note_trip(self) -> Steps:
        """Read whether the output watchdog has tripped.

        Raises:
            LinkError: The device does not answer.
        """
        trip = self.plan.traits.trip
        if trip is None or self.tripped:
            return
        value = yield from self._value(trip)
        if not trip.counter:
            self.tripped = value & trip.mask == trip.value
        elif self._trips is None:
            self._trips = value
        else:
            self.tripped = value != self._trips

    def is_trip_possible(self) -> bool:
        """Return True if the output watchdog may have tripped since the last confirmed write."""
        limit_ms = self.plan.watchdog_ms
        if self.plan.traits.trip is None or self._written_s is None or limit_ms is None:
            return False
        return self._now_s() - self._written_s > limit_ms / 2_000

    def reads(self) -> list[Exchange]:
        """Return the exchanges that read the inputs; none if they have been received with the last write."""
        return [] if self._received is not None else [self._exchange(block.read("inputs")) for block in self.inputs]

    def store_inputs(self, exchanges: Sequence[Exchange], image: list[bool]) -> None:
        """Write the levels that have been read to an image.

        Raises:
            LinkError: An exchange has failed.
        """
        self.has_inputs = True
        if self._received is not None:
            self.inputs[0].store(self._received, image)
            self._received = None
            return
        for block, each in zip(self.inputs, exchanges, strict=True):
            block.store(self.checked(each), image)

    def writes(self, image: Sequence[bool]) -> list[Exchange]:
        """Return the exchanges that write the outputs."""
        self._begun_s = self._now_s()
        if self._combines:
            own, other = self.outputs[0], self.inputs[0]
            return [self._exchange(write_and_read(own.first, own.words(image), other.first, other.count))]
        return [self._exchange(block.write(image)) for block in self.outputs]

    def confirm(self, exchanges: Sequence[Exchange], image: Sequence[bool]) -> None:
        """Note that an image has been written, and whether the output watchdog may have tripped before.

        The module receives a write after its begin and before its answer. If it had received the previous write
        longer ago than its watchdog permits, its outputs have been off, and nobody else knows.

        Raises:
            LinkError: An exchange has failed.
        """
        for each in exchanges:
            data = self.checked(each)
            if self._combines:
                self._received = data
        self.confirmed = list(image)
        self._written_s = now_s = self._now_s()
        if self._served_s is not None and self.watchdog_ms is not None:
            self.had_gap |= now_s - self._served_s > self.watchdog_ms / 1_000
        self._served_s = self._begun_s

    def forget_gap(self) -> None:
        """Forget the writes so far; called while the machine is aborted, because a person must act then anyhow."""
        self.had_gap, self._served_s, self._reported_trips = False, None, None

    def read_back(self) -> list[Exchange]:
        """Return the exchanges that read the outputs."""
        return [self._exchange(block.read("outputs", self._read_back_first(block))) for block in self.outputs]

    def store_outputs(self, exchanges: Sequence[Exchange], image: list[bool]) -> None:
        """Write the levels of the outputs that have been read to an image.

        Raises:
            LinkError: An exchange has failed.
        """
        for block, each in zip(self.outputs, exchanges, strict=True):
            block.store(self.checked(each), image)

    def write_words(self, value_of: dict[int, int]) -> list[Exchange]:
        """Return the exchanges that write the output registers, given their values by D number."""
        return [
            self._exchange(write_registers(first, [value_of[number] for number in numbers]))
            for first, numbers in self.registers
        ]

    def safe_writes(self, image: Sequence[bool], value_of: dict[int, int]) -> list[Exchange]:
        """Return the exchanges that write the outputs and then the output registers."""
        return [*(self.writes(image) if self.outputs else ()), *self.write_words(value_of)]

    def read_owner(self) -> Generator[Exchange, None, OwnerReport]:
        """Read who owns the outputs, and note a trip of the output watchdog since the last reading.

        Raises:
            LinkError: The device does not answer, or does not report the owner.
        """
        request = read(ModbusTable.INPUT_REGISTER, REPORT_OFFSET, REPORT_WORDS, "registers")
        report = OwnerReport.decode(unpacked((yield from self._ask(request))))
        if report is None:
            raise DeviceRefusalError(str(self.failed("read of the owner of the outputs", "answer contains no report")))
        self.watchdog_ms = report.watchdog_ms
        self.had_gap |= self._reported_trips not in (None, report.trips)
        self._reported_trips = report.trips
        return report

    def drop_received(self) -> None:
        """Discard inputs that were received with a write before an interruption; they are read again."""
        self._received = None

    def checked(self, each: Exchange) -> bytes:
        """Return the data of an exchange.

        Raises:
            LinkError: The exchange has failed; the device is closed.
        """
        if each.data is not None or each.refusal:
            self.answers, self.waited_s = self.answers + 1, self.waited_s + each.took_s
        if each.data is not None:
            return each.data
        error = self.failed(each.request.operation, each.error)
        raise DeviceRefusalError(str(error)) if each.refusal else error

    def failed(self, operation: str, reason: str) -> LinkError:
        """Close the device and return the error; a late answer must not be read as the next one."""
        self.close()
        self.line.fail()
        self.error = f"{operation}: {reason}"
        return LinkError(f"field I/O {self.label}: {self.error}")

    def close(self) -> None:
        """Note that the device must be prepared again."""
        self._is_ready = self.has_inputs = False
        self._received = self.confirmed = self._written_s = None

    def _read_back_first(self, block: PointBlock) -> int:
        """Return the first offset at which a block of outputs is read."""
        area = self.plan.traits.outputs
        return block.first + (0 if area is None or area.read_back is None else area.read_back - area.first)

    def _show_adapter(self) -> Steps:
        """Read one point: no answer can be equal to the request, so that the adapter shows what it returns.

        An earlier answer shows it as well as that to this request, so that its content is of no importance.

        Raises:
            LinkError: The device does not answer.
        """
        if self.inputs:
            table, first = self.inputs[0].table, self.inputs[0].first
        elif self.outputs:
            table, first = self.outputs[0].table, self._read_back_first(self.outputs[0])
        else:
            table, first = ModbusTable.HOLDING_REGISTER, self.registers[0][0]
        each = self._exchange(read(table, first, 1, "point"))
        yield each
        if not each.is_answered:
            self.checked(each)

    def _synchronise(self) -> Steps:
        each = self._exchange(echo(self._echoes.randrange(1 << 16)))
        yield each
        if each.refusal != ILLEGAL_FUNCTION:
            self.checked(each)

    def _compare_model(self) -> Steps:
        """Compare the model that the device reports with the profile, the field file, and its first report.

        A device that refuses the registers reports nothing. That is a fault if its model is known.

        Raises:
            LinkError: The device does not answer, or is another one.
        """
        area = self.plan.traits.reports
        if area is None:
            return
        each = self._exchange(read(ModbusTable(area.table), area.first, area.count, "model"))
        yield each
        known = max(tuple(area.begins), self.plan.model, self.model, key=len)
        if each.refusal and not known:
            return
        found = tuple(unpacked(self.checked(each)))
        for expected in (tuple(area.begins), self.plan.model, self.model):
            if found[: len(expected)] != expected:
                text = f"reports {_values(found)} instead of {_values(expected)}"
                raise self.failed("model", f"{text}; connect the module of the field file, or change its entry")
        self.model = found

    def _prepare(self) -> Steps:
        """Compare and write the settings, and start the watchdog.

        Raises:
            LinkError: The device does not answer, refuses a register, or reads another value than the one written.
        """
        for setting in self.plan.traits.settings or ():
            unit_ms = setting.watchdog_unit_ms
            wanted = setting.value if unit_ms is None else (self.plan.watchdog_ms or 0) // unit_ms
            found = yield from self._register(setting.offset)
            if wanted is None or found == wanted:
                continue
            yield from self._ask(write_register(setting.offset, wanted))
            found = yield from self._register(setting.offset)
            if found != wanted:
                raise self.failed("settings", f"register {setting.offset:#06x} reads {found} instead of {wanted}")
        for entry in self.plan.traits.start or ():
            yield from self._write(entry)

    def _value(self, trip: TripEntry) -> Generator[Exchange, None, int]:
        table = ModbusTable(trip.table)
        data = yield from self._ask(read(table, trip.offset, 1, "flag of the watchdog"))
        return data[0] & 1 if table in _BITS else unpacked(data)[0]

    def _register(self, address: int) -> Generator[Exchange, None, int]:
        data = yield from self._ask(read(ModbusTable.HOLDING_REGISTER, address, 1, "setting"))
        return unpacked(data)[0]

    def _write(self, entry: WriteEntry) -> Asking:
        is_coil = ModbusTable(entry.table) is ModbusTable.COIL
        return self._ask((write_coil if is_coil else write_register)(entry.offset, entry.value))

    def _ask(self, request: ModbusRequest) -> Asking:
        each = self._exchange(request)
        yield each
        return self.checked(each)

    def _exchange(self, request: ModbusRequest) -> Exchange:
        return Exchange(self.line, self.plan.unit, self.plan.timeout_ms / 1_000, request)


def _values(values: Sequence[int]) -> str:
    return " ".join(map(str, values))
