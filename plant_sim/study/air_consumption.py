"""Air consumption: Table 1 of the paper, its formula applied to a recorded run, and the valve flow of that run."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from plant_sim.pneumatics.consumption import TABLE_1_PRINTED_L_MIN, stroke_air_l, table_1_l_min
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, REFERENCE_KG_M3
from plant_sim.scope.columns import SIDES
from plant_sim.scope.errors import RecordingError
from plant_sim.scope.store import Recording

_MANIFOLDS = {"slide": "manifold", "lift": "manifold", "claws": "claw_manifold"}
_OPEN_SPOOL = 0.5
"""Spool position above which a valve feeds its line."""


@dataclass(frozen=True, slots=True)
class DriveAir:
    """Air consumption of one kind of drive, summed over both arms.

    Attributes:
        table_1_l_min: Value printed in Table 1 of the paper, L/min ANR.
        table_1_formula_l_min: Value calculated with the formula of Table 1, L/min ANR.
        formula_l_min: Value of the formula for the geometry, pressure, travel and strokes of the run, L/min ANR.
        integrated_l_min: Flow through the valves during the run, L/min ANR.
        strokes_per_min: Single strokes of both arms, 1/min.
        stroke_mm: Mean travel of a stroke, mm.
        pressure_mpa: Mean gauge pressure of the manifold, MPa.
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
        """Relative deviation of the formula from the integrated flow; None if there is no flow."""
        return self.formula_l_min / self.integrated_l_min - 1 if self.integrated_l_min > 0 else None


@dataclass(frozen=True, slots=True)
class AirReport:
    """Comparison of the air consumption of all drives.

    Attributes:
        minutes: Duration of the run, min.
        drives: Values for the slides, lifts and claws.
    """

    minutes: float
    drives: dict[str, DriveAir]

    @property
    def difference(self) -> float | None:
        """Relative deviation for all drives together; None if there is no flow."""
        integrated_l_min = sum(drive.integrated_l_min for drive in self.drives.values())
        formula_l_min = sum(drive.formula_l_min for drive in self.drives.values())
        return formula_l_min / integrated_l_min - 1 if integrated_l_min > 0 else None

    def record(self) -> dict[str, object]:
        """Return the comparison as one JSON object."""
        drives = {name: {**asdict(drive), "difference": drive.difference} for name, drive in self.drives.items()}
        return {"minutes": self.minutes, "drives": drives, "difference": self.difference}

    def text(self) -> str:
        """Return the comparison as text."""
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
            summed("this run, admitted by the valves", [drive.integrated_l_min for drive in drives], ".1f"),
            row(
                "formula relative to valves",
                [_percent(each) for each in (*(d.difference for d in drives), self.difference)],
            ),
            "",
            row("single strokes per minute", [f"{drive.strokes_per_min:.1f}" for drive in drives]),
            row("mean stroke, mm", [f"{drive.stroke_mm:.0f}" for drive in drives]),
            row("mean pressure, MPa gauge", [f"{drive.pressure_mpa:.3f}" for drive in drives]),
            "",
            f"Table 1: 24 single strokes per minute at 0.80 MPa, claws 0.75 MPa. This run: {self.minutes:.2f} min.",
        ]
        return "\n".join(lines)


def air_of(recording: Recording) -> AirReport:
    """Return the air consumption of a recorded run.

    The formula uses the actual travel of each piston and, for every stroke, the tube volume of its line. The dead
    volume of the cylinder is added if no check valve retains the air in it.

    Args:
        recording: Recording of the run.

    Raises:
        RecordingError: A column is missing, or the recording has no duration.
    """
    window = recording.full_window
    if window.from_ms == window.to_ms:
        raise RecordingError(f"{recording.path}: contains only one sample; record a run")
    minutes = (window.to_ms - window.from_ms) / 60_000
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
    """Return the air used by one line (formula and valve flow, L ANR), the number of strokes and the travel (m)."""
    geometry, sign = recording.about["make"], 1.0 if port == "plus" else -1.0
    piston, spool, drawn = f"{cylinder}.piston_m", f"{cylinder}.valve.spool", f"{cylinder}.{port}.drawn_kg"
    data = recording.read([piston, spool, drawn])
    way_m = float(np.clip(sign * np.diff(data[piston]), 0.0, None).sum())
    fed = sign * data[spool] > _OPEN_SPOOL
    strokes = int(np.count_nonzero(fed[1:] & ~fed[:-1]))
    is_retained = bool(geometry[f"{cylinder}.{port}.checked"])
    filled_m3 = geometry[f"{cylinder}.{port}.tube_m3"] + (
        0.0 if is_retained else geometry[f"{cylinder}.{port}.dead_m3"]
    )
    formula_l = stroke_air_l(
        swept_l=1e3 * geometry[f"{cylinder}.{port}_area_m2"] * way_m,
        tube_l=1e3 * filled_m3 * strokes,
        pressure_mpa=pressure_mpa,
    )
    integrated_l = 1e3 * float(data[drawn][-1] - data[drawn][0]) / REFERENCE_KG_M3
    return formula_l, integrated_l, strokes, way_m


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:+.1f} %"
