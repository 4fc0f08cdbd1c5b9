"""What lies under the arms: the trays near the pick position and what still stands in them."""

from collections.abc import Iterable, Mapping

from plant_sim.crop.seedling import CELLS_ALONG, Place, Seedling, Seedlings


class Bed:
    """Trays within reach of the claws, and how far from the pick position they are.

    Attributes:
        trays_m: Way the trays have gone, m.
        is_placed: Whether one of them stands right for picking.
    """

    __slots__ = ("_pitch_m", "_seedlings", "_trays", "_turned", "is_placed", "trays_m")

    def __init__(self, seedlings: Seedlings, *, pitch_m: float) -> None:
        """Start with nothing under the arms.

        Args:
            seedlings: All of them.
            pitch_m: From cell to cell, m.
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
        """Take note that the trays have moved.

        Args:
            trays: Number of each tray, and how far past the pick position it is, m.
            trays_m: Way the trays have gone, m.
            is_placed: Whether one of them stands right for picking.
            turned: By which angle a tray lies askew, rad, of those that do.
        """
        self._turned = turned
        within_m = CELLS_ALONG * self._pitch_m
        self._trays = [tray for tray in trays if abs(tray[1]) < within_m]
        self.trays_m = trays_m
        self.is_placed = is_placed

    @property
    def is_empty(self) -> bool:
        """Whether no tray is within reach of the claws."""
        return not self._trays

    def standing(self, column: int) -> list[Seedling]:
        """Seedlings that stand in a column within reach of the claws.

        Args:
            column: Column of the tray, 0 at the left.
        """
        return [
            seedling
            for number, offset_m in self._trays
            for seedling in self._seedlings.column(number, column)
            if seedling.place is Place.STANDING and self._is_in_reach(seedling.along, offset_m)
        ]

    def off_m(self, seedling: Seedling) -> float:
        """How far a seedling stands off the line of its column because its tray lies askew, m."""
        angle = self._turned.get(seedling.tray, 0.0)
        return angle * (seedling.along - (CELLS_ALONG - 1) / 2) * self._pitch_m

    def ahead_m(self, seedling: Seedling) -> float:
        """How far a seedling stands past its claw because of where its tray stopped, m."""
        return next((offset_m for number, offset_m in self._trays if number == seedling.tray), 0.0)

    def _is_in_reach(self, along: int, offset_m: float) -> bool:
        """Whether a cell lies within the row of claws; a tray past its place brings it forward."""
        claw = along - offset_m / self._pitch_m
        return -0.5 <= claw <= CELLS_ALONG - 0.5
