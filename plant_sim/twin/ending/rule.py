"""Rule by which every kind of trial ends: in processes, in lock step, and with an FX program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

REST_LIMIT_MS: Final = 10_000
"""Time for which a machine rests before a trial without an operator ends, ms."""
LOOK_MS: Final = 100
"""Period in which a trial that can end without the machine is looked at, ms: by a request to stop, or with its last
seedling."""
HOMING_LIMIT_MS: Final = 60_000
TRAY_LIMIT_MS: Final = 600_000
"""Time limit per tray, ms; at 20 plants per minute per row a tray takes 108 s."""
INTERRUPTED: Final = "interrupted"
"""Reason of a trial that was ended by Ctrl-C or SIGTERM."""


@dataclass(frozen=True, slots=True)
class Rest:
    """Rest of a machine that only an operator can end.

    Attributes:
        since_ms: Begin of the rest, ms.
        text: State, and alarms and questions, if any.
    """

    since_ms: int
    text: str


@dataclass(frozen=True, slots=True)
class TrialEnd:
    """End of a trial.

    Attributes:
        at_ms: Machine time of the end, ms; None = the time at which it is noticed.
        reason: Reason for an incomplete trial; empty if it completed.
    """

    at_ms: int | None
    reason: str


def nobody() -> bool:
    """Return False: there is no operator."""
    return False


def default_max_ms(trays: int) -> int:
    """Return the machine time after which a trial with this number of trays ends, ms."""
    return HOMING_LIMIT_MS + TRAY_LIMIT_MS * trays


@dataclass(slots=True)
class EndingRule:
    """Rule by which a trial ends.

    It ends when the machine is complete; or after `REST_LIMIT_MS` of rest if no operator is there; or at its time
    limit.

    Attributes:
        max_ms: Longest machine time, ms; None = no limit.
        attended: Function that returns True while an operator is there, who may answer.
    """

    max_ms: int | None
    attended: Callable[[], bool] = nobody
    _there_ms: int = 0

    def ending(self, now_ms: int, *, complete: bool, rest: Rest | None, state: str) -> TrialEnd | None:
        """Return the end of a trial; None if it goes on.

        Args:
            now_ms: Machine time, ms.
            complete: True if the machine is complete.
            rest: Rest of the machine; None if it works, or waits for something that comes by itself.
            state: State of the machine, for the reason.
        """
        if complete:
            return TrialEnd(None, "")
        if rest is not None and now_ms >= rest.since_ms + REST_LIMIT_MS:
            if not self.attended():
                at_ms = max(rest.since_ms + REST_LIMIT_MS, self._there_ms)
                return TrialEnd(at_ms, f"{rest.text}; no operator after {REST_LIMIT_MS // 1000} s")
            self._there_ms = now_ms
        if self.max_ms is not None and now_ms >= self.max_ms:
            return TrialEnd(self.max_ms, f"not complete after {self.max_ms / 1000:g} s of machine time: {state}")
        return None

    def next_look_ms(self, now_ms: int, rest: Rest | None, *, by_machine_only: bool = False) -> int:
        """Return the next time at which the trial may end, ms.

        A rest that begins after a look ends the trial no sooner than `REST_LIMIT_MS` later. A trial that only its
        machine can end is therefore looked at in this period.

        Args:
            now_ms: Machine time, ms.
            rest: Rest of the machine.
            by_machine_only: True if only completion, rest and time limit can end the trial.
        """
        period_ms = REST_LIMIT_MS if by_machine_only else LOOK_MS
        times_ms = [now_ms + period_ms - now_ms % period_ms]
        times_ms += [] if rest is None else [rest.since_ms + REST_LIMIT_MS]
        times_ms += [] if self.max_ms is None else [self.max_ms]
        return min(time_ms for time_ms in times_ms if time_ms > now_ms)
