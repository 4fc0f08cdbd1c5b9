"""Runtime of one PLC on one field link: a complete scan from the input terminals to the output terminals.

Inputs are read, the program is scanned, retentive memory is submitted for storage, and the Y image is released and
written. After any failure the outputs are set to their safe state and written.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeVar

from controller.common.saved import Saved
from controller.core.expr import Bit, Word
from controller.core.scan import Plc
from controller.io.connection import FieldConnection, TrippingModules
from controller.io.forcing import Forcing
from controller.io.link import FieldLink, OutputsTakenError
from controller.io.ownership import OutputGuard, OutputOwnership
from controller.io.panel_watch import PanelWatch
from controller.io.retentive_writer import DirectRetentiveWriter, RetentiveWriter
from controller.io.scan_writes import ScanWrite, ScanWrites
from controller.program.machine import Transplanter
from controller.program.states import State

Observer = Callable[[int, Plc], None]
T = TypeVar("T")

_log = logging.getLogger(__name__)

STORE_LIMIT_MS = 1_000
"""Longest time that outputs wait for the retentive store, ms; a longer wait sets a store fault."""
SCAN_LIMIT_MS = 200
"""Longest time from one scan to the next, ms, as in D8000 of the FX2N (docs/sources/fx2n.md 1.4)."""


class Runtime(Saved):
    """Runtime of the machine's program on a field link; `tick` executes one scan.

    Attributes:
        machine: Program and its tags.
        plc: PLC that executes the program.
        forcing: Forced inputs.
        ownership: Ownership of the outputs.
        panel: Messages of the operator panel and their timeout.
        writes: Writes of communication partners, which are answered at the end of the scan that took them.
        gate: Lock of everything that enters from other threads. A recorder holds it from its look to the end of the
            scans, so that they begin with what it has seen.
        field: Connection to the field link.
        released: Y image written last, raw levels.
        released_words: Values of the output registers written last.
        now_ms: Time of the last scan, ms.
        observers: Functions called at the end of every scan with the time of the scan and the PLC.
    """

    SAVED = (
        "_failed",
        "_held_since_ms",
        "_last_scan_ms",
        "_orders",
        "_status",
        "_store_failed",
        "_submitted_image",
        "now_ms",
        "observers",
        "released",
        "released_words",
    )

    def __init__(
        self,
        machine: Transplanter,
        plc: Plc,
        link: FieldLink,
        retentive_writer: RetentiveWriter,
        *,
        link_limit_ms: int = 100,
        link_wait_ms: int = 0,
        scan_limit_ms: int = SCAN_LIMIT_MS,
        panel_limit_ms: int | None = None,
        allow_forcing: bool = False,
        guard: OutputGuard | None = None,
        modules: TrippingModules | None = None,
    ) -> None:
        """Connect the PLC to the link; the first tick opens the link.

        Args:
            machine: Program and its tags.
            plc: PLC with this program.
            link: Field link.
            retentive_writer: Writer of the retentive devices.
            link_limit_ms: Timeout of the field link, ms.
            link_wait_ms: Longest duration of a further attempt to open the link, ms; a loss is declared earlier by it.
            scan_limit_ms: Longest time between two scans, ms.
            panel_limit_ms: Timeout of the operator panel, ms, active after the panel's first message. When it expires,
                the machine finishes the cycle and holds. None = no timeout.
            allow_forcing: True to permit forcing of inputs.
            guard: Detection of another master on the link; None = none.
            modules: Modules of the link that are reset after a trip of their output watchdog; None = none.
        """
        self.machine = machine
        self.plc = plc
        self.forcing = Forcing(machine, plc, allowed=allow_forcing)
        self.field = FieldConnection(
            link, machine.io_map, limit_ms=link_limit_ms, wait_ms=link_wait_ms, modules=modules
        )
        self.now_ms = 0
        self.observers: list[Observer] = []
        self.released = machine.io_map.safe_outputs()
        self.released_words = machine.io_map.safe_registers()
        self._retentive_writer = retentive_writer
        self._scan_limit_ms = scan_limit_ms
        self._last_scan_ms: int | None = None
        self._failed = False
        self._store_failed = False
        self._held_since_ms: int | None = None
        self._orders: deque[Sequence[tuple[Bit | Word, int]]] = deque()
        """Writes from other threads; the writes of one entry take effect in the same scan."""
        self.writes = ScanWrites()
        self.gate = threading.RLock()
        self.panel = PanelWatch(panel_limit_ms)
        self._safe = machine.io_map.safe_outputs()
        self._safe_words = machine.io_map.safe_registers()
        self.ownership = OutputOwnership(guard, self._safe)
        self._submitted_image = plc.retentive_image()
        system = machine.tags.system
        self._status_bits = tuple(bit for bit in system.bits() if bit != system.memory_lost)
        self._status: tuple[bool, ...] = ()

    def save(self) -> Any:
        """Return the current state, with that of the PLC, but without those of the link and the retentive writer."""
        return (
            super().save(),
            self.plc.save(),
            self.forcing.save(),
            self.field.save(),
            self.ownership.save(),
            self.panel.save(),
        )

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, plc, forcing, field, ownership, panel = saved
        super().restore(own)
        self.plc.restore(plc)
        self.forcing.restore(forcing)
        self.field.restore(field)
        self.ownership.restore(ownership)
        self.panel.restore(panel)

    def tick(self, now_ms: int, start_ms: int | None = None) -> None:
        """Execute one scan.

        Args:
            now_ms: Due time of the scan, an integer in ms.
            start_ms: Actual start of the scan, ms, used for the link timeout and the scan limit; None = the due time.
        """
        start_ms = now_ms if start_ms is None else start_ms
        self.now_ms = now_ms
        if not self.field.read(start_ms):
            self.ownership.doubt()
        late = self._last_scan_ms is not None and start_ms - self._last_scan_ms > self._scan_limit_ms
        self._last_scan_ms = start_ms
        while self._orders:
            for device, value in self._orders.popleft():
                self.plc.write(device, value)
        self.writes.take()
        self.panel.adopt(now_ms)
        self._write_status(
            self.link_lost,
            late or self._failed,
            self._held_since_ms is not None,
            self._store_fault(now_ms),
            self.panel.is_silent(now_ms),
            *self.ownership.status(start_ms),
            self.panel.is_shown(now_ms),
        )
        levels = self.forcing.apply(self.field.inputs, now_ms)
        image = self._scan(now_ms, levels)
        # After a link loss the first image written must be the safe state, including lamps and horn. Forced inputs must
        # not cause motion either.
        safe = self.link_lost or bool(self.ownership.taken) or levels is not self.field.inputs
        wanted = self._release(now_ms, image)  # in every scan, because it observes the store
        self.released = list(self._safe) if safe else wanted
        self.released_words = self._release_words(safe=safe)
        self._write(start_ms)
        self.notify_observers(now_ms)
        self.writes.settle()

    @property
    def link(self) -> FieldLink:
        """The field link."""
        return self.field.link

    @property
    def link_lost(self) -> bool:
        """True if the field link has exceeded its timeout."""
        return self.field.lost

    @property
    def is_steady(self) -> bool:
        """True if the next scan only reads the inputs, executes the program and writes the outputs.

        There is no fault, no held output, no forced input, no order, no output register, and no operator panel, and
        retentive values are stored at once.
        """
        return (
            self.field.is_open
            and self.field.has_inputs
            and not (any(self._status) or self.link_lost or self._failed or self.forcing.levels)
            and not (self._orders or self.writes.are_waiting)
            and self.panel.is_idle
            and not self.released_words
            and self._held_since_ms is None
            and self.ownership.guard is None
            and isinstance(self._retentive_writer, DirectRetentiveWriter)
            and self._retentive_writer.error is None
        )

    def adopt(self, now_ms: int, levels: Sequence[bool]) -> None:
        """Adopt the result of scans that were executed elsewhere on the memory of the PLC while `is_steady`.

        Neither observers nor the retentive writer are called.

        Args:
            now_ms: Time of the last of these scans, ms.
            levels: Raw levels of the inputs in that scan.
        """
        self.now_ms = self._last_scan_ms = now_ms
        self.released = self.plc.memory.Y[: len(self._safe)]
        self.field.adopt(now_ms, levels)  # each of the scans has exchanged data

    def submit_retentive(self) -> None:
        """Submit changed retentive values. After an error, submit them again even if no value changes."""
        image = self.plc.retentive_image()
        if image != self._submitted_image or self._retentive_writer.error is not None:
            self._submitted_image = image
            self._retentive_writer.submit(self.plc.retained())

    def notify_observers(self, now_ms: int) -> None:
        """Call the observers; an observer that raises is logged and removed, and the machine continues."""
        for observe in tuple(self.observers):
            try:
                observe(now_ms, self.plc)
            except Exception:  # noqa: BLE001 - an error of an observer must not stop the machine
                _log.exception("an observer failed at %d ms and has been removed", now_ms)
                self.observers.remove(observe)

    def order(self, command: str) -> None:
        """Set a bit of the command table for the entire next scan; thread-safe.

        Raises:
            KeyError: The command is unknown; nothing is changed.
        """
        bit = self.machine.tags.commands[command]
        with self.gate:
            self._orders.append([(bit, 1)])
            self.panel.heartbeat()

    def set_points(self, values: Mapping[str, str]) -> None:
        """Change set-points; thread-safe. All of them take effect in the next scan.

        Raises:
            SetPointError: A set-point is unknown, or a value is out of range; nothing is changed.
        """
        changes = self.machine.tags.sp.changes(values)
        with self.gate:
            self._orders.append(changes)
            self.panel.heartbeat()

    def submit(self, changes: Sequence[tuple[Bit | Word, int]], act: Callable[[], None] = lambda: None) -> ScanWrite:
        """Write devices in the next scan, all in the same one, after calling `act`, which may refuse; thread-safe."""

        def change() -> None:
            act()
            for device, value in changes:
                self.plc.write(device, value)

        with self.gate:
            self.panel.heartbeat()
            return self.writes.submit(change)

    def write_safe_outputs(self) -> bool:
        """Write the safe state of every output and return True if the field I/O accepted it.

        Outputs that belong to another master are left to it.
        """
        self._release_safe()
        if self.ownership.taken:
            return False
        with suppress(OSError):  # the devices that are connected are written although another one is lost
            self.link.open()
        try:
            self._write_all()
        except OutputsTakenError as taken:
            self.ownership.lose(str(taken), self.now_ms)
            return False
        except OSError:
            self.link.close()
            return False
        return True

    def _write_status(self, *status: bool) -> None:
        """Write the system bits in the order of `_status_bits`; only the runtime writes them."""
        if status != self._status:
            self._status = status
            for bit, value in zip(self._status_bits, status, strict=True):
                self.plc.write(bit, value)

    def _scan(self, now_ms: int, levels: Sequence[bool]) -> Sequence[bool]:
        """Scan the program and submit its retentive values; a failed scan sets safe outputs and latches a fault."""
        try:
            image = self.plc.scan(now_ms, levels)[: len(self._safe)]
            self.submit_retentive()
        except Exception:  # noqa: BLE001 - after any error the outputs are set safe and the fault is latched
            if not self._failed:
                _log.exception("scan failed at %d ms; outputs safe", now_ms)
            self._failed = True
            return self._safe
        self._failed = False
        return image

    def _store_fault(self, now_ms: int) -> bool:
        overdue = self._held_since_ms is not None and now_ms - self._held_since_ms > STORE_LIMIT_MS
        if self._retentive_writer.error is not None and not self._store_failed:
            _log.error("retentive memory cannot be stored: %s", self._retentive_writer.error)
        self._store_failed = self._retentive_writer.error is not None
        return overdue or self._store_failed

    def _write(self, now_ms: int) -> None:
        aborted = self.plc.read(self.machine.tags.machine.state) in (State.ABORTING, State.ABORTED)
        was_lost, was_open = self.link_lost, self.field.is_open
        if was_open:
            if self.field.write(now_ms, lambda: self._write_owned(now_ms, aborted=aborted), aborted=aborted):
                return
            self.ownership.doubt()
        is_written = was_open and was_lost  # the safe state, to every device that is connected
        if self.link_lost and not is_written and not self.ownership.taken:
            self._release_safe()
            self.field.write_rest(self._write_all)

    def _write_owned(self, now_ms: int, *, aborted: bool) -> None:
        self.ownership.write(now_ms, self._write_all, self._release_safe, aborted=aborted)

    def _release_safe(self) -> None:
        self.released = list(self._safe)
        self.released_words = list(self._safe_words)

    def _write_all(self) -> Sequence[bool]:
        """Write outputs and registers; return the Y image.

        Registers are written first, because the complete block of outputs advances a plant in lock step. Safe values
        are written after the outputs, so that a device that refuses them does not keep the outputs on, and also if a
        device with outputs is lost.
        """
        if not self.released_words:
            self.link.write_outputs(self.released)
        elif self.released_words != self._safe_words:
            self.link.write_registers(self.released_words)
            self.link.write_outputs(self.released)
        else:
            try:
                self.link.write_outputs(self.released)
            except OSError:
                with suppress(OSError):
                    self.link.write_registers(self.released_words)
                raise
            self.link.write_registers(self.released_words)
        return self.released

    def _release(self, now_ms: int, image: Sequence[bool]) -> list[bool]:
        """Return the outputs to write; until all values are stored, only changes to the safe level are permitted."""
        if self._retentive_writer.settled:
            self._held_since_ms = None
            return list(image)
        if self._held_since_ms is None:
            self._held_since_ms = now_ms
        return _held(image, self.released, self._safe)

    def _release_words(self, *, safe: bool) -> list[int]:
        """Return the output registers to write; they wait for the retentive store in the same way as the outputs."""
        if safe or self._failed:
            return list(self._safe_words)
        wanted = [self.plc.read(word) for word in self.machine.program.output_words]
        return wanted if self._held_since_ms is None else _held(wanted, self.released_words, self._safe_words)


def _held(wanted: Sequence[T], before: Sequence[T], safe: Sequence[T]) -> list[T]:
    """Return the outputs of which only the changes to the safe level are permitted."""
    return [new if new == fallback else old for new, old, fallback in zip(wanted, before, safe, strict=True)]
