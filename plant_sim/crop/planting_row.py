"""Row of cups: falling plugs, occupied cups, and cups that have passed the claws."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from controller.common.saved import Saved
from plant_sim.crop.incident import Incident, Report
from plant_sim.crop.seedling import CELLS_ALONG, Location, Seedling, Seedlings

RECENT_CUPS = 24
"""Number of passed cups of each row that `PlantingRow.recent` contains."""


class PassedCup(NamedTuple):
    """Content with which a cup has passed the last claw.

    A plug that drifts into a cup beyond the last claw gives a second entry with the same number; the cup then contains
    the seedlings of both.

    Attributes:
        cup: Number of the cup.
        seedlings: Number of seedlings in the cup; two if a plug has fallen into an occupied cup.
        cause: Loss of the seedling that was intended for an empty cup; None if none was intended for it.
    """

    cup: int
    seedlings: int
    cause: Location | None = None


@dataclass(slots=True)
class _Fall:
    seedling: Seedling
    position_m: float
    lands_s: float
    drift_m: float
    across_m: float


class PlantingRow(Saved):
    """Contents of the cups in one row; cup n is at the chain travel minus n pitches.

    A cup that has passed the last claw is no longer tracked; its seedling still counts as being in a cup. The second
    seedling in a cup has no cup of its own and therefore counts as lost while throwing, although it remains in the cup.

    Attributes:
        falling: True while a plug is in the air.
        missed_cups: Cups that passed empty between the first and the last filled cup.
        passed: Cups that have passed the last claw since the observer last cleared the list; None if there is no
            observer.
        recent: The latest `RECENT_CUPS` cups that have passed the last claw, in order.
        off_m: Offset of the cups from the claws at the last landing, m.
    """

    SAVED = (
        "_causes",
        "_contents",
        "_empty_since_filled",
        "_falls",
        "_last_passed",
        "_leaves_at_m",
        "_losses",
        "missed_cups",
        "off_m",
        "passed",
        "recent",
    )

    __slots__ = (*SAVED, "_catch_m", "_pitch_m", "_report", "_seedlings", "_side")

    def __init__(self, side: str, seedlings: Seedlings, report: Report, *, pitch_m: float, catch_m: float) -> None:
        """Initialise with empty cups.

        Args:
            side: Name of the row in reports.
            seedlings: All seedlings.
            report: Callback for incidents.
            pitch_m: Distance from cup to cup, m.
            catch_m: Largest distance from the centre of a cup at which a plug still falls into it, m.
        """
        self._side = side
        self._seedlings = seedlings
        self._report = report
        self._pitch_m = pitch_m
        self._catch_m = catch_m
        self._falls: list[_Fall] = []
        self._losses: list[_Fall] = []
        self._contents: dict[int, int] = {}
        self._causes: dict[int, Location] = {}
        self._last_passed = -CELLS_ALONG  # latest cup past the last claw
        self._leaves_at_m = self._leaving_m(self._last_passed + 1)
        self._empty_since_filled: int | None = None
        self.missed_cups = 0
        self.passed: list[PassedCup] | None = None
        self.recent: deque[PassedCup] = deque(maxlen=RECENT_CUPS)
        self.off_m = 0.0

    @property
    def filled(self) -> list[int]:
        """Numbers of the filled cups that have not yet passed the last claw, in order."""
        return sorted(self._contents)

    @property
    def filled_cups(self) -> Iterator[int]:
        """Cups that contain a plug and are not further than `RECENT_CUPS` past the last claw."""
        yield from self._contents
        yield from (each.cup for each in self.recent if each.seedlings)

    @property
    def falling(self) -> bool:
        """True while a plug is in the air."""
        return bool(self._falls)

    @property
    def leaves_at_m(self) -> float:
        """Chain travel at which the next cup passes the last claw, m."""
        return self._leaves_at_m

    @property
    def lands_s(self) -> float:
        """Plant time of the next landing, s; infinite if no plug is in the air."""
        return min((fall.lands_s for fall in (*self._falls, *self._losses)), default=math.inf)

    def start_fall(
        self, seedling: Seedling, *, position_m: float, lands_s: float, drift_m: float = 0.0, across_m: float = 0.0
    ) -> None:
        """Start the fall of a seedling towards the cups.

        Args:
            seedling: The seedling.
            position_m: Position along the row, measured from claw 0, m.
            lands_s: Time of landing, s.
            drift_m: Offset of the landing position along the row, m.
            across_m: Offset of the landing position across the row, m.
        """
        self._seedlings.move(seedling, Location.FALLING)
        self._falls.append(_Fall(seedling, position_m, lands_s, drift_m, across_m))

    def note_loss(self, seedling: Seedling, *, position_m: float, lands_s: float) -> None:
        """Note that a cup remains empty because its seedling has been lost before the throw.

        Args:
            seedling: The lost seedling.
            position_m: Position of its claw along the row, measured from claw 0, m.
            lands_s: Time at which the seedling would have landed, s.
        """
        self._losses.append(_Fall(seedling, position_m, lands_s, 0.0, 0.0))

    def step(self, now_s: float, *, chain_m: float, chain_m_s: float) -> None:
        """Process landings and cups that have passed the last claw.

        Args:
            now_s: Plant time, s.
            chain_m: Chain travel, m.
            chain_m_s: Latest chain speed, m/s.
        """
        if self._falls or self._losses:
            self._fall(now_s, chain_m, chain_m_s)
        while chain_m >= self._leaves_at_m:
            self._leave()

    def _fall(self, now_s: float, chain_m: float, chain_m_s: float) -> None:
        still: list[_Fall] = []
        for fall in self._falls:
            if fall.lands_s > now_s:
                still.append(fall)
            else:
                self._land(fall, chain_m - chain_m_s * (now_s - fall.lands_s))
        self._falls = still
        for loss in self._losses:
            if loss.lands_s <= now_s:
                under_m = chain_m - chain_m_s * (now_s - loss.lands_s) - loss.position_m
                self._causes[round(under_m / self._pitch_m)] = loss.seedling.location
        self._losses = [loss for loss in self._losses if loss.lands_s > now_s]

    def _land(self, fall: _Fall, chain_m: float) -> None:
        under_m = chain_m - fall.position_m
        intended = round(under_m / self._pitch_m)
        self.off_m = under_m - intended * self._pitch_m
        way_m = under_m - fall.drift_m
        cup = round(way_m / self._pitch_m)
        location = Location.LOST_THROW
        if math.hypot(way_m - cup * self._pitch_m, fall.across_m) <= self._catch_m:
            if self._catch(cup):
                location = Location.IN_CUP
            else:
                text = f"{self._side} cup {cup} received a second plug"
                self._report(Incident.DOUBLE, text)
        if location is not Location.IN_CUP or cup != intended:
            self._causes[intended] = Location.LOST_THROW
        self._seedlings.move(fall.seedling, location)

    def _catch(self, cup: int) -> bool:
        """Add a plug to a cup; return True if the cup was empty."""
        if cup <= self._last_passed:
            if self.passed is not None:
                self.passed.append(PassedCup(cup, 1))
            return True
        self._contents[cup] = self._contents.get(cup, 0) + 1
        return self._contents[cup] == 1

    def _leaving_m(self, cup: int) -> float:
        """Return the chain travel at which a cup is out of reach of the last claw, m."""
        return (cup + CELLS_ALONG - 0.5) * self._pitch_m

    def _leave(self) -> None:
        self._last_passed += 1
        self._leaves_at_m = self._leaving_m(self._last_passed + 1)
        seedlings = self._contents.pop(self._last_passed, 0)
        cause = self._causes.pop(self._last_passed, None)
        cup = PassedCup(self._last_passed, seedlings, None if seedlings else cause)
        self.recent.append(cup)
        if self.passed is not None:
            self.passed.append(cup)
        if seedlings:
            self.missed_cups += self._empty_since_filled or 0
            self._empty_since_filled = 0
        elif self._empty_since_filled is not None:
            self._empty_since_filled += 1
