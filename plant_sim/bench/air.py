"""Air consumption three ways: Table 1 of the paper, the same formula for a run as it was, and the run's own air."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from plant_sim.bench.trial import run_trial
from plant_sim.parameters import DEFAULT_MACHINE, load_machine
from plant_sim.pneumatics.consumption import TABLE_1_PRINTED_L_MIN, stroke_air_l, table_1_l_min
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, REFERENCE_KG_M3
from plant_sim.scope.columns import SIDES
from plant_sim.scope.store import Recording, RecordingError

_MANIFOLDS = {"slide": "manifold", "lift": "manifold", "claws": "claw_manifold"}
_FED = 0.5  # a valve feeds a line while its spool is further than this


@dataclass(frozen=True, slots=True)
class DriveAir:
    """Air of one kind of drive of both arms.

    Attributes:
        table_1_l_min: Printed in Table 1 of the paper, L/min ANR.
        table_1_formula_l_min: The same by the formula.
        formula_l_min: By the formula, with the geometry, pressure, ways and strokes of the run.
        integrated_l_min: What its valves let in during the run.
        strokes_per_min: Single strokes of both arms, 1/min.
        stroke_mm: Mean way of one, mm.
        pressure_mpa: Mean gauge pressure of its manifold, MPa.
    """

    table_1_l_min: int
    table_1_formula_l_min: int
    formula_l_min: float
    integrated_l_min: float
    strokes_per_min: float
    stroke_mm: float
    pressure_mpa: float

    @property
    def difference(self) -> float | None:
        """By how much of the integrated air the formula is off; None without air."""
        return self.formula_l_min / self.integrated_l_min - 1 if self.integrated_l_min > 0 else None


@dataclass(frozen=True, slots=True)
class AirReport:
    """The comparison.

    Attributes:
        minutes: Length of the run, min.
        drives: Slide, lift and claws.
    """

    minutes: float
    drives: dict[str, DriveAir]

    @property
    def difference(self) -> float | None:
        """The same for all drives together."""
        integrated_l_min = sum(drive.integrated_l_min for drive in self.drives.values())
        formula_l_min = sum(drive.formula_l_min for drive in self.drives.values())
        return formula_l_min / integrated_l_min - 1 if integrated_l_min > 0 else None

    def record(self) -> dict[str, object]:
        """Return the comparison as one JSON object."""
        drives = {name: {**asdict(drive), "difference": drive.difference} for name, drive in self.drives.items()}
        return {"minutes": self.minutes, "drives": drives, "difference": self.difference}

    def text(self) -> str:
        """Return the comparison for a person."""
        drives = list(self.drives.values())

        def row(title: str, values: list[str]) -> str:
            return title.ljust(34) + "".join(value.rjust(10) for value in values)

        def summed(title: str, values: list[float], form: str) -> str:
            return row(title, [format(value, form) for value in (*values, sum(values))])

        lines = [
            row("air, both arms, L/min ANR", [*self.drives, "total"]),
            summed("Table 1 of the paper, printed", [drive.table_1_l_min for drive in drives], "d"),
            summed("Table 1, by the formula", [drive.table_1_formula_l_min for drive in drives], "d"),
            summed("this run, by the formula", [drive.formula_l_min for drive in drives], ".1f"),
            summed("this run, let in by the valves", [drive.integrated_l_min for drive in drives], ".1f"),
            row(
                "formula against valves",
                [_percent(each) for each in (*(d.difference for d in drives), self.difference)],
            ),
            "",
            row("single strokes a minute", [f"{drive.strokes_per_min:.1f}" for drive in drives]),
            row("mean stroke, mm", [f"{drive.stroke_mm:.0f}" for drive in drives]),
            row("mean pressure, MPa gauge", [f"{drive.pressure_mpa:.3f}" for drive in drives]),
            "",
            f"Table 1: 24 single strokes a minute at 0.80 MPa, claws 0.75 MPa. This run: {self.minutes:.2f} min.",
        ]
        return "\n".join(lines)


def air_of(recording: Recording) -> AirReport:
    """Return how much air a recorded run used.

    The formula counts the way each piston really travelled, and for every stroke the tube of its line, and
    the dead volume of the cylinder where no check valve keeps the air in it.

    Args:
        recording: The run.

    Raises:
        RecordingError: the recording lacks a column or holds no time.
    """
    whole = recording.whole
    if whole.from_ms == whole.to_ms:
        raise RecordingError(f"{recording.path}: holds one instant; record a run")
    minutes = (whole.to_ms - whole.from_ms) / 60_000
    return AirReport(minutes, {drive: _drive_air(recording, drive, minutes) for drive in _MANIFOLDS})


def _drive_air(recording: Recording, drive: str, minutes: float) -> DriveAir:
    manifold = f"air.network.{_MANIFOLDS[drive]}.pressure_pa"
    pressure_mpa = (float(recording.read([manifold])[manifold].mean()) - ATMOSPHERE_PA) / 1e6
    lines = [
        _line_air(recording, f"{side}.{drive}", port, pressure_mpa) for side in SIDES for port in ("plus", "minus")
    ]
    formula_l, integrated_l, strokes, way_m = (float(sum(each)) for each in zip(*lines, strict=True))
    return DriveAir(
        table_1_l_min=TABLE_1_PRINTED_L_MIN[drive],
        table_1_formula_l_min=table_1_l_min()[drive],
        formula_l_min=formula_l / minutes,
        integrated_l_min=integrated_l / minutes,
        strokes_per_min=strokes / minutes,
        stroke_mm=1e3 * way_m / strokes if strokes else 0.0,
        pressure_mpa=pressure_mpa,
    )


def _line_air(recording: Recording, cylinder: str, port: str, pressure_mpa: float) -> tuple[float, float, int, float]:
    """Air of one line by the formula and by its valve, L ANR; how often it was fed, and the way, m."""
    made, sign = recording.about["make"], 1.0 if port == "plus" else -1.0
    piston, spool, drawn = f"{cylinder}.piston_m", f"{cylinder}.valve.spool", f"{cylinder}.{port}.drawn_kg"
    data = recording.read([piston, spool, drawn])
    way_m = float(np.clip(sign * np.diff(data[piston]), 0.0, None).sum())
    fed = sign * data[spool] > _FED
    strokes = int(np.count_nonzero(fed[1:] & ~fed[:-1]))
    kept = bool(made[f"{cylinder}.{port}.checked"])
    filled_m3 = made[f"{cylinder}.{port}.tube_m3"] + (0.0 if kept else made[f"{cylinder}.{port}.dead_m3"])
    formula_l = stroke_air_l(
        swept_l=1e3 * made[f"{cylinder}.{port}_area_m2"] * way_m,
        tube_l=1e3 * filled_m3 * strokes,
        pressure_mpa=pressure_mpa,
    )
    integrated_l = 1e3 * float(data[drawn][-1] - data[drawn][0]) / REFERENCE_KG_M3
    return formula_l, integrated_l, strokes, way_m


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:+.1f} %"


def add_air_arguments(parser: argparse.ArgumentParser) -> None:
    """Give the command `air` its options."""
    parser.add_argument("recording", type=Path, nargs="?", default=None, metavar="RECORDING",
                        help="a run made with --record; without one the paper's trial is run")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    parser.add_argument("--machine", type=Path, default=DEFAULT_MACHINE, help="the machine's parameters")
    parser.add_argument("--seed", type=int, default=1, help="seed of everything random")
    parser.add_argument("--trays", type=int, default=2, help="full trays of 72 in the magazine")


def air_command(options: argparse.Namespace) -> int:
    """Print the comparison for a recording, or for a trial that is run for it.

    Returns:
        0; 1 if the trial did not complete.

    Raises:
        RecordingError: the recording cannot be used.
        IoMapError: the wires cannot.
        MachineError: the parameters cannot.
    """
    if options.recording is not None:
        _show(air_of(Recording(options.recording)), as_json=options.json)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.parquet"
        report = run_trial(
            seed=options.seed,
            trays=options.trays,
            io_map=load_io_map(options.io_map),
            parameters=load_machine(options.machine),
            record=path,
        )
        _show(air_of(Recording(path)), as_json=options.json)
    if report.reason:
        sys.stderr.write(f"the trial did not complete: {report.reason}\n")
    return 0 if report.completed else 1


def _show(report: AirReport, *, as_json: bool) -> None:
    sys.stdout.write(f"{json.dumps(report.record()) if as_json else report.text()}\n")
