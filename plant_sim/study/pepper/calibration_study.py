"""Study ``calibration``: seedling constants of the machine compared with a new fit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from controller.common.document.parts import Cell, Heading, Part, Table
from plant_sim.crop.expectation import Shares
from plant_sim.crop.mechanics import SeedlingSpec
from plant_sim.crop.response import success_percent
from plant_sim.machine.parameters import Machine
from plant_sim.study.pepper.calibration import (
    AGES_D,
    FITTED,
    FOAMS_MM,
    OPTIMUM,
    PRESSURES_MPA,
    Array,
    MotionAt,
    calibrate,
    courses,
    differences,
    middle,
    statement_residuals,
    success_at,
)
from plant_sim.study.pepper.nominal import NominalMotion, nominal_motion
from plant_sim.study.report.origin import changed_keys, origin_parts
from plant_sim.study.report.study import Study

_LEVELS = {"foam": (FOAMS_MM, "mm"), "age": (AGES_D, "d"), "pressure": (PRESSURES_MPA, "MPa")}
_SHOWN = ("P", "D", "T", "missed", "cut", "slipped")


def calibration_study(machine: Machine, *, seed: int) -> Study:
    """Return the study.

    Args:
        machine: Machine whose motion and seedling are analysed.
        seed: Seed of the trial in which the motion is observed.

    Raises:
        StudyError: The trial does not complete.
    """
    motion = nominal_motion(machine, seed=seed)
    specs = {"machine": machine.seedling, "fit": calibrate(middle(machine.seedling), motion)}
    parts: list[Part] = [
        *origin_parts(machine),
        "The seedling constants that are given neither in the papers nor in catalogues are fitted so that a population "
        "under the nominal motion of the machine reproduces eq. 5 of the pepper paper over its design region, with the "
        "paper's statements on single factors as inequalities. The values of the machine are compared with a fit that "
        "starts at the midpoint of each constant's bounds. Every figure of agreement below is in-sample: it is "
        "computed at points and statements that the fit has used.",
        Heading("Motion"),
        _motion_table(motion),
        Heading("Comparison with equation 5"),
        _agreement_table(specs, motion),
        Heading("Constants"),
        _constants_table(specs),
        Heading("Single factors"),
        "Expected failures of the machine's seedlings, %, with the other factors at 12.5 mm, 52 d and 0.45 MPa. "
        "Missed, cut and slipped are counted separately.",
        *(_course_table(name, course) for name, course in courses(machine.seedling, motion)._asdict().items()),
    ]
    return Study(
        name="calibration",
        title="Calibration of the seedling",
        command=f"python -m plant_sim study calibration --seed {seed}",
        parts=tuple(parts),
        record={
            "changed_parameters": changed_keys(machine),
            "constants": {name: {which: getattr(spec, name) for which, spec in specs.items()} for name in FITTED},
            "agreement": {which: _agreement(spec, motion) for which, spec in specs.items()},
            "single_factor": {
                name: {
                    share: np.broadcast_to(100 * np.asarray(getattr(course, share)), (7,)).tolist() for share in _SHOWN
                }
                for name, course in courses(machine.seedling, motion)._asdict().items()
            },
        },
    )


def _motion_table(motion: NominalMotion) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            row.side,
            1e3 * row.along_m,
            1e3 * row.across_m,
            row.force_n,
            row.held_s,
            1e3 * row.throw_along_m,
            1e3 * row.throw_across_m,
        )
        for row in motion.rows
    ]
    heading = (
        "arm",
        "cells past claws, mm",
        "claws past column, mm",
        "finger, N",
        "held, s",
        "cups past plugs, mm",
        "slide off feed, mm",
    )
    return Table("motion", "Motion of every row of a trial", heading, tuple(rows))


def _agreement(spec: SeedlingSpec, motion: MotionAt) -> dict[str, float]:
    off = differences(spec, motion)
    return {
        "points": float(off.size),
        "rms": float(np.sqrt(np.mean(off**2))),
        "largest": float(np.abs(off).max()),
        "at_the_optimum": success_at(spec, motion, *OPTIMUM) - success_percent(*OPTIMUM),
        "worst_word": float(statement_residuals(spec, motion).max()),
    }


def _agreement_table(specs: Mapping[str, SeedlingSpec], motion: MotionAt) -> Table:
    agreements = [_agreement(spec, motion) for spec in specs.values()]
    names = {
        "points": "points of the design region",
        "rms": "root mean square, points of success",
        "largest": "largest, points",
        "at_the_optimum": "at 10 mm, 51 d, 0.40 MPa, points",
        "worst_word": "largest deviation from a statement, points of failure",
    }
    rows: list[tuple[Cell, ...]] = [(text, *(each[name] for each in agreements)) for name, text in names.items()]
    return Table("agreement", "Expected success minus eq. 5", ("", *specs), tuple(rows))


def _constants_table(specs: Mapping[str, SeedlingSpec]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (name, *(float(getattr(spec, name)) for spec in specs.values()), *FITTED[name]) for name in FITTED
    ]
    return Table("constants", "Fitted constants", ("seedling.", *specs, "from", "to"), tuple(rows), 5)


def _course_table(name: str, course: Shares) -> Table:
    levels, unit = _LEVELS[name]
    percent: dict[str, Array] = {
        share: np.broadcast_to(100 * np.asarray(getattr(course, share)), levels.shape) for share in _SHOWN
    }
    rows: list[tuple[Cell, ...]] = [
        (f"{level:g}", *(float(percent[share][index]) for share in _SHOWN)) for index, level in enumerate(levels)
    ]
    return Table(f"expected-{name}", f"Over {name}", (f"{name}, {unit}", *_SHOWN), tuple(rows), 1)
