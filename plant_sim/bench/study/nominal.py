"""How the twin handles its seedlings when nothing is wrong: what every row of a trial felt."""

from __future__ import annotations

from dataclasses import dataclass, field
from statistics import fmean
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.program.states import State
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.trial import HOMING_LIMIT_MS, TRAY_LIMIT_MS
from plant_sim.bench.twin import NotReachedError, Twin
from plant_sim.crop.expectation import Motion
from plant_sim.crop.response import Number
from plant_sim.parameters import Machine

TRAYS: Final = 2


class RowMotion(NamedTuple):
    """What one row of seedlings felt.

    Attributes:
        side: Arm.
        along_m: How far the cells were past the claws when they closed, m.
        across_m: How far the claws were inward of the column, m.
        force_n: Greatest force of a finger, N.
        held_s: From grip to release, s.
        throw_along_m: How far the cups were past the plugs when they came down, m.
        throw_across_m: How far the slide was off the feed, m.
        fall_s: Time of the fall, s.
    """

    side: str
    along_m: float
    across_m: float
    force_n: float
    held_s: float
    throw_along_m: float
    throw_across_m: float
    fall_s: float


@dataclass
class MotionWatch:
    """Monitor of a twin that takes note of every row that is thrown.

    Attributes:
        rows: What they felt, in order.
    """

    rows: list[RowMotion] = field(default_factory=list)
    _thrown_ms: dict[str, int] = field(default_factory=dict)

    def __call__(self, twin: Twin) -> None:
        """Look at the plant after a scan."""
        for side, arm in twin.plant.arms.items():
            if arm.row.falling:
                self._thrown_ms.setdefault(side, twin.plant.time_ms)
            elif side in self._thrown_ms:
                felt, thrown_s = arm.grip.felt, self._thrown_ms.pop(side) / 1000
                fall_s = twin.parameters.handling.fall_s(arm.lift.rise_m)
                self.rows.append(
                    RowMotion(
                        side,
                        felt.along_m,
                        felt.across_m,
                        felt.peak_n,
                        thrown_s - felt.since_s,
                        arm.row.off_m,
                        arm.slide.x_m,
                        fall_s,
                    )
                )


def observed_rows(machine: Machine, *, seed: int = 1) -> list[RowMotion]:
    """What every row of a trial feels on a machine.

    Args:
        machine: All parameters.
        seed: Seed of the trial.

    Raises:
        StudyError: the trial does not complete.
    """
    twin = Twin(seed=seed, trays=TRAYS, parameters=machine, set_points={"trays_target": TRAYS})
    watch = MotionWatch()
    twin.watch(watch)
    try:
        twin.home(within_ms=HOMING_LIMIT_MS)
        twin.start()
        twin.run_until_state(State.COMPLETE, within_ms=TRAY_LIMIT_MS * TRAYS)
    except NotReachedError as error:
        raise StudyError(f"the nominal trial did not complete ({error}); use a machine that works") from None
    return watch.rows


@dataclass(frozen=True)
class NominalMotion:
    """What the rows of a trial feel, for any claw pressure.

    Attributes:
        rows: What they were seen to feel.
        force_n_mpa: Force of a finger for each MPa of claw pressure, N/MPa.
        catch_m: How far off its centre a plug still goes into a cup, m.
    """

    rows: tuple[RowMotion, ...]
    force_n_mpa: float
    catch_m: float

    def __call__(self, pressure_mpa: Number) -> Motion:
        """Return the motion at claw pressures, MPa: one line a row, one column a pressure."""

        def each(name: str) -> NDArray[np.float64]:
            return np.array([[abs(getattr(row, name))] for row in self.rows])

        return Motion(
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
    """See how a machine handles its seedlings.

    Args:
        machine: All parameters; the force is taken as proportional to its claw pressure.
        seed: Seed of the trial.

    Raises:
        StudyError: the trial does not complete.
    """
    rows = tuple(observed_rows(machine, seed=seed))
    force_n = fmean(row.force_n for row in rows)
    return NominalMotion(rows, force_n / machine.crop.claw_pressure_mpa, machine.cups.catch_m)
