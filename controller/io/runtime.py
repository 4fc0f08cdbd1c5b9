"""One PLC on one field link: the order of a scan from terminals to terminals, in one place.

Inputs are read, the scan runs, retentive memory is kept, the Y image is released and written. Whatever fails,
outputs go to their safe state first and are written.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from controller.core.expr import Bit, Word
from controller.core.scan import Plc
from controller.io.forcing import Forcing
from controller.io.keeper import Keeper
from controller.io.link import FieldLink, LinkWatchdog
from controller.program.machine import Transplanter
from controller.program.tags import SetPointError

Observer = Callable[[int, Plc], None]

_log = logging.getLogger(__name__)

STORE_LIMIT_MS = 1_000
"""Longest time coils are held back for the store; then the store is at fault."""
SCAN_LIMIT_MS = 200
"""Longest time from one scan to the next, the FX2N's D8000 (FX.md 1.4)."""
REOPEN_MS = 500


class Runtime:
    """Runs the machine's program on a link, one `tick` a scan.

    Attributes:
        machine: The program and its tags.
        plc: The PLC that runs it.
        forcing: Inputs that somebody holds at a level of his own.
        link_lost: Whether the field is silent beyond the limit.
        released: The Y image last written, raw levels.
        now_ms: Time of the last scan, ms.
        observers: Asked to look at the end of every scan, given its time and the PLC.
    """

    def __init__(
        self,
        machine: Transplanter,
        plc: Plc,
        link: FieldLink,
        keeper: Keeper,
        *,
        link_limit_ms: int = 100,
        link_wait_ms: int = 0,
        scan_limit_ms: int = SCAN_LIMIT_MS,
        panel_limit_ms: int | None = None,
        allow_forcing: bool = False,
    ) -> None:
        """Put the PLC on the link; the link is opened by the first tick.

        Args:
            machine: The program and its tags.
            plc: A PLC with that program.
            link: Way to the field.
            keeper: Keeps the retentive devices.
            link_limit_ms: Silence of the field after which it is lost, ms.
            link_wait_ms: Longest time one more try may take, ms: a field that does not answer is given up so much
                earlier, for the loss to be known within the limit.
            scan_limit_ms: Longest time between two scans, ms.
            panel_limit_ms: Silence of the operator panel, once it was heard, after which the machine finishes the
                cycle and holds, ms; None = it may be silent.
            allow_forcing: Whether inputs may be forced at all.
        """
        self.machine = machine
        self.plc = plc
        self.forcing = Forcing(machine, plc, allowed=allow_forcing)
        self.link_lost = False
        self.now_ms = 0
        self.observers: list[Observer] = []
        self.released = machine.io_map.safe_outputs()
        self._link = link
        self._keeper = keeper
        self._watchdog = LinkWatchdog(link_limit_ms)
        self._wait_ms = link_wait_ms
        self._scan_limit_ms = scan_limit_ms
        self._last_scan_ms: int | None = None
        self._reopen_at_ms: int | None = None
        self._open = False
        self._seen = False
        self._failed = False
        self._store_refused = False
        self._held_since_ms: int | None = None
        self._orders: deque[Sequence[tuple[Bit | Word, int]]] = deque()
        """What is written together, in one scan."""
        self._panel_limit_ms = panel_limit_ms
        self._panel_heard = False
        self._panel_heard_ms: int | None = None
        self._inputs = machine.io_map.safe_inputs()
        self._safe = machine.io_map.safe_outputs()
        self._kept = plc.kept_image()
        system = machine.tags.system
        self._told_in = (
            system.link_lost, system.scan_fault, system.outputs_held, system.store_fault, system.panel_silent,
        )  # fmt: skip
        self._told: tuple[bool, ...] = ()

    def tick(self, now_ms: int, began_ms: int | None = None) -> None:
        """Do one scan.

        Args:
            now_ms: Time of the scan, integer ms: the instant it was due.
            began_ms: When it really began, ms, by which silence and lateness are judged; None = when it was due.
        """
        began_ms = now_ms if began_ms is None else began_ms
        self.now_ms = now_ms
        if self._open and self._watchdog.lost(began_ms):
            self.link_lost = True  # the module has switched off meanwhile, whatever it says now
        self._read(began_ms)
        late = self._last_scan_ms is not None and began_ms - self._last_scan_ms > self._scan_limit_ms
        self._last_scan_ms = began_ms
        while self._orders:
            for device, value in self._orders.popleft():
                self.plc.write(device, value)
        self._tell_program(
            self.link_lost,
            late or self._failed,
            self._held_since_ms is not None,
            self._store_fault(now_ms),
            self._panel_silent(now_ms),
        )
        levels = self.forcing.over(self._inputs, now_ms)
        image = self._scan(now_ms, levels)
        # A field that was lost takes nothing but the safe state first, lamps and horn included. Nothing moves on inputs
        # that are not the machine's own, either.
        safe = self.link_lost or levels is not self._inputs
        self.released = list(self._safe) if safe else self._release(now_ms, image)
        self._write(began_ms)
        self._tell(now_ms)

    def order(self, command: str) -> None:
        """Give an order of the command table, from any thread; it lives the whole of the next scan.

        Raises:
            KeyError: There is no such command; nothing happens.
        """
        self._orders.append([(self.machine.tags.commands[command], 1)])
        self.heard()

    def set_points(self, values: Mapping[str, str]) -> None:
        """Change set-points, from any thread; they take effect together with the next scan.

        Raises:
            SetPointError: There is no such set-point, or a value is out of its range; nothing happens.
        """
        set_points = self.machine.tags.sp
        changes = [set_points.checked(name, value) for name, value in values.items()]
        if any(word in set_points.at_start for word, _ in changes):
            raise SetPointError("it belongs to the machine; give it at the start with --set")
        self._orders.append(changes)
        self.heard()

    def heard(self) -> None:
        """Take a sign of life of the operator panel, from any thread."""
        self._panel_heard = True

    def make_safe(self) -> bool:
        """Write every output's safe state; return whether the field has taken it."""
        self.released = list(self._safe)
        try:
            self._link.open()
            self._link.write_outputs(self.released)
        except OSError:
            self._link.close()
            return False
        return True

    def _tell_program(self, *told: bool) -> None:
        """Write the system bits in the order of `_told_in`; only the runtime writes them."""
        if told != self._told:
            self._told = told
            for bit, value in zip(self._told_in, told, strict=True):
                self.plc.write(bit, value)

    def _scan(self, now_ms: int, levels: Sequence[bool]) -> Sequence[bool]:
        """Run the program and keep what it remembers; a scan that fails gives safe outputs and a latched fault."""
        try:
            image = self.plc.scan(now_ms, levels)[: len(self._safe)]
            self._keep()
        except Exception:  # noqa: BLE001 - whatever it is, outputs go safe and the fault is latched
            if not self._failed:
                _log.exception("scan failed at %d ms; outputs safe", now_ms)
            self._failed = True
            return self._safe
        self._failed = False
        return image

    def _store_fault(self, now_ms: int) -> bool:
        overdue = self._held_since_ms is not None and now_ms - self._held_since_ms > STORE_LIMIT_MS
        if self._keeper.error is not None and not self._store_refused:
            _log.error("retentive memory cannot be stored: %s", self._keeper.error)
        self._store_refused = self._keeper.error is not None
        return overdue or self._store_refused

    def _tell(self, now_ms: int) -> None:
        """Let the observers look; one that fails is told of and not asked again, and the machine goes on."""
        for observe in tuple(self.observers):
            try:
                observe(now_ms, self.plc)
            except Exception:  # noqa: BLE001 - whatever it is, it must not stop the machine
                _log.exception("an observer failed at %d ms and is left out from now on", now_ms)
                self.observers.remove(observe)

    def _panel_silent(self, now_ms: int) -> bool:
        if self._panel_heard:
            self._panel_heard, self._panel_heard_ms = False, now_ms
        if self._panel_limit_ms is None or self._panel_heard_ms is None:
            return False
        return now_ms - self._panel_heard_ms >= self._panel_limit_ms

    def _read(self, now_ms: int) -> None:
        try:
            if self._open or self._reopen(now_ms):
                self._inputs = self._link.read_inputs()
                self._seen = True
        except OSError:
            self._lose(now_ms)
        if not self._seen:
            self.link_lost = True  # there is no last image to bridge a gap with

    def _write(self, now_ms: int) -> None:
        if not self._open:
            return
        try:
            self._link.write_outputs(self.released)
        except OSError:
            self._lose(now_ms)
            return
        if self.link_lost:
            self._watchdog.reset()
            self.link_lost = False
        self._watchdog.good(now_ms)

    def _reopen(self, now_ms: int) -> bool:
        """Try the field again: at once while it is only late, at intervals once it is lost."""
        if self._watchdog.lost(now_ms + self._wait_ms):
            self.link_lost = True
            self._inputs = self.machine.io_map.safe_inputs()
            if self._reopen_at_ms is not None and now_ms < self._reopen_at_ms:
                return False
        self._reopen_at_ms = now_ms + REOPEN_MS
        try:
            self._link.open()
        except OSError:
            return False
        self._open = True
        return True

    def _lose(self, now_ms: int) -> None:
        self._open = False
        if self._watchdog.lost(now_ms):
            self.link_lost = True

    def _keep(self) -> None:
        """Submit what changed, and again what was refused: a machine at rest may change nothing more."""
        kept = self.plc.kept_image()
        if kept != self._kept or self._keeper.error is not None:
            self._kept = kept
            self._keeper.submit(self.plc.retained())

    def _release(self, now_ms: int, image: Sequence[bool]) -> list[bool]:
        """Hold back what acts on memory not yet stored; going to the safe level is never held back."""
        if self._keeper.settled:
            self._held_since_ms = None
            return list(image)
        if self._held_since_ms is None:
            self._held_since_ms = now_ms
        return [
            level if level in (safe, before) else before
            for level, before, safe in zip(image, self.released, self._safe, strict=True)
        ]
