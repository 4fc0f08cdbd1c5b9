"""Nominal handling of seedlings on the twin: the motion of every row in a trial."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import fmean
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.program.states import State
from plant_sim.crop.expectation import HandlingMotion
from plant_sim.crop.response import Number
from plant_sim.machine.parameters import Machine
from plant_sim.study.errors import StudyError
from plant_sim.study.row_motion import MotionWatch, RowMotion
from plant_sim.twin.ending.rule import HOMING_LIMIT_MS, TRAY_LIMIT_MS
from plant_sim.twin.lock_step import NotReachedError, Twin

TRAYS: Final = 2


def observed_rows(machine: Machine, *, seed: int = 1) -> list[RowMotion]:
    """Return the motion of every row of a trial on a machine.

    Args:
        machine: Machine parameters.
        seed: Seed of the trial.

    Raises:
        StudyError: The trial does not complete.
    """
    twin = Twin(seed=seed, trays=TRAYS, parameters=machine, set_points={"trays_target": TRAYS})
    watch = MotionWatch()
    twin.watch(watch, devices=())
    try:
        twin.home(within_ms=HOMING_LIMIT_MS)
        twin.start()
        twin.run_until_state(State.COMPLETE, within_ms=TRAY_LIMIT_MS * TRAYS)
    except NotReachedError as error:
        raise StudyError(f"the nominal trial did not complete ({error}); use a working machine") from None
    return watch.rows


@dataclass(frozen=True)
class NominalMotion:
    """Motion of the rows in a trial, with the finger force computed for any claw pressure.

    Attributes:
        rows: Observed motion of the rows.
        force_n_mpa: Finger force per unit of claw pressure, N/MPa.
        catch_m: Maximum offset at which a plug falls into a cup, m.
    """

    rows: tuple[RowMotion, ...]
    force_n_mpa: float
    catch_m: float

    def __call__(self, pressure_mpa: Number) -> HandlingMotion:
        """Return the motion at claw pressures, MPa: one array row per row of seedlings, one column per pressure."""

        def each(name: str) -> NDArray[np.float64]:
            return np.array([[abs(getattr(row, name))] for row in self.rows])

        return HandlingMotion(
            along_m=each("along_m"),
            across_m=each("across_m"),
            force_n=self.force_n_mpa * np.atleast_1d(pressure_mpa),
            held_s=each("held_s"),
            throw_along_m=each("throw_along_m"),
            throw_across_m=each("throw_across_m"),
            fall_s=each("fall_s"),
            catch_m=self.catch_m,
        )


def nominal_motion(machine: Machine, *, seed: int = 1) -> NominalMotion:
    """Return the nominal motion of a machine.

    Args:
        machine: Machine parameters; the finger force is proportional to the claw pressure.
        seed: Seed of the trial.

    Raises:
        StudyError: The trial does not complete.
    """
    rows = tuple(observed_rows(machine, seed=seed))
    force_n = fmean(row.force_n for row in rows)
    return NominalMotion(rows, force_n / machine.crop.claw_pressure_mpa, machine.cups.catch_m)
