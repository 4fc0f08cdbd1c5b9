"""The command table: everything an operator can order without a wire, as M bits that live one scan."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from controller.core.expr import Bit
from controller.core.rungs import ZoneReset
from controller.program.areas import Area


@dataclass(frozen=True, slots=True)
class Command:
    """One order.

    Attributes:
        name: Name for panels, Modbus tag lists and tests.
        bit: M bit that is on for one scan when the order is given.
        meaning: What it does, and when it is listened to.
    """

    name: str
    bit: Bit
    meaning: str


class Commands:
    """All commands, by attribute and by name."""

    def __init__(self) -> None:
        self._area = Area("M", 10, 49, "command")
        self._table: list[Command] = []
        self.reset = self._add("reset", "reset alarms and home (Stopped, Held, Complete)")
        self.start = self._add("start", "start (Idle); look for a tray again (Suspended)")
        self.stop = self._add("stop", "finish the running cycle, go home, Stopped")
        self.clear = self._add("clear", "leave Aborted once the emergency stop is released")
        self.acknowledge = self._add("acknowledge", "silence the horn")
        self.cups_empty = self._add("cups_empty", "confirm: the cups under the claws are empty")
        self.tray_same = self._add("tray_same", "answer: the tray remembered stands at the pick position")
        self.tray_full = self._add("tray_full", "answer: a full tray stands at the pick position")
        self.tray_none = self._add("tray_none", "answer: no usable tray; run it out and bring the next")
        self.count_reset = self._add("count_reset", "clear trays, cycles and missed cups")
        self.loaded_yes: dict[str, Bit] = {}
        self.loaded_no: dict[str, Bit] = {}
        self.discard: dict[str, Bit] = {}
        for side in ("left", "right"):
            self.loaded_yes[side] = self._add(f"{side}_loaded_yes", "answer: the arm holds the row's seedlings")
            self.loaded_no[side] = self._add(f"{side}_loaded_no", "answer: it does not; open and leave the row full")
            self.discard[side] = self._add(f"{side}_discard", "open over the cups at the next homing")

    def _add(self, name: str, meaning: str) -> Bit:
        bit = self._area.bit(name, meaning)
        self._table.append(Command(name, bit, meaning))
        return bit

    def __iter__(self) -> Iterator[Command]:
        return iter(self._table)

    def __getitem__(self, name: str) -> Bit:
        """Return the bit of a command.

        Raises:
            KeyError: There is no such command.
        """
        for command in self._table:
            if command.name == name:
                return command.bit
        known = ", ".join(command.name for command in self._table)
        raise KeyError(f"no command {name!r}; known: {known}")

    def consumed(self) -> ZoneReset:
        """Return the rung that ends every press after its scan."""
        return ZoneReset(self._table[0].bit, self._table[-1].bit)
