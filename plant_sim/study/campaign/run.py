"""Runs of a campaign: their order, their keys, and the execution of one run."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import platform
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from controller.common.modbus.io_map import IoMap
from plant_sim.faults import Fault
from plant_sim.machine.parameters import Machine
from plant_sim.study.campaign.file import Campaign
from plant_sim.study.campaign.record import Record, report_record
from plant_sim.study.campaign.version import code_version
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting
from plant_sim.study.runner import trial_seed
from plant_sim.twin.trial import run_trial

_KEY_DIGITS = 32


@dataclass(frozen=True, slots=True)
class CampaignRun:
    """One run, with everything that determines its result.

    Attributes:
        key: Checksum of the version, the machine, the set-points, the I/O map, the faults, the seed and the seedlings.
        trial: Number of the trial at its point, from 0.
        seed: Seed of the plant.
        seedlings: Number of seedlings.
        levels: Levels of the factors and the fixed values in natural units, by dotted name.
        faults: Faults of the plant.
        parameters: Machine parameters.
        set_points: Initial values of set-points, by name.
        io_map: I/O map.
        version: Version of the program; see `code_version`.
    """

    key: str
    trial: int
    seed: int
    seedlings: int
    levels: Mapping[str, float]
    faults: tuple[Fault, ...]
    parameters: Machine
    set_points: Mapping[str, int]
    io_map: IoMap
    version: str


def execute(run: CampaignRun) -> Record:
    """Execute a run and return its record.

    Raises:
        StudyError: The program in this process has another version.
    """
    if code_version() != run.version:
        raise StudyError(
            f"worker on {platform.node()}: has version {code_version()} instead of {run.version}; install the same "
            "version on every computer"
        )
    report = run_trial(
        seed=run.seed,
        seedlings=run.seedlings,
        parameters=run.parameters,
        set_points=run.set_points,
        io_map=run.io_map,
        faults=run.faults,
    )
    identity = {"key": run.key, "version": run.version, "trial": run.trial, "seed": run.seed}
    return {**identity, **run.levels, "faults": "; ".join(map(str, run.faults)), **report_record(report)}


@dataclass(frozen=True, slots=True)
class CampaignPlan:
    """All runs of a campaign on one machine, in a fixed order.

    The seed of a run depends on the seed of the campaign, the setting and the number of the trial, but not on the
    faults: the trials of a point have the same seeds with every set of faults. A point that occurs several times in
    the design has that many times the trials. A campaign that is extended therefore contains all runs of the shorter
    one.

    Attributes:
        campaign: The campaign.
        machine: Base machine.
        io_map: I/O map.
        version: Version of the program.
    """

    campaign: Campaign
    machine: Machine
    io_map: IoMap
    version: str

    def runs(self) -> Iterator[CampaignRun]:
        """Yield the runs; only one at a time is in memory."""
        campaign, design = self.campaign, self.campaign.design
        common = self._common()
        occurrences = Counter(map(tuple, design.points.tolist()))
        for point, count in occurrences.items():
            setting = design.setting(point)
            levels = {each.name: value for each, value in design.fixed.items()}
            levels |= {each.name: value for each, value in zip(design.parameters, point, strict=True)}
            parameters, set_points = setting.machine(self.machine), setting.set_points()
            content = _checksum(common, repr(parameters), json.dumps(set_points, sort_keys=True))
            number = _number(setting)
            for faults in campaign.fault_sets:
                for trial in range(count * campaign.replicates):
                    seed = trial_seed(campaign.seed, number, trial)
                    yield CampaignRun(
                        key=_checksum(content, *map(str, faults), str(seed)),
                        trial=trial,
                        seed=seed,
                        seedlings=campaign.seedlings,
                        levels=levels,
                        faults=faults,
                        parameters=parameters,
                        set_points=set_points,
                        io_map=self.io_map,
                        version=self.version,
                    )

    def _common(self) -> str:
        """Return the checksum of everything that is the same in all runs."""
        io_map = self.io_map
        points = [dataclasses.replace(each, line=0) for each in (*io_map.inputs, *io_map.outputs, *io_map.unwired)]
        registers = [dataclasses.replace(each, line=0) for each in (*io_map.registers, *io_map.unwired_registers)]
        return _checksum(self.version, repr(points), repr(registers), str(self.campaign.seedlings))


def _checksum(*parts: str) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:_KEY_DIGITS]


def _number(setting: FactorSetting) -> int:
    """Return the number of a setting, which depends only on its values."""
    return int(_checksum(json.dumps(dict(setting.values), sort_keys=True)), 16)
