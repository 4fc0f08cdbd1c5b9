"""Results as a table in memory: a pandas DataFrame with one row per trial, in the columns of a stored campaign."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, Final

import pandas as pd

from controller.common.modbus.io_map import IoMap
from plant_sim.faults import Fault
from plant_sim.machine.parameters import Machine
from plant_sim.study.campaign.file import Campaign
from plant_sim.study.campaign.record import Record, report_record
from plant_sim.study.campaign.run import CampaignPlan, execute
from plant_sim.study.campaign.version import code_version
from plant_sim.study.design_file import FactorDesign
from plant_sim.study.doe.design import full_factorial
from plant_sim.study.engines import ProcessEngine
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import study_parameter
from plant_sim.study.fleet import SEEDLINGS
from plant_sim.twin.commissioning import default_io_map, default_parameters
from plant_sim.twin.report import TrialReport

NESTED: Final = ("cycle_times", "missed_cups_by_cause")
"""Columns of a stored campaign that contain a table; they are in the report of the trial."""
IDENTITY: Final = ("key", "version")


def trial_frame(reports: Iterable[TrialReport]) -> pd.DataFrame:
    """Return reports as a table with one row per trial.

    Args:
        reports: Reports of `run_trial`.

    Returns:
        Columns as in a stored campaign (docs/campaigns.md): counts of seedlings; `S`, `F_p`, `F_d` and `F_t` and their
        exact binomial 95 % limits, %, missing for an incomplete trial; times, s; air, L/min. `alarms` is one text.
    """
    return _frame({"seed": report.seed, **report_record(report)} for report in reports)


def campaign_frame(
    factors: Mapping[str, Sequence[float]],
    *,
    faults: Sequence[Sequence[Fault]] = ((),),
    replicates: int = 1,
    seed: int = 1,
    seedlings: int = SEEDLINGS,
    machine: Machine | None = None,
    io_map: IoMap | None = None,
    workers: int = 1,
) -> pd.DataFrame:
    """Run trials at every combination of levels, with every set of faults, and return one row per trial.

    Seeds and rows are those of a stored campaign with the same settings, which is for runs of hours.

    Args:
        factors: Levels by the name of a machine parameter or of a set-point (`program.` and its name), in its unit:
            that of docs/reference/parameters.md, ms for a time set-point.
        faults: Sets of faults; an empty set is a machine without faults.
        replicates: Trials at each combination with each set of faults.
        seed: Seed of the campaign.
        seedlings: Seedlings per trial.
        machine: Base machine; None = the defaults.
        io_map: I/O map; None = the default map.
        workers: Processes; 1 = this process. The rows do not depend on their number.

    Raises:
        StudyError: A factor is unknown, or a level is not possible in the machine.
        FaultError: A fault is not possible in the machine.
    """
    machine, io_map = machine or default_parameters(), io_map or default_io_map()
    for name, number in (("replicates", replicates), ("seedlings", seedlings)):
        if number < 1:
            raise StudyError(f"{name}: must be 1 or more, not {number}")
    design = FactorDesign(
        design="factorial",
        parameters=tuple(study_parameter(name, machine) for name in factors),
        factors=(),
        points=full_factorial([*factors.values()]),
        fixed={},
    )
    fault_sets = tuple(tuple(sorted(each, key=str)) for each in faults)
    campaign = Campaign(Path(), design, fault_sets, replicates, seed, seedlings)
    runs = [*CampaignPlan(campaign, machine, io_map, code_version()).runs()]
    with closing(ProcessEngine(workers).results([partial(execute, run) for run in runs], ordered=True)) as records:
        return _frame({name: value for name, value in record.items() if name not in IDENTITY} for record in records)


def _frame(records: Iterable[Record]) -> pd.DataFrame:
    return pd.DataFrame([_flat(record) for record in records])


def _flat(record: Record) -> Mapping[str, Any]:
    """Return a record without nested tables."""
    flat = {name: value for name, value in record.items() if name not in NESTED}
    return flat | {"alarms": "; ".join(flat["alarms"])}
