"""Reader of campaigns: one YAML file, checked completely before the first run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.common.modbus.io_map import IoMap
from controller.common.yaml_section import Section, read_section, whole
from plant_sim.common.capacity import MOST_SEEDLINGS
from plant_sim.faults import Fault, FaultError, parse_fault
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant
from plant_sim.study.design_file import DESIGNS, DesignReader, FactorDesign, design_keys
from plant_sim.study.errors import StudyError
from plant_sim.study.fleet import SEEDLINGS
from plant_sim.study.runner import MOST_TRIALS

MOST_RUNS: Final = 1_000_000
"""Maximum number of runs; the keys of that many take 0.15 GB of memory."""
_KEYS = ("replicates", "seed", "seedlings", "faults")


@dataclass(frozen=True)
class Campaign:
    """A campaign that is ready to run: each point of the design with each set of faults and each seed.

    Attributes:
        path: Path of the file.
        design: Design points.
        fault_sets: Sets of faults; an empty set is a machine without faults.
        replicates: Number of trials at each point with each set of faults.
        seed: Seed of the campaign.
        seedlings: Seedlings per trial.
    """

    path: Path
    design: FactorDesign
    fault_sets: tuple[tuple[Fault, ...], ...]
    replicates: int
    seed: int
    seedlings: int

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.design.points) * len(self.fault_sets) * self.replicates


def load_campaign(
    path: Path,
    machine: Machine,
    io_map: IoMap,
    *,
    trials: int | None = None,
    seed: int | None = None,
    seedlings: int | None = None,
) -> Campaign:
    """Read a campaign and check it completely.

    Args:
        path: Campaign file; docs/campaigns.md describes its format.
        machine: Base machine.
        io_map: I/O map.
        trials: Number of trials at each point; None = the number in the file.
        seed: Seed; None = the seed in the file.
        seedlings: Number of seedlings per trial; None = the number in the file.

    Raises:
        StudyError: The file is unreadable or invalid; the one-line message states file, line number, key and remedy.
    """
    file = read_section(path, [*_KEYS, *design_keys(DESIGNS)], StudyError)
    file_trials = file.read_or("replicates", whole(1, MOST_TRIALS), 1)
    file_seed = file.read_or("seed", whole(0, 2**31 - 1), 1)
    file_seedlings = file.read_or("seedlings", whole(1, MOST_SEEDLINGS), SEEDLINGS)
    seed = file_seed if seed is None else seed
    reader = DesignReader(file, machine, tuple(DESIGNS))
    has_factors = any(key in file for key in design_keys(DESIGNS) if key != "fixed")
    campaign = Campaign(
        path=path,
        design=reader.read(seed) if has_factors else reader.read_fixed(),
        fault_sets=_fault_sets(file, machine, io_map),
        replicates=file_trials if trials is None else trials,
        seed=seed,
        seedlings=file_seedlings if seedlings is None else seedlings,
    )
    if campaign.seedlings > MOST_SEEDLINGS:
        raise StudyError(f"--seedlings {campaign.seedlings}: must be 1 to {MOST_SEEDLINGS}")
    if campaign.runs > MOST_RUNS:
        many = f"results in {campaign.runs} runs, more than {MOST_RUNS}; reduce it"
        raise file.error("replicates", many) if trials is None else StudyError(f"--trials {trials}: {many}")
    return campaign


def _fault_sets(file: Section, machine: Machine, io_map: IoMap) -> tuple[tuple[Fault, ...], ...]:
    """Return the sets of faults, each of them possible in the machine; without the key, only the empty set."""
    if "faults" not in file:
        return ((),)
    sets = [tuple(sorted(faults, key=str)) for faults in file.word_lists("faults", parse_fault)]
    if not sets:
        raise file.error("faults", "is empty; write a list of lists, [] for no fault, or delete the key")
    for number, faults in enumerate(sets):
        if faults in sets[:number]:
            raise file.error("faults", f"contains [{', '.join(map(str, faults))}] twice; delete one")
        try:
            Plant(io_map, machine, seed=0, trays=1, faults=faults)
        except FaultError as error:
            raise file.error("faults", str(error)) from None
    return tuple(sets)
