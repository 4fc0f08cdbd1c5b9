"""A row of cups as the seedlings see it: falling in, sitting there, leaving for the soil."""

import math
from dataclasses import dataclass

from plant_sim.crop.incident import Incident, Report
from plant_sim.crop.seedling import CELLS_ALONG, Place, Seedling, Seedlings


@dataclass(slots=True)
class _Fall:
    seedling: Seedling
    position_m: float
    lands_s: float
    drift_m: float
    across_m: float


class PlantingRow:
    """What each cup of one row holds. Cup n stands at the way of the chain minus n pitches.

    A cup that has left the last claw is gone; whatever it held stays counted as in a cup.

    Attributes:
        falling: Whether anything is in the air.
        missed_cups: Cups that left empty between the first and the last that left filled.
        off_m: How far the cups were off the claws when the last plug came down, m.
    """

    __slots__ = (
        "_catch_m",
        "_empty_since_filled",
        "_falls",
        "_gone",
        "_holds",
        "_leaves_at_m",
        "_pitch_m",
        "_report",
        "_seedlings",
        "_side",
        "missed_cups",
        "off_m",
    )

    def __init__(self, side: str, seedlings: Seedlings, report: Report, *, pitch_m: float, catch_m: float) -> None:
        """Start with empty cups.

        Args:
            side: Name of the row in reports.
            seedlings: All of them.
            report: Takes note of incidents.
            pitch_m: From cup to cup, m.
            catch_m: How far off its centre a plug still goes into a cup, m.
        """
        self._side = side
        self._seedlings = seedlings
        self._report = report
        self._pitch_m = pitch_m
        self._catch_m = catch_m
        self._falls: list[_Fall] = []
        self._holds: dict[int, Seedling] = {}
        self._gone = -CELLS_ALONG  # newest cup that is past the last claw
        self._leaves_at_m = self._leaving_m(self._gone + 1)
        self._empty_since_filled: int | None = None
        self.missed_cups = 0
        self.off_m = 0.0

    @property
    def falling(self) -> bool:
        """Whether anything is in the air."""
        return bool(self._falls)

    def let_fall(
        self, seedling: Seedling, *, position_m: float, lands_s: float, drift_m: float = 0.0, across_m: float = 0.0
    ) -> None:
        """Let a seedling fall towards the cups; nothing stops it.

        Args:
            seedling: The seedling.
            position_m: Where along the row, m from claw 0.
            lands_s: When it comes down, s.
            drift_m: How far past that place it comes down, m.
            across_m: How far beside the row, m.
        """
        self._seedlings.move(seedling, Place.FALLING)
        self._falls.append(_Fall(seedling, position_m, lands_s, drift_m, across_m))

    def step(self, now_s: float, *, chain_m: float, chain_m_s: float) -> None:
        """Take note of what has come down and of which cups have left.

        Args:
            now_s: Time, s.
            chain_m: Way the chain has gone, m.
            chain_m_s: How fast it went of late, m/s.
        """
        if self._falls:
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

    def _land(self, fall: _Fall, chain_m: float) -> None:
        under_m = chain_m - fall.position_m
        self.off_m = under_m - round(under_m / self._pitch_m) * self._pitch_m
        way_m = under_m - fall.drift_m
        cup = round(way_m / self._pitch_m)
        place = Place.LOST_THROW
        if math.hypot(way_m - cup * self._pitch_m, fall.across_m) <= self._catch_m:
            if cup in self._holds:
                text = f"{self._side} cup {cup} got a second plug"
                self._report(Incident.DOUBLE, text)
            else:
                self._holds[cup] = fall.seedling
                place = Place.IN_CUP
        self._seedlings.move(fall.seedling, place)

    def _leaving_m(self, cup: int) -> float:
        """Way of the chain at which a cup is out of reach of the last claw, m."""
        return (cup + CELLS_ALONG - 0.5) * self._pitch_m

    def _leave(self) -> None:
        self._gone += 1
        self._leaves_at_m = self._leaving_m(self._gone + 1)
        if self._holds.pop(self._gone, None) is not None:
            self.missed_cups += self._empty_since_filled or 0
            self._empty_since_filled = 0
        elif self._empty_since_filled is not None:
            self._empty_since_filled += 1
