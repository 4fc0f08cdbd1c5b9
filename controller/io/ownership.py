"""Ownership of the outputs by this controller: detection of another master, and what follows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Protocol

from controller.common.saved import Saved
from controller.io.link import OutputsTakenError

FREE_MS: Final = 500
"""Time without another master after which outputs that were taken over count as free, ms (assumed): five times the
output watchdog of the plant."""
RIVAL_MS: Final = 1_000
"""Duration of the warning about a refused write of another master, ms (assumed)."""


class OutputGuard(Protocol):
    """Detection of another master; every method may raise `OSError`, after which the link is closed."""

    def mismatch(self, written: Sequence[bool]) -> str:
        """Return how the outputs differ from the image written last; empty if they do not."""

    def holder(self, safe: Sequence[bool]) -> str:
        """Return who holds the outputs while this controller does not write them; empty if nobody does."""

    def rival(self) -> str:
        """Return the number and the address of refused writes by other masters; empty if unknown."""


class OutputOwnership(Saved):
    """Ownership of the outputs.

    After a takeover nothing is written until the other master has been absent for `FREE_MS` and the operator has
    cleared the abort: two masters that both wrote would switch the outputs on and off.

    Attributes:
        taken: Reason for which the outputs are left to another master; empty = they belong to this controller.
        rival: Number and address of refused writes by other masters; empty = none known.
    """

    SAVED = ("_expected", "_foreign_ms", "_rival_ms", "rival", "taken")

    def __init__(self, guard: OutputGuard | None, safe: Sequence[bool]) -> None:
        """Create an ownership that belongs to this controller.

        Args:
            guard: Detection of another master; None = none.
            safe: Safe Y image.
        """
        self.taken = ""
        self.rival = ""
        self.guard = guard
        self._safe = safe
        self._expected: Sequence[bool] | None = None
        """Image that the module has confirmed last; None if it is uncertain."""
        self._foreign_ms = 0
        """Time at which another master was last seen."""
        self._rival_ms: int | None = None
        """Time at which the last write of another master was refused."""

    def status(self, now_ms: int) -> tuple[bool, bool]:
        """Return whether another master has the outputs, and whether one was refused a short time ago."""
        return (
            bool(self.taken) and now_ms - self._foreign_ms < FREE_MS,
            self._rival_ms is not None and now_ms - self._rival_ms < RIVAL_MS,
        )

    def write(
        self, now_ms: int, write: Callable[[], Sequence[bool]], make_safe: Callable[[], None], *, aborted: bool
    ) -> None:
        """Write the outputs unless another master has them; after its write, write the safe state once, then nothing.

        Args:
            now_ms: Time, ms.
            write: Function that writes the released outputs and returns their Y image.
            make_safe: Function that releases the safe state instead.
            aborted: True until the operator has cleared the abort.

        Raises:
            OSError: The field I/O failed.
        """
        if self.taken and not self._regained(now_ms, aborted=aborted):
            return
        reason = "" if self.guard is None or self._expected is None else self.guard.mismatch(self._expected)
        if reason:
            make_safe()
        try:
            image = write()
        except OutputsTakenError as taken:
            make_safe()
            self.lose(reason or str(taken), now_ms)
            return
        if reason:
            self.lose(reason, now_ms)
        elif self.guard is not None:
            self._expected = list(image)
            self._note_rival(now_ms, self.guard.rival())

    def _regained(self, now_ms: int, *, aborted: bool) -> bool:
        """Return True once the outputs are free and the abort is cleared; the image of that scan is still safe."""
        if self.guard is not None and self.guard.holder(self._safe):
            self._foreign_ms = now_ms
        if aborted or now_ms - self._foreign_ms < FREE_MS:
            return False
        self.taken, self.rival = "", ""
        return True

    def _note_rival(self, now_ms: int, rival: str) -> None:
        """Note the refused writes of others; the first reading contains those of the past."""
        if rival != self.rival:
            if self.rival:
                self._rival_ms = now_ms
            self.rival = rival

    def lose(self, reason: str, now_ms: int) -> None:
        """Leave the outputs to another master."""
        self.taken, self._foreign_ms, self._expected = reason, now_ms, None

    def doubt(self) -> None:
        """Note that the outputs are uncertain: a write may have been executed although its answer is missing."""
        self._expected = None
