"""Every seedling of a run, each in exactly one place, and the trays they come in."""

import enum
import random
from collections.abc import Iterator
from dataclasses import dataclass

from plant_sim.crop.traits import TYPICAL, Traits, draw_traits

#: Cells of a tray in the direction of travel; also claws an arm. Source: MACHINE.md 1.
CELLS_ALONG = 12
#: Columns of cells across a tray: three pick positions for either arm. Source: MACHINE.md 1.
COLUMNS = 6
#: Cells of a tray.
TRAY_CELLS = COLUMNS * CELLS_ALONG


class Place(enum.IntEnum):
    """Where a seedling is."""

    STANDING = 0
    CLAMPED = 1
    IN_CLAW = 2
    FALLING = 3
    IN_CUP = 4
    LOST_PICK = 5
    LOST_CARRY = 6
    LOST_THROW = 7


class Seedling:
    """One seedling; only its `Seedlings` moves it.

    Attributes:
        tray: Number of its tray.
        column: Column in the tray, 0 at the left.
        along: Cell in the column, 0 at the front edge; also the claw that takes it.
        traits: What makes it differ from the next one.
        place: Where it is.
    """

    __slots__ = ("along", "column", "place", "traits", "tray")

    def __init__(self, tray: int, column: int, along: int, traits: Traits) -> None:
        """Let it stand in its cell."""
        self.tray = tray
        self.column = column
        self.along = along
        self.traits = traits
        self.place = Place.STANDING


@dataclass(frozen=True, slots=True)
class SeedlingCounts:
    """How many seedlings are where; the first six add up to the total, always.

    Attributes:
        in_tray: In a cell, gripped or not.
        in_claw: Out of the cell, in a claw or falling from it.
        in_cups: Fallen into a cup.
        P: Lost while picking.
        D: Lost while carrying.
        T: Lost while throwing.
        total: All there are.
    """

    in_tray: int
    in_claw: int
    in_cups: int
    P: int
    D: int
    T: int
    total: int


class Seedlings:
    """All seedlings of a run, in trays of 6 columns with 12 cells each.

    A seedling's traits depend on the seed, its tray and its cell, not on when or how it is handled.

    Attributes:
        total: How many there are.
        moves: Every move since somebody began to record them, who also empties it; None: nobody does.
    """

    def __init__(self, *, trays: int, seed: int) -> None:
        """Sow every tray.

        Args:
            trays: How many trays.
            seed: Seed of the run.
        """
        self._seed = seed
        self.moves: list[tuple[Seedling, Place]] | None = None
        self._trays = [_sow(tray, seed) for tray in range(trays)]
        self._at = [0] * len(Place)
        self._at[Place.STANDING] = self.total = trays * TRAY_CELLS

    def __iter__(self) -> Iterator[Seedling]:
        return (plant for tray in self._trays for column in tray for plant in column)

    @property
    def trays(self) -> int:
        """How many trays there are."""
        return len(self._trays)

    def empty_cells(self, tray: int) -> int:
        """How many cells of a tray never held a seedling."""
        return TRAY_CELLS - sum(len(column) for column in self._trays[tray])

    def leave_out(self, tray: int, cells: int) -> None:
        """Let cells of a tray hold no seedling, drawn at random; the others keep their traits.

        Args:
            tray: The tray; nothing has touched it yet.
            cells: How many more.
        """
        columns = self._trays[tray]
        sown = [seedling for column in columns for seedling in column]
        for seedling in random.Random(f"seed {self._seed}, tray {tray}, empty cells").sample(sown, cells):
            columns[seedling.column].remove(seedling)
        self._at[Place.STANDING] -= cells
        self.total -= cells

    def make_typical(self) -> None:
        """Let every seedling be the typical one of its age: under good motion none fails by itself."""
        for seedling in self:
            seedling.traits = TYPICAL

    def column(self, tray: int, column: int) -> list[Seedling]:
        """The seedlings of one column, front edge first, wherever they are now."""
        return self._trays[tray][column]

    def move(self, seedling: Seedling, place: Place) -> None:
        """Take a seedling from where it is to another place."""
        self._at[seedling.place] -= 1
        self._at[place] += 1
        seedling.place = place
        if self.moves is not None:
            self.moves.append((seedling, place))

    def counts(self) -> SeedlingCounts:
        """Count them."""
        at = self._at
        return SeedlingCounts(
            in_tray=at[Place.STANDING] + at[Place.CLAMPED],
            in_claw=at[Place.IN_CLAW] + at[Place.FALLING],
            in_cups=at[Place.IN_CUP],
            P=at[Place.LOST_PICK],
            D=at[Place.LOST_CARRY],
            T=at[Place.LOST_THROW],
            total=self.total,
        )


def _sow(tray: int, seed: int) -> list[list[Seedling]]:
    draws = random.Random(f"seed {seed}, tray {tray}")
    return [
        [Seedling(tray, column, along, draw_traits(draws)) for along in range(CELLS_ALONG)] for column in range(COLUMNS)
    ]
