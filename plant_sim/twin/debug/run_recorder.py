"""Interface between a twin and a recorder of its run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class RunRecorder(Protocol):
    """Recorder of a run: it looks at a twin before and after its scans, and changes nothing."""

    def begin(self, until_ms: int) -> int:
        """Look before scans; return the time up to which they may run without a further look, ms."""

    def end(self) -> None:
        """Look after scans."""

    def watch(self, call: Callable[[], None]) -> None:
        """Look before and after a call of the watchers within a scan."""

    def switch_off(self, off_ms: int) -> None:
        """Look before the controller is switched off for a time."""

    def switch_on(self) -> None:
        """Look after the controller has been switched on."""
