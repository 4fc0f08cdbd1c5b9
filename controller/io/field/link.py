"""`FieldLink` of one or more Modbus devices: devices on different lines are served at the same time.

A device that fails is closed, and every call raises until `open` has connected it again. The other devices remain
connected: `write_outputs` also writes to them while one is lost, so that their outputs can be made safe.
"""

from __future__ import annotations

import ssl
import time
from collections.abc import Callable, Iterable, Sequence

from controller.common.errors import InputError
from controller.common.modbus.io_map import IoMap
from controller.io.field.device import DEVICE_BUSY, FieldDevice
from controller.io.field.field_file import FieldPlan, LineSettings
from controller.io.field.line import BusLine, Exchange, complete, complete_all, exchange_all
from controller.io.field.schema import TcpEntry, TlsEntry
from controller.io.field.serial_bus import RtuBus
from controller.io.field.tcp_line import TcpBus
from controller.io.link import LinkError, OutputsTakenError


class DevicesLink:
    """`FieldLink` of the devices of a plan.

    Attributes:
        devices: Devices, in the order of the plan.
        wait_ms: Longest time that a scan waits for a device that does not respond, ms.
    """

    def __init__(self, plan: FieldPlan, io_map: IoMap, *, now_s: Callable[[], float] = time.perf_counter) -> None:
        """Create a closed link; `open` connects it.

        Args:
            plan: Devices with the places of the points.
            io_map: I/O map.
            now_s: Clock of the output watchdogs of the modules, s.

        Raises:
            InputError: A certificate cannot be used.
        """
        lines = {device.line: device.timeout_ms for device in plan.devices}
        made = {settings: line_of(settings) for settings in lines}
        self.devices = tuple(FieldDevice(device, made[device.line], now_s) for device in plan.devices)
        self.wait_ms = plan.wait_ms
        self._inputs = [False] * io_map.input_count
        self._output_count = io_map.output_count
        self._safe = io_map.safe_outputs()
        self._registers = [register.number for register in io_map.registers]
        self._safe_words = dict(zip(self._registers, io_map.safe_registers(), strict=True))
        self._scan = 0

    @property
    def lost(self) -> dict[str, str]:
        """Reason of each device that is closed after an error, by its label."""
        return {device.label: device.error for device in self.devices if not device.is_open and device.error}

    @property
    def unwritten(self) -> tuple[str, ...]:
        """Labels of the devices with outputs or registers that are closed after an error."""
        return tuple(
            each.label for each in self.devices if each.label in self.lost and (each.outputs or each.registers)
        )

    @property
    def tripped(self) -> tuple[str, ...]:
        """Labels of the devices whose output watchdog has tripped and has not been reset."""
        return tuple(device.label for device in self.devices if device.tripped)

    @property
    def waits(self) -> tuple[tuple[str, str, int, float], ...]:
        """Label, line, number of answers, total time that scans have waited for them, s, by device."""
        return tuple((each.label, each.line.address, each.answers, each.waited_s) for each in self.devices)

    @property
    def gaps(self) -> tuple[str, ...]:
        """Labels of the devices whose output watchdog may have tripped between two writes that they have confirmed."""
        return tuple(device.label for device in self.devices if device.had_gap)

    def forget_gaps(self) -> None:
        """Forget the writes so far, and the gaps between them."""
        for device in self.devices:
            device.forget_gap()

    def reset_tripped(self) -> None:
        """Reset the output watchdogs that have tripped.

        Raises:
            LinkError: A device does not answer, or remains tripped.
        """
        _raise_all(complete_all(device.reset() for device in self.devices if device.tripped))

    def open(self) -> None:
        """Connect the devices that are not connected, all at the same time.

        Raises:
            LinkError: A device is not reachable within its timeout; the others are connected.
        """
        closed = [device for device in self.devices if not device.is_open]
        for device in self.devices if closed else ():
            device.drop_received()
        unreachable = _open_lines(closed)
        errors = [_unreachable(device, unreachable[device.line]) for device in closed if device.line in unreachable]
        errors += complete_all(device.open() for device in closed if device.line.is_open)
        _raise_all(errors)

    def read_inputs(self) -> list[bool]:
        """Read the raw X image.

        Returns:
            Levels by X number; numbers that are not in the map are False. A device that is not polled in this scan
            contributes its last levels.

        Raises:
            LinkError: A device is closed, or its answer is late, malformed or an exception response.
        """
        self._scan += 1
        due = [device for device in self.devices if device.inputs and device.is_open and self._is_due(device)]
        self._transfer(due, FieldDevice.reads, lambda device, done: device.store_inputs(done, self._inputs))
        self._require_all("read of the inputs")
        return list(self._inputs)

    def read_outputs(self, devices: Iterable[FieldDevice] | None = None) -> list[bool]:
        """Read back the raw Y image.

        Args:
            devices: Devices to read; None = all that have outputs.

        Returns:
            Levels by Y number; other numbers are False.

        Raises:
            LinkError: A device is closed, or its answer is late, malformed or an exception response.
        """
        chosen = [device for device in devices or self.devices if device.outputs]
        image = [False] * self._output_count
        self._transfer(chosen, FieldDevice.read_back, lambda device, done: device.store_outputs(done, image))
        return image

    def write_outputs(self, image: Sequence[bool]) -> None:
        """Write the raw Y image to all devices that are connected and not tripped.

        Args:
            image: Levels by Y number; numbers that are not in the map are ignored.

        Raises:
            OutputsTakenError: The outputs of a device belong to another master; those of the others are safe.
            LinkError: A device is closed, or its answer is late, malformed or an exception response.
            ValueError: The image has the wrong length.
        """
        if len(image) != self._output_count:
            raise ValueError(f"Y image has {len(image)} levels; the I/O map requires {self._output_count}")
        possible = [device for device in self.devices if device.outputs and device.is_open]
        errors = complete_all(device.note_trip() for device in possible if device.is_trip_possible())
        due = [each for each in possible if each.is_open and not each.tripped and self._is_write_due(each, image)]
        try:
            self._write(due, lambda each: each.writes(image), lambda each, done: each.confirm(done, image))
        except LinkError as error:
            errors.append(str(error))
        _raise_all(errors)
        self._require_all("write of the outputs")

    def write_registers(self, values: Sequence[int]) -> None:
        """Write the output registers.

        Args:
            values: Values by the order of `IoMap.registers`, 0 to 32767.

        Raises:
            OutputsTakenError: The outputs of a device belong to another master.
            LinkError: A device is closed, or its answer is late, malformed or an exception response.
            ValueError: The number of values is wrong.
        """
        value_of = dict(zip(self._registers, values, strict=True))
        chosen = [device for device in self.devices if device.registers and device.is_open and not device.tripped]

        def check(device: FieldDevice, done: Sequence[Exchange]) -> None:
            for each in done:
                device.checked(each)

        self._write(chosen, lambda device: device.write_words(value_of), check)
        self._require_all("write of the registers")

    def close(self) -> None:
        """Disconnect all devices; no effect on a closed link."""
        for device in self.devices:
            device.close()
            device.line.close()

    def _is_due(self, device: FieldDevice) -> bool:
        """Return True in the scans in which a device is polled, and until it has been."""
        every = device.plan.poll_every
        has_inputs = device.has_inputs or not device.inputs
        return not has_inputs or self._scan % every == self.devices.index(device) % every

    def _is_write_due(self, device: FieldDevice, image: Sequence[bool]) -> bool:
        last = device.confirmed
        changed = last is None or any(image[n] != last[n] for n, _ in device.plan.outputs)
        return changed or self._is_due(device)

    def _write(
        self,
        devices: Sequence[FieldDevice],
        make: Callable[[FieldDevice], list[Exchange]],
        confirm: Callable[[FieldDevice, Sequence[Exchange]], None],
    ) -> None:
        """Write to devices; if one has lent its outputs to another master, make those of the others safe."""
        taken: dict[FieldDevice, str] = {}

        def confirm_or_note(device: FieldDevice, done: Sequence[Exchange]) -> None:
            refused = next((each for each in done if each.refusal == DEVICE_BUSY and device.lends), None)
            if refused is None:
                confirm(device, done)
                return
            owner = complete(device.read_owner()).owner or "another master"
            taken[device] = f"field I/O {device.label}: {refused.request.operation}: the outputs belong to {owner}"

        self._transfer(devices, make, confirm_or_note)
        if taken:
            others = [each for each in self.devices if each.is_open and not each.tripped and each not in taken]
            exchange_all(each for device in others for each in device.safe_writes(self._safe, self._safe_words))
            raise OutputsTakenError("; ".join(taken.values()))

    def _transfer(
        self,
        devices: Sequence[FieldDevice],
        make: Callable[[FieldDevice], list[Exchange]],
        store: Callable[[FieldDevice, Sequence[Exchange]], None],
    ) -> None:
        """Execute the exchanges of devices, and store the answers of each.

        Raises:
            LinkError: A device is closed or has failed; the answers of the others are stored.
        """
        exchanges = {device: make(device) for device in devices}
        exchange_all(each for made in exchanges.values() for each in made)
        errors = []
        for device, done in exchanges.items():
            try:
                store(device, done)
            except LinkError as error:
                errors.append(str(error))
        _raise_all(errors)

    def _require_all(self, operation: str) -> None:
        closed = next((device for device in self.devices if not device.is_open), None)
        if closed is not None:
            raise LinkError(f"field I/O {closed.label}: {operation}: the link is not open")


def line_of(settings: LineSettings) -> BusLine:
    """Return the closed line with these settings.

    Raises:
        InputError: A certificate cannot be used.
    """
    if isinstance(settings, TlsEntry):
        return TcpBus(settings.host, settings.port, _tls_context(settings), settings.server_name)
    return TcpBus(settings.host, settings.port) if isinstance(settings, TcpEntry) else RtuBus(settings)


def _tls_context(settings: TlsEntry) -> ssl.SSLContext:
    try:
        context = ssl.create_default_context(cafile=settings.ca)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        if settings.certificate is not None:
            context.load_cert_chain(settings.certificate, settings.key)
    except (OSError, ssl.SSLError) as error:
        files = ", ".join(filter(None, (settings.ca, settings.certificate, settings.key)))
        raise InputError(f"{files}: {error.args[-1]}; use PEM files that belong together") from error
    return context


def _open_lines(devices: Sequence[FieldDevice]) -> dict[BusLine, str]:
    """Open the closed lines of devices at the same time; return the reasons of those that remain closed."""
    timeout_s = {device.line: device.plan.timeout_ms / 1_000 for device in devices if not device.line.is_open}
    reasons: dict[BusLine, str] = {}

    def attempt(line: BusLine, action: Callable[[], None]) -> None:
        try:
            action()
        except OSError as error:
            reasons[line] = error.strerror or str(error)

    start_s = time.perf_counter()
    for line in timeout_s:
        attempt(line, line.begin)
    for line, limit_s in timeout_s.items():
        if line not in reasons:
            attempt(line, lambda line=line, limit_s=limit_s: line.finish(start_s + limit_s))  # type: ignore[misc]
    return reasons


def _raise_all(errors: Sequence[str]) -> None:
    if errors:
        raise LinkError("; ".join(errors))


def _unreachable(device: FieldDevice, reason: str) -> str:
    device.close()
    device.error = f"not reachable within {device.plan.timeout_ms} ms ({reason})"
    return (
        f"no field I/O {device.label}: {device.error}; check the address and that the I/O module or plant server is "
        "running"
    )
