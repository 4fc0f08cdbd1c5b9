"""Air consumption of a cylinder and its tubes, computed with the data-sheet formula used for Table 1 of the paper.

For each stroke, the swept volume is multiplied by the absolute pressure. The tube volume is multiplied by the gauge
pressure only, because the tube retains air at atmospheric pressure. Both products are divided by the atmospheric
pressure:

    Q = n [pi/4 D^2 H (p + 0.1) + pi/4 d^2 L p] / 0.1

D is the bore, H the stroke, d the inner diameter of the tube, L its length, p the gauge pressure in MPa and
n the number of single strokes per minute. The rod is neglected.
Source: data sheet of a cylinder manufacturer, docs/sources/plant.md 0.1 and 4.
"""

import math
from dataclasses import dataclass

DATA_SHEET_ATMOSPHERE_MPA = 0.1
"""Atmospheric pressure in the formula, MPa. Source: the same data sheet."""

_MM3_A_LITRE = 1e6


@dataclass(frozen=True, slots=True)
class Sizing:
    """One row of a sizing table.

    Attributes:
        name: Name of the sized drive.
        bore_mm: Bore, mm.
        stroke_mm: Stroke, mm.
        tube_inner_mm: Inner diameter of the tubes, mm.
        tube_length_mm: Length of tube filled by a stroke, mm.
        pressure_mpa: Gauge pressure, MPa.
        strokes_per_min: Total single strokes of all cylinders of this kind, 1/min.
    """

    name: str
    bore_mm: float
    stroke_mm: float
    tube_inner_mm: float
    tube_length_mm: float
    pressure_mpa: float
    strokes_per_min: float

    @property
    def air_l_min(self) -> float:
        """Air consumption, L/min ANR."""
        return self.strokes_per_min * stroke_air_l(
            swept_l=cylinder_l(self.bore_mm, self.stroke_mm),
            tube_l=cylinder_l(self.tube_inner_mm, self.tube_length_mm),
            pressure_mpa=self.pressure_mpa,
        )


TABLE_1 = (
    Sizing("slide", 25.0, 600.0, 6.0, 5800.0, 0.80, 24.0),
    Sizing("lift", 50.0, 150.0, 6.0, 5200.0, 0.80, 24.0),
    Sizing("claws", 16.0, 10.0, 4.0, 7600.0, 0.75, 24.0),
)
"""Table 1 of the paper: two arms, two strokes per cycle, 6 cycles/min.

The printed inner diameters of the tubes are 6 and 4 mm. The paper prints no pressure: 0.80 and 0.75 MPa are the only
round values that reproduce its figures. They are sizing values; a CY1S is rated to 0.7 MPa, an MHC2 to 0.6 MPa. Source:
the paper; docs/sources/plant.md 0.1 to 0.3, 0.6 and 0.7.
"""

TABLE_1_PRINTED_L_MIN = {"slide": 95, "lift": 91, "claws": 17}
"""Values printed in Table 1, L/min. Source: the paper."""


def table_1_l_min() -> dict[str, int]:
    """Return Table 1 of the paper computed by the formula, L/min ANR, truncated as in the paper.

    >>> table_1_l_min()
    {'slide': 95, 'lift': 91, 'claws': 17}
    """
    return {sizing.name: math.trunc(sizing.air_l_min) for sizing in TABLE_1}


def cylinder_l(diameter_mm: float, length_mm: float) -> float:
    """Return the volume of a cylinder bore or a tube, L.

    >>> round(cylinder_l(25.0, 600.0), 4)
    0.2945
    """
    return math.pi / 4 * diameter_mm**2 * length_mm / _MM3_A_LITRE


def stroke_air_l(
    *, swept_l: float, tube_l: float, pressure_mpa: float, atmosphere_mpa: float = DATA_SHEET_ATMOSPHERE_MPA
) -> float:
    """Return the air consumed by one stroke, L ANR.

    Args:
        swept_l: Volume swept by the piston on the pressurised side, L.
        tube_l: Volume between valve and piston refilled by the stroke, L.
        pressure_mpa: Gauge pressure, MPa.
        atmosphere_mpa: Atmospheric pressure, MPa.

    A tube 2 m long with an inner diameter of 6 mm at 0.5 MPa, filled twice per cycle:

    >>> round(2 * stroke_air_l(swept_l=0.0, tube_l=cylinder_l(6.0, 2000.0), pressure_mpa=0.5), 2)
    0.57
    """
    return (swept_l * (pressure_mpa + atmosphere_mpa) + tube_l * pressure_mpa) / atmosphere_mpa
