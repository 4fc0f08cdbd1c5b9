"""Domain of the models of a line: plants, soil and settings beyond the range in which a model was tested."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from plant_sim.line.ground import LEAST_SLIP, MOST_SLIP
from plant_sim.line.planting import ChainPlanter
from plant_sim.line.row import Flags
from plant_sim.line.run import LineRun
from plant_sim.planter.quality import is_tested_force, tested_forces_n

WITHIN: Final = "nothing is extrapolated beyond the tested range of a model"


class DomainNote(NamedTuple):
    """Part of a result that is beyond the range in which a model was tested.

    Attributes:
        name: Short name, for the result file.
        number: Number of plants, patches or samples beyond the range.
        total: Number of all of them.
        text: Sentence that states the range and the consequence.
    """

    name: str
    number: int
    total: int
    text: str

    def record(self) -> dict[str, object]:
        """Return the note as a JSON object."""
        return {"name": self.name, "count": self.number, "of": self.total, "text": self.text}

    def line(self) -> str:
        """Return the note as a line of text."""
        return f"OUTSIDE: {self.number:,} of {self.total:,} {self.text}"


def domain_notes(run: LineRun, planter: ChainPlanter | None) -> tuple[DomainNote, ...]:
    """Return everything that is beyond the range of a model; empty if nothing is.

    Args:
        run: Run of the line.
        planter: Chain planter; None for a line with nozzles.
    """
    plants = sum(int(np.count_nonzero(row.planted)) for row in run.rows)
    notes = [*_of_falls(run, planter, plants), *_of_slip(run)]
    if run.is_crop_extrapolated:
        notes.append(
            DomainNote("crop", plants, plants, "plants: foam, age or pressure is beyond the trials of the pepper paper")
        )
    return tuple(note for note in notes if note.number)


def _of_falls(run: LineRun, planter: ChainPlanter | None, plants: int) -> list[DomainNote]:
    if planter is None:
        return []
    frequencies, injuries = (
        _beyond([getattr(row, name) for row in run.rows]) for name in ("frequency_within", "injury_within")
    )
    grid = planter.table.grid
    low, high = grid.ratios[0], grid.ratios[-1]
    slow, fast = grid.frequencies_per_min[0], grid.frequencies_per_min[-1]
    ratios = _beyond([~row.planted | ((row.ratio >= low) & (row.ratio <= high)) for row in run.rows])
    weak, strong = tested_forces_n()
    return [
        DomainNote(
            "lambda", ratios, plants, f"falls: lambda is beyond {low:g} to {high:g}; the nearest simulated one is used"
        ),
        DomainNote(
            "frequency",
            frequencies,
            plants,
            f"falls: the planting frequency is beyond {slow:g} to {fast:g}/min; the nearest simulated one is used",
        ),
        DomainNote(
            "injury",
            injuries,
            plants,
            "injuries: speed or frequency is beyond the bench test; equation 11 extrapolates",
        ),
        DomainNote(
            "clamp",
            0 if is_tested_force(planter.clamp_n) else plants,
            plants,
            f"plants: the clamp force of {planter.clamp_n:g} N is beyond the tested {weak:.2f} to {strong:.2f} N",
        ),
    ]


def _of_slip(run: LineRun) -> list[DomainNote]:
    notes = []
    if run.slip is not None:
        limited = run.slip.limited
        text = (
            f"patches of soil: the slip is limited to {100 * LEAST_SLIP:g} to {100 * MOST_SLIP:g} %, its mean differs"
        )
        notes.append(DomainNote("slip", int(np.count_nonzero(limited)), len(limited), text))
    if run.sensor is not None:
        text = (
            "scans: the slip is beyond the 0 to 95 % of the ground-speed sensor of the twin; rows do not depend on it"
        )
        notes.append(DomainNote("ground_speed_sensor", *run.sensor, text))
    return notes


def _beyond(within: Sequence[Flags | None]) -> int:
    return sum(int(np.count_nonzero(~each)) for each in within if each is not None)
