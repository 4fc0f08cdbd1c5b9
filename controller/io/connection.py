"""Connection of the runtime to its field link: timeout, reopening, assumed inputs, and tripped output watchdogs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Final, Protocol

from controller.common.modbus.io_map import IoMap
from controller.common.saved import Saved
from controller.io.link import FieldLink, LinkWatchdog

REOPEN_MS: Final = 200
"""Interval between attempts to reopen a lost link, ms (assumed): with the timeouts of an attempt, a device is used
again within 500 ms."""


class TrippingModules(Protocol):
    """Modules with an output watchdog, which in some of them remains tripped until a register is written."""

    @property
    def tripped(self) -> tuple[str, ...]:
        """Labels of the tripped modules; their outputs are off and are not written."""

    @property
    def gaps(self) -> tuple[str, ...]:
        """Labels of the modules whose output watchdog may have tripped between two confirmed writes."""

    def forget_gaps(self) -> None:
        """Forget the writes so far, and the gaps between them."""

    def reset_tripped(self) -> None:
        """Reset the tripped modules.

        Raises:
            OSError: A module does not answer, or remains tripped.
        """


class FieldConnection(Saved):
    """Connection to a field link.

    A tripped module aborts the machine like a lost link, and is reset in the scan in which the operator has cleared the
    abort. A gap between two confirmed writes in which a module may have tripped does so as well, even if all outputs
    were off: no output that moves something is switched on after a trip before a person has acted.

    Attributes:
        link: The link.
        is_open: True if the link has not failed since it was opened.
        lost: True if the link has exceeded its timeout.
        inputs: Levels read last, or assumed while the link is lost.
        has_inputs: True if inputs have been read since the start.
    """

    SAVED = ("_is_trip_known", "_reopen_at_ms", "has_inputs", "inputs", "is_open", "lost")

    def __init__(
        self, link: FieldLink, io_map: IoMap, *, limit_ms: int, wait_ms: int, modules: TrippingModules | None
    ) -> None:
        """Create a connection; the first `read` opens the link.

        Args:
            link: Field link.
            io_map: I/O map.
            limit_ms: Timeout of the link, ms.
            wait_ms: Longest duration of a further attempt to open the link, ms; a loss is declared earlier by it.
            modules: Modules that are reset after a trip; None = none.
        """
        self.link = link
        self.is_open = self.lost = self.has_inputs = False
        self.inputs = io_map.safe_inputs()
        self._io_map = io_map
        self._watchdog = LinkWatchdog(limit_ms)
        self._wait_ms = wait_ms
        self._modules = modules
        self._reopen_at_ms: int | None = None
        self._is_trip_known = False
        """True if the machine has been aborted since the trip."""

    def save(self) -> Any:
        """Return the current state, without that of the link."""
        return super().save(), self._watchdog.save()

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, watchdog = saved
        super().restore(own)
        self._watchdog.restore(watchdog)

    def read(self, now_ms: int) -> bool:
        """Read the inputs, on a closed link after an attempt to open it; return False if the link has failed."""
        if self.is_open and self._watchdog.expired(now_ms):
            self.lost = True  # the output watchdog of the module has tripped in the meantime
        is_open = self.is_open
        try:
            if is_open or self._reopen(now_ms):
                self.inputs = self.link.read_inputs()
                self.has_inputs = True
        except OSError:
            self._fail(now_ms)
        self.lost |= not self.has_inputs  # no earlier image can bridge a short interruption
        self.lost |= self._is_trip_new or (self._modules is not None and bool(self._modules.gaps))
        return self.is_open or not is_open

    def write(self, now_ms: int, write: Callable[[], None], *, aborted: bool) -> bool:
        """Write the outputs; return False if the link has failed.

        Args:
            now_ms: Time, ms.
            write: Function that writes the outputs.
            aborted: True until the operator has cleared the abort.
        """
        try:
            self._reset_modules(aborted=aborted)
            write()
        except OSError:
            self._fail(now_ms)
            return False
        if self._modules is not None and (aborted or self.lost):
            self._modules.forget_gaps()
        if self.lost:
            self._watchdog.reset()
            self.lost = False
        self._watchdog.feed(now_ms)
        return True

    def write_rest(self, write: Callable[[], object]) -> None:
        """Write to the devices of a failed link that are still connected."""
        with suppress(OSError):
            write()

    def adopt(self, now_ms: int, inputs: Sequence[bool]) -> None:
        """Adopt successful exchanges that were executed elsewhere, the last of them at `now_ms`."""
        self.inputs = list(inputs)
        self._watchdog.reset()
        self._watchdog.feed(now_ms)

    @property
    def _is_trip_new(self) -> bool:
        return self._modules is not None and bool(self._modules.tripped) and not self._is_trip_known

    def _reset_modules(self, *, aborted: bool) -> None:
        """Reset tripped modules once the operator has cleared the abort that followed the trip."""
        if self._modules is None or not self._modules.tripped:
            self._is_trip_known = False
        elif aborted:
            self._is_trip_known = True
        elif self._is_trip_known:
            self._modules.reset_tripped()
            self._is_trip_known = False

    def _reopen(self, now_ms: int) -> bool:
        """Try to reopen the link: in every scan before the timeout, then every `REOPEN_MS`."""
        if self._watchdog.expired(now_ms + self._wait_ms):
            self.lost = True
            self.inputs = self._io_map.safe_inputs()
            if self._reopen_at_ms is not None and now_ms < self._reopen_at_ms:
                return False
        self._reopen_at_ms = now_ms + REOPEN_MS
        try:
            self.link.open()
        except OSError:
            return False
        self.is_open = True
        return True

    def _fail(self, now_ms: int) -> None:
        self.is_open = False
        if self._watchdog.expired(now_ms):
            self.lost = True
