"""All seedlings of a run, each at exactly one location, and their trays."""

from __future__ import annotations

import enum
import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from controller.common.saved import Saved
from plant_sim.crop.traits import TYPICAL, Traits, draw_traits

CELLS_ALONG = 12
"""Number of cells of a tray in the direction of travel, and of claws per arm. Source: docs/sources/machine.md 1."""

PICK_ORDER = (0, 5, 1, 4, 2, 3)
"""Columns in the order in which both arms pick them: rows 1 to 3 of each arm, from the outside inward."""

COLUMNS = 6
"""Number of columns of cells across a tray: three pick positions for each arm. Source: docs/sources/machine.md 1."""

TRAY_CELLS = COLUMNS * CELLS_ALONG
"""Number of cells of a tray."""


class Location(enum.IntEnum):
    """Location of a seedling."""

    STANDING = 0
    CLAMPED = 1
    IN_CLAW = 2
    FALLING = 3
    IN_CUP = 4
    LOST_PICK = 5
    LOST_CARRY = 6
    LOST_THROW = 7


class Seedling:
    """One seedling; its location is changed only by `Seedlings.move`.

    Attributes:
        tray: Number of its tray.
        column: Column in the tray, 0 at the left.
        along: Cell in the column, 0 at the front edge; also the number of the claw that picks it.
        number: Number of the seedling in the order of trays, columns and cells.
    """

    __slots__ = ("_all", "along", "column", "number", "tray")

    def __init__(self, tray: int, column: int, along: int, everyone: _Population) -> None:
        """Create a seedling standing in its cell, as the next one of a population."""
        self.tray = tray
        self.column = column
        self.along = along
        self._all = everyone
        self.number = len(everyone.locations) - 1

    @property
    def location(self) -> Location:
        """Current location."""
        return self._all.locations[self.number]

    @property
    def traits(self) -> Traits:
        """Individual deviations."""
        return self._all.traits[self.number]

    @traits.setter
    def traits(self, traits: Traits) -> None:
        self._all.traits[self.number] = traits

    def place(self, location: Location) -> None:
        """Set the location; called only by `Seedlings.move`."""
        self._all.locations[self.number] = location


class _Population(Saved):
    """Locations and traits of all seedlings."""

    SAVED = ("locations", "ploughed", "traits")

    __slots__ = ("locations", "ploughed", "traits")

    def __init__(self) -> None:
        self.ploughed: set[int] = set()
        self.locations: list[Location] = []
        self.traits: list[Traits] = []

    def sow(self, tray: int, draws: random.Random) -> list[list[Seedling]]:
        """Return the columns of a new tray with seedlings whose traits are drawn at random."""
        return [[self._grow(tray, column, along, draws) for along in range(CELLS_ALONG)] for column in range(COLUMNS)]

    def _grow(self, tray: int, column: int, along: int, draws: random.Random) -> Seedling:
        self.locations.append(Location.STANDING)
        self.traits.append(draw_traits(draws))
        return Seedling(tray, column, along, self)


@dataclass(frozen=True, slots=True)
class SeedlingCounts:
    """Number of seedlings by location; the first six numbers always add up to the total.

    Attributes:
        in_tray: In a cell, gripped or not.
        in_claw: Out of the cell, in a claw or falling from it.
        in_cups: In a cup.
        P: Lost while picking.
        D: Lost while carrying.
        T: Lost while throwing.
        total: All seedlings.
        ploughed: Those in a cell through which an arm has been driven; they are contained in `in_tray`.
    """

    in_tray: int
    in_claw: int
    in_cups: int
    P: int
    D: int
    T: int
    total: int
    ploughed: int = 0


class Seedlings(Saved):
    """All seedlings of a run, in trays of 6 columns with 12 cells each.

    The traits of a seedling depend only on the seed, its tray and its cell, not on its handling.

    Attributes:
        total: Number of seedlings.
        move_count: Number of moves so far.
        moves: Moves recorded since the recorder last cleared the list; None if there is no recorder.
    """

    SAVED = ("_at", "move_count", "total")
    _IN_TRAY = (Location.STANDING, Location.CLAMPED)

    def __init__(self, *, trays: int, seed: int) -> None:
        """Create the seedlings of all trays.

        Args:
            trays: Number of trays.
            seed: Seed of the run.
        """
        self._seed = seed
        self.moves: list[tuple[Seedling, Location]] | None = None
        self.move_count = 0
        self._population = _Population()
        self._trays = [self._population.sow(tray, random.Random(f"seed {seed}, tray {tray}")) for tray in range(trays)]
        self._at = [0] * len(Location)
        self._at[Location.STANDING] = self.total = trays * TRAY_CELLS

    def save(self) -> Any:
        """Return the current state, without recorded moves."""
        return super().save(), self._population.save(), [[*map(list.copy, tray)] for tray in self._trays]

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, population, trays = saved
        super().restore(own)
        self._population.restore(population)
        self._trays = [[*map(list.copy, tray)] for tray in trays]

    def __iter__(self) -> Iterator[Seedling]:
        return (plant for tray in self._trays for column in tray for plant in column)

    @property
    def trays(self) -> int:
        """Number of trays."""
        return len(self._trays)

    def empty_cells(self, tray: int) -> int:
        """Return the number of empty cells in a tray."""
        return TRAY_CELLS - sum(len(column) for column in self._trays[tray])

    def leave_out(self, tray: int, cells: int) -> None:
        """Remove the seedlings from randomly selected cells of a tray; the other seedlings retain their traits.

        Args:
            tray: Tray number; the tray must be untouched.
            cells: Number of additional empty cells.
        """
        columns = self._trays[tray]
        sown = [seedling for column in columns for seedling in column]
        for seedling in random.Random(f"seed {self._seed}, tray {tray}, empty cells").sample(sown, cells):
            columns[seedling.column].remove(seedling)
        self._at[Location.STANDING] -= cells
        self.total -= cells

    def fill_in_pick_order(self, tray: int, seedlings: int) -> None:
        """Remove the seedlings of a tray from the cells that are picked last, so that the given number remains.

        Args:
            tray: Tray number; the tray must be full and untouched.
            seedlings: Number of remaining seedlings.
        """
        for place, column in enumerate(PICK_ORDER):
            del self._trays[tray][column][max(0, seedlings - place * CELLS_ALONG) :]
        self._at[Location.STANDING] -= TRAY_CELLS - seedlings
        self.total -= TRAY_CELLS - seedlings

    def make_typical(self) -> None:
        """Give every seedling typical traits; a typical seedling does not fail if the motion is correct."""
        for seedling in self:
            seedling.traits = TYPICAL

    def column(self, tray: int, column: int) -> list[Seedling]:
        """Return the seedlings of one column, front edge first, at any location."""
        return self._trays[tray][column]

    def move(self, seedling: Seedling, location: Location) -> None:
        """Move a seedling to another location."""
        self.move_count += 1
        self._at[seedling.location] -= 1
        self._at[location] += 1
        seedling.place(location)
        if self.moves is not None:
            self.moves.append((seedling, location))

    def plough(self, seedling: Seedling) -> None:
        """Note that an arm has been driven through a standing seedling."""
        self._population.ploughed.add(seedling.number)

    def counts(self) -> SeedlingCounts:
        """Return the number of seedlings by location."""
        at, everyone = self._at, self._population
        return SeedlingCounts(
            in_tray=at[Location.STANDING] + at[Location.CLAMPED],
            in_claw=at[Location.IN_CLAW] + at[Location.FALLING],
            in_cups=at[Location.IN_CUP],
            P=at[Location.LOST_PICK],
            D=at[Location.LOST_CARRY],
            T=at[Location.LOST_THROW],
            total=self.total,
            ploughed=sum(everyone.locations[number] in self._IN_TRAY for number in everyone.ploughed),
        )
