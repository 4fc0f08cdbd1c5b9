"""Area capacity of a line with headlands and reloading, and the air and the energy of its plants."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Final

from plant_sim.line.file import WorkEntry
from plant_sim.line.run import LineRun
from plant_sim.machine.parameters import Machine
from plant_sim.pneumatics.flow import ATMOSPHERE_PA

_S_PER_H: Final = 3600.0
_M2_PER_HA: Final = 10_000.0
_J_PER_KWH: Final = 3.6e6


@dataclass(frozen=True, slots=True)
class AreaCapacity:
    """Capacity of a line over a day, and its consumption per 1,000 plants.

    Attributes:
        width_m: Working width: rows times their distance, m.
        ha_per_h: Planted area per hour, with headlands and reloading.
        plants_per_h: Plants per hour, with headlands and reloading.
        efficiency: Share of the time in which plants are planted.
        turning: Share of the time on the headlands.
        reloading: Share of the time for reloading.
        air_l_per_1000: Air of the arms per 1,000 plants, L ANR; None without arms.
        kwh_per_1000: Electrical energy of the compressor for it, kWh; None without arms.
    """

    width_m: float
    ha_per_h: float
    plants_per_h: float
    efficiency: float
    turning: float
    reloading: float
    air_l_per_1000: float | None
    kwh_per_1000: float | None

    def record(self) -> dict[str, object]:
        """Return the capacity as a JSON object."""
        return asdict(self)

    def lines(self) -> list[str]:
        """Return the capacity as lines of text."""
        lines = [
            f"area capacity {self.ha_per_h:.3f} ha/h, {self.plants_per_h:,.0f} plants/h over a width of "
            f"{self.width_m:.2f} m: planting {100 * self.efficiency:.0f} % of the time, headlands "
            f"{100 * self.turning:.0f} %, reloading {100 * self.reloading:.0f} %"
        ]
        if self.air_l_per_1000 is not None and self.kwh_per_1000 is not None:
            lines.append(
                f"air {self.air_l_per_1000:,.0f} L ANR and {self.kwh_per_1000:.2f} kWh of the compressor per 1,000 "
                "plants; traction and electric drives are not modelled"
            )
        return lines


def area_capacity(work: WorkEntry, run: LineRun, machine: Machine, *, metres: float) -> AreaCapacity | None:
    """Return the capacity of a line at the speed of a run; None for fewer than two releases.

    The electrical energy is the isothermal work that compresses the air to the mean pressure of the receiver, divided
    by the efficiency of the compressor.

    Args:
        work: Size of the field, and times for turning and reloading.
        run: Run of the line.
        machine: Parameters of the machine, for the pressure of its compressor.
        metres: Length of the rows of the run, m.
    """
    rows, plants = run.rows, sum(int(row.seedlings.sum()) for row in run.rows)
    planting_s = float(max(row.time_s[-1] for row in rows) - min(row.time_s[0] for row in rows))
    if not planting_s or not plants:
        return None
    width_m = len(rows) * work.row_spacing
    of_row = work.row_length / metres
    planting_s *= of_row
    reloading_s = work.reload * of_row * sum(row.released for row in rows) / work.load
    whole_s = planting_s + work.turn + reloading_s
    air_l = None if run.air_l_min is None else run.air_l_min * planting_s / 60 / (plants * of_row) * 1000
    return AreaCapacity(
        width_m=width_m,
        ha_per_h=width_m * work.row_length / _M2_PER_HA * _S_PER_H / whole_s,
        plants_per_h=plants * of_row * _S_PER_H / whole_s,
        efficiency=planting_s / whole_s,
        turning=work.turn / whole_s,
        reloading=reloading_s / whole_s,
        air_l_per_1000=air_l,
        kwh_per_1000=None if air_l is None else _compressor_kwh(air_l, machine, work.compressor),
    )


def _compressor_kwh(air_l: float, machine: Machine, efficiency: float) -> float:
    gauge_pa = (machine.supply.compressor_on_pa + machine.supply.compressor_off_pa) / 2
    isothermal_j = ATMOSPHERE_PA * air_l / 1000 * math.log(1 + gauge_pa / ATMOSPHERE_PA)
    return isothermal_j / efficiency / _J_PER_KWH
