"""Live progress of a trial: a self-updating display on a terminal, plain lines otherwise."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.table import Table

LINE_EVERY_S = 5.0


@dataclass(frozen=True, slots=True)
class ProgressState:
    """Progress of a trial for display.

    Attributes:
        elapsed_s: Machine time, s.
        state: Name of the PackML state.
        tray: Numbers of emptied trays and of all trays, such as "1/2".
        rows: Numbers of transplanted rows and of all rows, such as "3/12".
        in_cups: Seedlings in cups.
        lost: Seedlings lost so far.
        seedlings: Total number of seedlings.
        alarm: Texts of the active alarms.
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
        """Return the progress in one line."""
        alarm = f"  ALARM {self.alarm}" if self.alarm else ""
        return (
            f"{self.elapsed_s:7.1f} s  {self.state:12} trays {self.tray}  rows {self.rows}  "
            f"in cups {self.in_cups}/{self.seedlings}  lost {self.lost}{alarm}"
        )


class ProgressView:
    """Progress display: live on a terminal, otherwise a line at each change of state or row and every 5 s."""

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

    def show(self, progress: ProgressState) -> None:
        """Show the progress."""
        if self._live is not None:
            self._live.update(_grid(progress), refresh=True)
            return
        key = (progress.state, progress.tray, progress.rows, progress.alarm)
        if key != self._shown or progress.elapsed_s - self._shown_at_s >= LINE_EVERY_S:
            self._shown, self._shown_at_s = key, progress.elapsed_s
            self._console.print(progress.line(), highlight=False, soft_wrap=True)


def _grid(progress: ProgressState) -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_row("elapsed", f"{progress.elapsed_s:.1f} s")
    grid.add_row("state", progress.state)
    grid.add_row("trays", progress.tray)
    grid.add_row("rows", progress.rows)
    grid.add_row("seedlings", f"{progress.in_cups} in cups, {progress.lost} lost, of {progress.seedlings}")
    grid.add_row("alarm", progress.alarm or "none")
    return grid
