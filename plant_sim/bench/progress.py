"""Live progress of a trial on the terminal: one line that rewrites itself, or lines where there is no terminal."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.table import Table

LINE_EVERY_S = 5.0


@dataclass(frozen=True, slots=True)
class Situation:
    """What a person wants to see while it runs.

    Attributes:
        elapsed_s: Machine time, s.
        state: PackML state in words.
        tray: Trays emptied and wanted.
        rows: Rows transplanted.
        in_cups: Seedlings in cups.
        lost: Seedlings lost so far.
        seedlings: All of them.
        alarm: Text of the latest alarm that is on.
    """

    elapsed_s: float
    state: str
    tray: str
    rows: str
    in_cups: int
    lost: int
    seedlings: int
    alarm: str = ""

    def line(self) -> str:
        """Return the situation in one line."""
        alarm = f"  ALARM {self.alarm}" if self.alarm else ""
        return (
            f"{self.elapsed_s:7.1f} s  {self.state:12} trays {self.tray}  rows {self.rows}  "
            f"in cups {self.in_cups}/{self.seedlings}  lost {self.lost}{alarm}"
        )


class ProgressView:
    """Shows situations: live on a terminal, else a line at each change of state or row and every 5 s."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False) if self._console.is_terminal else None
        self._shown: tuple[str, str, str, str] | None = None
        self._shown_at_s = 0.0

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, situation: Situation) -> None:
        """Show a situation."""
        if self._live is not None:
            self._live.update(_grid(situation), refresh=True)
            return
        key = (situation.state, situation.tray, situation.rows, situation.alarm)
        if key != self._shown or situation.elapsed_s - self._shown_at_s >= LINE_EVERY_S:
            self._shown, self._shown_at_s = key, situation.elapsed_s
            self._console.print(situation.line(), highlight=False, soft_wrap=True)


def _grid(situation: Situation) -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_row("elapsed", f"{situation.elapsed_s:.1f} s")
    grid.add_row("state", situation.state)
    grid.add_row("trays", situation.tray)
    grid.add_row("rows", situation.rows)
    grid.add_row("seedlings", f"{situation.in_cups} in cups, {situation.lost} lost, of {situation.seedlings}")
    grid.add_row("alarm", situation.alarm or "none")
    return grid
