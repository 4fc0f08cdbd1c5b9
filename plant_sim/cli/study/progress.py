"""Progress of a study on stderr: number of completed trials and remaining time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from time import perf_counter

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

_LINES = 10


@contextmanager
def study_progress(counted: str = "trials") -> Iterator[Callable[[int, int], None]]:
    """Show the number of completed trials: a bar on a terminal, otherwise one line for each tenth of the trials.

    The remaining time is estimated from the trials completed since the first report, which may state a number of
    trials that were completed before.

    Args:
        counted: Noun in the plural, if other than trials are counted.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield TenthsProgress(counted)
        return
    columns = (TextColumn(counted), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def busy(activity: str) -> Iterator[None]:
    """Show the current activity of a study that runs no trials; no effect unless stderr is a terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield
        return
    with console.status(activity):
        yield


class TenthsProgress:
    """Progress in plain lines, one for each tenth of the trials."""

    def __init__(self, counted: str, clock_s: Callable[[], float] = perf_counter) -> None:
        """Initialise before the first report.

        Args:
            counted: Noun in the plural for what is counted.
            clock_s: Clock, s.
        """
        self._counted = counted
        self._clock_s = clock_s
        self._first: tuple[int, float] | None = None
        self._tenths = 0

    def __call__(self, done: int, total: int) -> None:
        """Print a line if another tenth is complete."""
        now_s = self._clock_s()
        if self._first is None:
            self._first = done, now_s
        tenths = done * _LINES // total
        if tenths <= self._tenths:
            return
        self._tenths = tenths
        first, since_s = self._first
        left = ""
        if first < done < total:
            left_s = (total - done) * (now_s - since_s) / (done - first)
            left = f", {timedelta(seconds=round(left_s))} left"
        sys.stderr.write(f"{done} of {total} {self._counted}{left}\n")
        sys.stderr.flush()
