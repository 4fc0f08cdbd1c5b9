"""Live progress of a trial: a self-updating display on a terminal, plain lines otherwise."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.table import Table

from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.twin.ending.reported import ReportedEvents

LINE_EVERY_S = 5.0
ROWS_A_TRAY = 6


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
        return f"{self.elapsed_s:7.1f} s  {self.news()}"

    def news(self) -> str:
        """Return the line without its time."""
        alarm = f"  ALARM {self.alarm}" if self.alarm else ""
        return (
            f"{self.state:12} trays {self.tray}  rows {self.rows}  in cups {self.in_cups}/{self.seedlings}  "
            f"lost {self.lost}{alarm}"
        )


def progress_of(reported: ReportedEvents, counts: SeedlingCounts, *, elapsed_s: float, trays: int) -> ProgressState:
    """Return the progress of a trial.

    Args:
        reported: Events of the controller.
        counts: Location of the seedlings.
        elapsed_s: Machine time, s.
        trays: Number of trays.
    """
    return ProgressState(
        elapsed_s=elapsed_s,
        state=reported.state_text,
        tray=f"{reported.trays_done}/{trays}",
        rows=f"{reported.rows}/{ROWS_A_TRAY * trays}",
        in_cups=counts.in_cups,
        lost=counts.P + counts.D + counts.T,
        seedlings=counts.total,
        alarm=reported.alarm_line,
    )


class ProgressView:
    """Progress display: live on a terminal, otherwise lines.

    There is a line at each change of state, tray, row or alarm, and at most every 5 s at another change; equal lines
    are not repeated.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False) if self._console.is_terminal else None
        self._shown: tuple[str, str, str, str] | None = None
        self._line = ""
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
        is_due = key != self._shown or progress.elapsed_s - self._shown_at_s >= LINE_EVERY_S
        if is_due and progress.news() != self._line:
            self._shown, self._line, self._shown_at_s = key, progress.news(), progress.elapsed_s
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
