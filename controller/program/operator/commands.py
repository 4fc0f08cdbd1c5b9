"""Command table: operator commands that are not wired to an input, as M bits that are on for one scan."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from controller.core.expr import Bit
from controller.core.rungs import ZoneReset
from controller.program.areas import Area
from controller.program.states import Mode

ANSWER: Final = "answer"
"""Command group for answers to questions."""
TRAY_ROWS: Final = (1, 2, 3)
"""Rows of a tray on the side of one arm, in the order in which it picks them."""
JOG_LEASE_MS: Final = 300
"""Timeout of a jog command that is not renewed, ms."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command.

    Attributes:
        name: Name in panels, Modbus tag lists and tests.
        number: Number in the refusal registers.
        bit: M bit that is on for one scan when the command is given.
        meaning: Description of the effect.
        group: Key in `texts.operator.ORDERS` of the name used in refusals.
        packml: Number of the PackML command (docs/sources/fx2n.md 5), or None.
    """

    name: str
    number: int
    bit: Bit
    meaning: str
    group: str
    packml: int | None = None


class Commands:
    """All commands, accessible by attribute and by name."""

    def __init__(self) -> None:
        self._area = Area("M", 400, 469, "command")
        self._table: list[Command] = []
        self.reset = self._add("reset", "reset alarms; home unless in manual mode", 1)
        self.start = self._add("start", "start; in Suspended, search for a tray again", 2)
        self.stop = self._add("stop", "finish the running cycle, move home, then Stopped", 3)
        self.hold = self._add("hold", "continue the running cycle until the arms are at feed, then hold", 4)
        self.unhold = self._add("unhold", "resume after a hold", 5)
        self.suspend = self._add("suspend", "start no new row until the unsuspend command", 6)
        self.unsuspend = self._add("unsuspend", "resume after a suspend command", 7)
        self.abort = self._add(
            "abort", "all outputs off, as in an emergency stop; not a substitute for the emergency stop", 8
        )
        self.clear = self._add("clear", "leave Aborted after the emergency stop is released", 9)
        self.complete = self._add("complete", "start no new row, release the loaded rows, then Complete", 10)
        self.modes: dict[Mode, Bit] = {
            mode: self._add(
                f"mode_{mode.name.lower()}", f"change the mode to {mode.name.lower().replace('_', ' ')}", group="mode"
            )
            for mode in Mode
        }
        self.step = self._add("step", "step mode: execute the next transfer of the selected sequence")
        self.acknowledge = self._add("acknowledge", "silence the horn")
        self.cups_empty = self._add("cups_empty", "answer: the cups under the claws are empty", group=ANSWER)
        self.tray_same = self._add("tray_same", "answer: the stored tray is at the pick position", group="answer")
        self.tray_full = self._add("tray_full", "answer: a full tray is at the pick position", group=ANSWER)
        self.tray_none = self._add(
            "tray_none", "answer: no usable tray; convey out any tray and feed the next one", group=ANSWER
        )
        self.count_reset = self._add("count_reset", "reset the counts of trays, cycles and missed cups", group="count")
        self.loaded_yes: dict[str, Bit] = {}
        self.loaded_no: dict[str, Bit] = {}
        self.discard: dict[str, Bit] = {}
        for side in ("left", "right"):
            self.loaded_yes[side] = self._add(f"{side}_loaded_yes", "answer: the arm holds seedlings", group="answer")
            self.loaded_no[side] = self._add(
                f"{side}_loaded_no", "answer: the arm holds no seedlings; its row is full", group="answer"
            )
            self.discard[side] = self._add(f"{side}_discard", "discard the load over the cups", group="discard")
        self.jog_release = self._add("jog_release", "end jogging", group="jog")
        self.jog: dict[str, Bit] = {
            output: self._add(
                f"jog_{output.replace('.', '_')}",
                f"manual mode: jog {output.replace('.', ' ').replace('_', ' ')}; renew within {JOG_LEASE_MS} ms",
                group="jog",
            )
            for output in JOGGED
        }
        self._add_ways_out()

    def _add_ways_out(self) -> None:
        """Add the commands for part-filled trays, arms out of service, emptying the line and new memory."""
        self.row_empty: dict[str, dict[int, Bit]] = {
            side: {
                row: self._add(
                    f"{side}_row_{row}_empty", "the row of the tray in place is empty: do not pick it", group="rows"
                )
                for row in TRAY_ROWS
            }
            for side in ("left", "right")
        }
        self.rows_full = self._add("rows_full", "all rows of the tray in place are full", group="rows")
        self.out_of_service: dict[str, Bit] = {}
        self.in_service: dict[str, Bit] = {}
        for side in ("left", "right"):
            self.out_of_service[side] = self._add(
                f"{side}_out_of_service",
                "the arm stays at feed and is not driven; its rows stay in the tray",
                group="service",
            )
            self.in_service[side] = self._add(f"{side}_in_service", "the arm works again", group="service")
        self.empty_line = self._add(
            "empty_line", "release the loaded rows, convey the tray out, feed no other one, then Complete"
        )
        self.new_machine = self._add(
            "new_machine",
            "the lost memory is that of a new machine: no tray is in use; homing conveys any tray out, and feeds one",
        )

    def _add(self, name: str, meaning: str, packml: int | None = None, *, group: str = "") -> Bit:
        bit = self._area.bit(name, meaning)
        self._table.append(Command(name, 1 + len(self._table), bit, meaning, group or name, packml))
        return bit

    def __iter__(self) -> Iterator[Command]:
        return iter(self._table)

    def __getitem__(self, name: str) -> Bit:
        """Return the bit of a command.

        Raises:
            KeyError: The command is unknown.
        """
        for command in self._table:
            if command.name == name:
                return command.bit
        known = ", ".join(command.name for command in self._table)
        raise KeyError(f"unknown command {name!r}; known: {known}")

    def numbered(self, number: int) -> Command:
        """Return the command with this number."""
        return self._table[number - 1]

    def consumed(self) -> ZoneReset:
        """Return the rung that resets every command bit at the end of the scan."""
        return ZoneReset(self._table[0].bit, self._table[-1].bit)


ARM_OUTPUTS: Final = (
    "lift_extend",
    "lift_retract",
    "slide_inward",
    "slide_outward",
    "converge",
    "spread",
    "claws_open",
    "claws_close",
)
JOGGED: Final = (*(f"{side}.{output}" for side in ("left", "right") for output in ARM_OUTPUTS), "tray_run")
"""Outputs that can be jogged; value 1 of the jog register selects the first."""
