"""Trays near the pick position with the seedlings standing in them."""

from collections.abc import Iterable, Mapping

from controller.common.saved import Saved
from plant_sim.crop.seedling import CELLS_ALONG, Location, Seedling, Seedlings


class Bed(Saved):
    """Trays within reach of the claws, with their offsets from the pick position.

    Attributes:
        trays_m: Travel of the trays, m.
        is_placed: True if a tray is at the pick position.
    """

    SAVED = ("_trays", "_turned", "is_placed", "trays_m")

    __slots__ = ("_pitch_m", "_seedlings", "_trays", "_turned", "is_placed", "trays_m")

    def __init__(self, seedlings: Seedlings, *, pitch_m: float) -> None:
        """Initialise an empty bed.

        Args:
            seedlings: All seedlings.
            pitch_m: Distance from cell to cell, m.
        """
        self._seedlings = seedlings
        self._pitch_m = pitch_m
        self._trays: list[tuple[int, float]] = []
        self._turned: Mapping[int, float] = {}
        self.trays_m = 0.0
        self.is_placed = False

    def lay(
        self,
        trays: Iterable[tuple[int, float]],
        *,
        trays_m: float,
        is_placed: bool,
        turned: Mapping[int, float],
    ) -> None:
        """Update after tray motion.

        Args:
            trays: Number of each tray and its offset past the pick position, m.
            trays_m: Travel of the trays, m.
            is_placed: True if a tray is at the pick position.
            turned: Angle of each skewed tray, rad.
        """
        self._turned = turned
        within_m = CELLS_ALONG * self._pitch_m
        self._trays = [tray for tray in trays if abs(tray[1]) < within_m]
        self.trays_m = trays_m
        self.is_placed = is_placed

    def thresholds(self, trays: Iterable[tuple[int, float]]) -> list[float]:
        """Return the travels of the trays at which a tray comes within reach of the claws or leaves it, m.

        Args:
            trays: Number of each tray and its offset past the pick position, m.
        """
        within_m = CELLS_ALONG * self._pitch_m
        return [self.trays_m - offset_m + side * within_m for _, offset_m in trays for side in (-1, 1)]

    @property
    def is_empty(self) -> bool:
        """True if no tray is within reach of the claws."""
        return not self._trays

    def standing(self, column: int) -> list[Seedling]:
        """Return the seedlings standing in a column within reach of the claws.

        Args:
            column: Column of the tray, 0 at the left.
        """
        return [
            seedling
            for number, offset_m in self._trays
            for seedling in self._seedlings.column(number, column)
            if seedling.location is Location.STANDING and self._is_in_reach(seedling.along, offset_m)
        ]

    def off_m(self, seedling: Seedling) -> float:
        """Return the offset of a seedling from the centre line of its column due to tray skew, m."""
        angle = self._turned.get(seedling.tray, 0.0)
        return angle * (seedling.along - (CELLS_ALONG - 1) / 2) * self._pitch_m

    def ahead_m(self, seedling: Seedling) -> float:
        """Return the distance of a seedling past its claw due to the stop position of its tray, m."""
        return next((offset_m for number, offset_m in self._trays if number == seedling.tray), 0.0)

    def _is_in_reach(self, along: int, offset_m: float) -> bool:
        """Return True if a cell is within the row of claws, given the offset of its tray past the pick position."""
        claw = along - offset_m / self._pitch_m
        return -0.5 <= claw <= CELLS_ALONG - 0.5
