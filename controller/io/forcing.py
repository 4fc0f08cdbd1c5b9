"""Forcing of inputs to a chosen level, to test the reaction of the program, the alarms and the panel.

A forced input bypasses interlocks, so motion is inhibited: inputs can be forced only while the machine is
Stopped in manual mode, and the runtime then writes the safe state of every output. Forcing ends automatically when the
machine leaves this state or mode, or when the forcing client does not renew it within `LEASE_MS`.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Final

from controller.common.saved import Saved
from controller.core.expr import all_of, evaluate
from controller.core.scan import Plc
from controller.program.machine import Transplanter
from controller.program.states import State

LEASE_MS: Final = 1_000
"""Time without a renewal by the forcing client after which all inputs are released, ms."""


class ForcingError(ValueError):
    """Raised for an input that cannot be forced; the message is one line with the remedy."""


class Forcing(Saved):
    """Forced inputs of one PLC. Requests are thread-safe and are applied by the scan.

    Attributes:
        allowed: True if inputs may be forced.
    """

    SAVED = ("_levels", "_renewed", "_renewed_ms", "allowed")

    def __init__(self, machine: Transplanter, plc: Plc, *, allowed: bool) -> None:
        """Initialise with no forced inputs.

        Args:
            machine: Program and its tags.
            plc: PLC whose inputs are forced.
            allowed: True to permit forcing.
        """
        self.allowed = allowed
        self._plc = plc
        self._numbers = frozenset(point.number for point in machine.io_map.inputs)
        control = machine.tags.machine
        self._permitted = all_of(control.manual, control.state.equals(State.STOPPED))
        self._levels: dict[int, bool] = {}
        self._lock = threading.Lock()
        self._renewed = False
        self._renewed_ms = 0

    @property
    def levels(self) -> dict[int, bool]:
        """Levels of the forced inputs, by X number (value of the octal address)."""
        return dict(self._levels)

    def force(self, number: int, level: bool | None) -> None:
        """Force an input to a level, or release it.

        Args:
            number: X number (value of the octal address).
            level: Raw level of the terminal; None = release.

        Raises:
            ForcingError: Forcing is not allowed, the input does not exist, or the machine is not Stopped in manual
                mode; nothing is changed.
        """
        if not self.allowed:
            raise ForcingError("forcing is not allowed; start the controller with --allow-forcing")
        if number not in self._numbers:
            raise ForcingError(f"X{number:o} is not wired")
        if level is not None and not evaluate(self._permitted, self._plc.memory):
            raise ForcingError("inputs can be forced only while the machine is Stopped in manual mode")
        with self._lock:
            if level is None:
                self._levels.pop(number, None)
            else:
                self._renewed = True  # set first, so that the scan does not apply the previous timeout to this level
                self._levels[number] = level

    def renew(self) -> None:
        """Renew the lease of the forcing client."""
        self._renewed = True

    def release_all(self) -> None:
        """Release all forced inputs."""
        with self._lock:
            self._levels.clear()

    def apply(self, inputs: list[bool], now_ms: int) -> Sequence[bool]:
        """Return the inputs with forced levels; the same list object if nothing is forced.

        Args:
            inputs: Levels read from the field, by X number.
            now_ms: Time of the scan, ms.
        """
        if not self._levels:
            return inputs
        if self._renewed:
            self._renewed, self._renewed_ms = False, now_ms
        if now_ms - self._renewed_ms >= LEASE_MS or not evaluate(self._permitted, self._plc.memory):
            self.release_all()
            return inputs
        levels = list(inputs)
        with self._lock:
            for number, level in self._levels.items():
                levels[number] = level
        return levels
