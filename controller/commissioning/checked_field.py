"""Exchange with the field I/O during a check: one output at a time, safe levels at every end."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Final

from controller.commissioning.axes import Change, Levels
from controller.commissioning.hold import HoldToRun
from controller.commissioning.terminal import Keyboard
from controller.common.modbus.io_map import IoMap, Point
from controller.common.stop_request import Stop
from controller.core.clock import Clock
from controller.io.field.link import DevicesLink
from controller.io.link import OutputsTakenError

PERIOD_S: Final = 0.02
"""Period of the exchanges, s: well below the output watchdog of a module."""
SAFE_TRIES: Final = 5
"""Attempts to write the safe levels after a failure (assumed)."""

ENTER: Final = frozenset("\r\n")
SPACE: Final = " "


class FieldLostError(Exception):
    """Raised when the field I/O does not respond or belongs to another master; the message is one line."""


class StoppedError(Exception):
    """Raised at a request to stop the check."""


class CheckedField:
    """Field I/O and keyboard of one check.

    Attributes:
        io_map: I/O map.
        levels: Active state of every wired input by tag, as read last.
        keyboard: Terminal of the person.
        drives: True once the outputs may be written; they are then written in every exchange.
    """

    def __init__(self, link: DevicesLink, io_map: IoMap, keyboard: Keyboard, clock: Clock, stop: Stop) -> None:
        """Create the field I/O on a closed link; `step` opens it."""
        self.io_map = io_map
        self.levels: Levels = {}
        self.keyboard = keyboard
        self.drives = False
        self._link = link
        self._clock = clock
        self._stop = stop
        self._safe = io_map.safe_outputs()

    def step(self, held: Point | None = None) -> str:
        """Exchange data with the field once, then wait for keys for one period; return the keys.

        Args:
            held: Output that is on; all others are safe.

        Raises:
            FieldLostError: The exchange failed, or an output watchdog has tripped.
            StoppedError: The check must end.
            TerminalLostError: The terminal has been closed.
        """
        self.exchange(held)
        return self.keyboard.keys(PERIOD_S)

    def exchange(self, held: Point | None = None) -> None:
        """Write the outputs, if permitted, and read the inputs; see `step`."""
        if self._stop.is_set():
            raise StoppedError
        image = list(self._safe)
        if held is not None:
            image[held.number] = held.level(active=True)
        try:
            self._link.open()
            if self.drives:
                self._link.write_outputs(image)
            raw = self._link.read_inputs()
        except (OSError, OutputsTakenError) as error:
            raise FieldLostError(str(error)) from error
        if self.tripped:
            raise FieldLostError(self.tripped)
        self.levels = {point.tag: point.active(raw[point.number]) for point in self.io_map.inputs}

    @property
    def tripped(self) -> str:
        """Modules whose output watchdog has tripped since the outputs are written; empty = none."""
        return ", ".join((*self._link.tripped, *self._link.gaps)) if self.drives else ""

    def drive(self) -> str:
        """Begin to write the outputs; return the names of the modules whose output watchdog has been reset.

        Nothing has been written before, so that a watchdog may have tripped. Opening the link again shows it.

        Raises:
            FieldLostError: The exchange failed, or a module remains tripped.
        """
        try:
            self._link.close()
            self._link.open()
            tripped = self._link.tripped
            self._link.reset_tripped()
        except OSError as error:
            raise FieldLostError(str(error)) from error
        self.drives = True
        self.exchange()
        return ", ".join(tripped)

    def make_safe(self) -> bool:
        """Write the safe levels of all outputs and registers, also after a failure; return True if accepted."""
        if not self.drives:
            return True
        for _ in range(SAFE_TRIES):
            with contextlib.suppress(OSError):  # the devices that are connected are written although another is lost
                self._link.open()
            try:
                self._write_safe()
            except OutputsTakenError:
                return False
            except OSError:
                self._stop.wait(PERIOD_S)
            else:
                return True
        return False

    def _write_safe(self) -> None:
        try:
            self._link.write_outputs(self._safe)
        finally:
            if self.io_map.registers:
                self._link.write_registers(self.io_map.safe_registers())

    def ask(self, text: str, answers: str) -> str:
        """Print a question and return one of the permitted keys, Enter as a line feed.

        Keys that were pressed before the question do not count.
        """
        self.step()
        self.keyboard.show(text)
        while True:
            for key in self.step():
                answer = "\n" if key in ENTER else key.lower()
                if answer in answers:
                    self.exchange()  # the levels at the time of the answer
                    return answer

    def line(self, text: str) -> str:
        """Print a question and return the line typed."""
        self.keyboard.show(text)
        typed = ""
        while True:
            for key in self.step():
                if key in ENTER:
                    return typed.strip()
                typed = typed[:-1] if key in "\x7f\b" else typed + key

    def hold(self, point: Point, permitted: Callable[[], str | None], decided: Callable[[list[Change]], bool]) -> Held:
        """Keep an output on while SPACE is held, until another key ends the attempt.

        Args:
            point: Output.
            permitted: Function that returns the reason for which the output must be off, or None.
            decided: Function that returns True once the changes of the inputs are conclusive; the output then goes off.

        Returns:
            Key that ended the attempt, whether the output was on, and the changes of the inputs while it was on.
        """
        lease, changes, reason, was_on = HoldToRun(), list[Change](), "", False
        before = before_hold = self.levels
        while True:
            now_ms = self._clock.now_ms()
            on = lease.is_on(now_ms)
            if on and (why := permitted()) is not None:
                lease.end()
                on, reason = False, why
            if on and not was_on:
                was_on, before_hold = True, self.levels
            keys = self.step(point if on else None)
            changes += _changes(before, self.levels) if was_on else []
            before = self.levels
            if was_on and decided(changes):
                return Held("reacted", before_hold, changes, was_on=True)
            if reason:
                return Held(reason, before_hold, changes, was_on=was_on)
            other = keys.replace(SPACE, "")
            if other:
                return Held("\n" if other[0] in ENTER else other[0].lower(), before_hold, changes, was_on=was_on)
            if keys:
                lease.press(self._clock.now_ms())

    def watch(self, for_ms: int) -> tuple[Levels, list[Change]]:
        """Return the levels at the begin and all changes within a time with all outputs safe."""
        self.step()
        first = before = self.levels
        changes: list[Change] = []
        until_ms = self._clock.now_ms() + for_ms
        while self._clock.now_ms() < until_ms:
            self.step()
            changes += _changes(before, self.levels)
            before = self.levels
        return first, changes


class Held:
    """End of an attempt to switch an output on.

    Attributes:
        end: Key that ended it, ``reacted``, or the text key of a reason.
        before: Active states of the inputs before the output was on.
        changes: Changes of the inputs since then.
        was_on: True if the output was on.
    """

    def __init__(self, end: str, before: Levels, changes: list[Change], *, was_on: bool) -> None:
        self.end = end
        self.before = before
        self.changes = changes
        self.was_on = was_on


def _changes(before: Levels, after: Levels) -> list[Change]:
    return [(tag, active) for tag, active in after.items() if before.get(tag) != active]
