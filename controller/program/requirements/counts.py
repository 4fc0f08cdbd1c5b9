"""Monitor of the counts of one arm: each load that is released is counted once, and each row has a reason to change."""

from __future__ import annotations

from collections.abc import Iterator

from controller.core.expr import Expr, Word, all_of, any_of
from controller.core.rungs import Add, Mov, Out, Rst, Rung, Set
from controller.core.specification import Requirement
from controller.program.areas import Area
from controller.program.tags import FIRST_SCAN, FULL, IN_PLACE, IN_PROGRESS, ROWS, SIDES, TAKEN, Side, Tags

BITS, WORDS = 5, 6


class CountMonitor:
    """Monitor of the releases, the cycles and the rows of one arm."""

    def __init__(self, tags: Tags, side: Side) -> None:
        index = SIDES.index(side)
        m = Area("M", 2_064 + BITS * index, 2_063 + BITS * (index + 1), f"{side} count monitor")
        d = Area("D", 7_880 + WORDS * index, 7_879 + WORDS * (index + 1), f"{side} count monitor")
        self._tags, self._arm, self._side = tags, tags.arms[side], side
        self.known = m.bit("known", "the claws have closed or opened since their state was lost")
        self.loaded = m.bit("loaded", "the arm was loaded in the previous scan")
        self.throws = m.bit("throws", "a row has been released over its cups, this scan")
        self.miscounted = m.bit("miscounted", "the cycles changed without a release, or not by one with a release")
        self.row_changed = m.bit("row changed", "the state of a row changed without a reason, this scan")
        self.cycles = d.word("cycles", "cycles in the previous scan")
        self.next_cycles = d.word("next cycles", "cycles in the previous scan, and one more")
        self.phase = d.word("phase", "phase of the tray in the previous scan")
        self.rows = {row: d.word(f"row {row}", "state of the row in the previous scan") for row in ROWS}

    @property
    def _recorded(self) -> dict[Word, Word]:
        """Registers of the program by those that record them for the next scan."""
        rows = {self.rows[row]: self._arm.rows[row] for row in ROWS}
        return {self.cycles: self._arm.cycles, self.phase: self._tags.tray.phase, **rows}

    @property
    def _full_again(self) -> Expr:
        """Condition that a new tray has arrived, or the operator states that the rows are full, this scan."""
        commands, tray = self._tags.commands, self._tags.tray
        arrives = tray.phase.equals(IN_PLACE) & (self.phase.differs(IN_PLACE) | tray.leaves)
        return any_of(arrives, commands.tray_full, commands.rows_full)

    def rungs(self, releases: Expr) -> Iterator[Rung]:
        """Yield the rungs of the monitor; they precede those that forget the load.

        Args:
            releases: Condition that the claws have opened for their dwell time over the cups of a row that they had
                closed on, this scan.
        """
        a, count, opened = self._arm, self._arm.cycles, self._arm.opened
        none_begun = all_of(*(row <= FULL for row in self.rows.values()))
        put_back = any_of(*(self.rows[row].equals(IN_PROGRESS) & a.rows[row].equals(FULL) for row in ROWS))
        put_back &= ~self._full_again
        loaded = self.loaded | self._tags.commands.loaded_yes[self._side]
        released = all_of(opened, loaded, ~put_back, count.equals(self.next_cycles))
        wrong = any_of(self.throws & count.differs(self.next_cycles), count.differs(self.cycles) & ~released)
        yield Rst(self.known, when=FIRST_SCAN & ~a.claws_known)
        yield Out(self.throws, when=all_of(releases, self.known, none_begun))
        yield Set(self.known, when=a.coils["claws_close"] | opened)
        yield Add(self.cycles, 1, self.next_cycles)
        yield Out(self.miscounted, when=all_of(wrong, ~self._tags.commands.count_reset, ~FIRST_SCAN))
        yield Out(self.row_changed, when=~FIRST_SCAN & any_of(*(self._changed(row) for row in ROWS)))
        yield Out(self.loaded, when=a.loaded)
        yield from (Mov(word, recorded) for recorded, word in self._recorded.items())

    def _changed(self, row: int) -> Expr:
        """Return the condition that the state of a row changed without its reason.

        A full row is begun with loaded claws, or stated to be empty; a row that was taken is full again in a new tray,
        or if the operator states so; only a loss of power leaves a row in doubt.
        """
        commands, now, before = self._tags.commands, self._arm.rows[row], self.rows[row]
        stated_empty = any_of(commands.tray_none, commands.new_machine, commands.row_empty[self._side][row])
        return any_of(
            all_of(before.equals(FULL), now.equals(TAKEN), ~stated_empty),
            all_of(before.equals(FULL), now.equals(IN_PROGRESS), ~self._arm.loaded),
            all_of(before.equals(TAKEN), now.equals(FULL), ~self._full_again),
            before.equals(TAKEN) & (now > FULL),
            before.differs(now) & (now > IN_PROGRESS),
        )

    def records(self) -> Expr:
        """Return the condition that the memory of the program is recorded."""
        words = all_of(*(recorded.equals(word) for recorded, word in self._recorded.items()))
        a = self._arm
        return all_of(words, self.loaded | ~a.loaded, a.loaded | ~self.loaded)

    def requirements(self) -> Iterator[Requirement]:
        """Yield the requirements about the counts of the arm."""
        yield Requirement(
            f"{self._side}: a release not counted once",
            "each row that falls into its cups is one cycle, and nothing else is",
            self.miscounted,
        )
        yield Requirement(
            f"{self._side}: a row changed without its reason",
            "a row that is full in memory and taken in the tray, or the reverse, is lost or picked twice",
            self.row_changed,
        )
