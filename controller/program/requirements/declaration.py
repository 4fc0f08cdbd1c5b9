"""Monitor of the declaration of a new machine: only unknown memory is new, only at rest, and then no tray is in use."""

from __future__ import annotations

from collections.abc import Iterator

from controller.core.expr import Expr, all_of, any_of
from controller.core.rungs import Out, Rung
from controller.core.specification import Requirement
from controller.program.areas import Area
from controller.program.tags import FIRST_SCAN, FORGOTTEN, IN_PLACE, ROWS, TAKEN, Tags


class DeclarationMonitor:
    """Monitor of the command `new_machine`, which is on when the monitor is evaluated only if it has taken effect."""

    def __init__(self, tags: Tags) -> None:
        m = Area("M", 2_074, 2_078, "declaration monitor")
        self._tags = tags
        self.unknown = m.bit("unknown", "the tray was unknown in the previous scan")
        self.moving = m.bit("moving", "the previous scan allowed motion")
        self.with_memory = m.bit("with memory", "a machine was declared new although its memory is valid, this scan")
        self.in_motion = m.bit("in motion", "a machine was declared new while it moved, this scan")
        self.in_use = m.bit(
            "in use", "a machine was declared new, and its tray is still in use or asked about, this scan"
        )

    def rungs(self) -> Iterator[Rung]:
        """Yield the rungs of the monitor; what the first scan starts from is not recorded."""
        tags, tray, machine = self._tags, self._tags.tray, self._tags.machine
        command = tags.commands.new_machine
        rows = any_of(*(arm.rows[row].differs(TAKEN) for arm in tags.arms.values() for row in ROWS))
        used = any_of(rows, tray.ask, tray.phase.equals(FORGOTTEN), tray.phase.equals(IN_PLACE))
        yield Out(self.with_memory, when=command & ~self.unknown & ~FIRST_SCAN)
        yield Out(self.in_motion, when=all_of(command, self.moving, ~FIRST_SCAN))
        yield Out(self.in_use, when=all_of(command, ~tags.commands.tray_full, used))
        yield Out(self.unknown, when=tray.phase.equals(FORGOTTEN))
        yield Out(self.moving, when=machine.motion)

    def records(self) -> Iterator[tuple[str, Expr]]:
        """Yield the invariants that the state of the program is recorded."""
        unknown, motion = self._tags.tray.phase.equals(FORGOTTEN), self._tags.machine.motion
        yield "the monitor records an unknown tray", (self.unknown | ~unknown) & (~self.unknown | unknown)
        yield "the monitor records motion for a declaration", (self.moving | ~motion) & (~self.moving | motion)

    def requirements(self) -> Iterator[Requirement]:
        """Yield the requirements about the command."""
        yield Requirement(
            "declared new with memory",
            "a machine whose memory is valid would convey out a tray that it works on",
            self.with_memory,
        )
        yield Requirement("declared new in motion", "the rows must not change under an arm that moves", self.in_motion)
        yield Requirement(
            "declared new, and a tray in use",
            "no tray that was in a new machine is picked from, and none is asked about",
            self.in_use,
        )
