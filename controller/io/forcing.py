"""Forcing: inputs held at a level of somebody's choice, to try what the program, the alarms and a panel make of them.

A forced input deceives every interlock, so nothing moves meanwhile: inputs are forced only while the machine stands in
Stopped in manual mode, the runtime writes every output safe, and it all ends by itself when the machine is to leave
Stopped, or when whoever forces has been silent.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Final

from controller.core.expr import all_of, evaluate
from controller.core.scan import Plc
from controller.program.machine import Transplanter
from controller.program.states import State

LEASE_MS: Final = 1_000
"""Silence of whoever forces after which every input is let go."""


class ForcingError(ValueError):
    """An input that cannot be forced; one line with the remedy."""


class Forcing:
    """The forced inputs of one PLC; ordered from any thread, applied by the scan."""

    def __init__(self, machine: Transplanter, plc: Plc, *, allowed: bool) -> None:
        """Force nothing yet.

        Args:
            machine: The program and its tags.
            plc: The PLC whose inputs they are.
            allowed: Whether inputs may be forced at all.
        """
        self.allowed = allowed
        self._plc = plc
        self._numbers = frozenset(point.number for point in machine.io_map.inputs)
        control = machine.tags.machine
        self._may = all_of(control.manual, control.state.equals(State.STOPPED))
        self._levels: dict[int, bool] = {}
        self._lock = threading.Lock()
        self._renewed = False
        self._heard_ms = 0

    @property
    def levels(self) -> dict[int, bool]:
        """The forced inputs: level by X number (octal value)."""
        return dict(self._levels)

    def force(self, number: int, level: bool | None) -> None:
        """Hold an input at a level, or let it go.

        Args:
            number: X number, octal value.
            level: Raw level of the terminal; None = let go.

        Raises:
            ForcingError: Forcing is not allowed, there is no such input, or the machine does not stand in Stopped in
                manual mode; nothing happens.
        """
        if not self.allowed:
            raise ForcingError("inputs may not be forced here; start the controller with --allow-forcing")
        if number not in self._numbers:
            raise ForcingError(f"X{number:o} is not wired")
        if level is not None and not evaluate(self._may, self._plc.memory):
            raise ForcingError("inputs can be forced only in Stopped in manual mode")
        with self._lock:
            if level is None:
                self._levels.pop(number, None)
            else:
                self._renewed = True  # first: the scan must not judge the new level by the silence before it
                self._levels[number] = level

    def renew(self) -> None:
        """Take a sign of life of whoever forces."""
        self._renewed = True

    def let_go(self) -> None:
        """Force nothing any more."""
        with self._lock:
            self._levels.clear()

    def over(self, inputs: list[bool], now_ms: int) -> Sequence[bool]:
        """Return the inputs of this scan; the very same list while nothing is forced.

        Args:
            inputs: What the field has sent, by X number.
            now_ms: Time of the scan, ms.
        """
        if not self._levels:
            return inputs
        if self._renewed:
            self._renewed, self._heard_ms = False, now_ms
        if now_ms - self._heard_ms >= LEASE_MS or not evaluate(self._may, self._plc.memory):
            self.let_go()
            return inputs
        levels = list(inputs)
        with self._lock:
            for number, level in self._levels.items():
                levels[number] = level
        return levels
