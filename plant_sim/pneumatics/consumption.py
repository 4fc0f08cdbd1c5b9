"""How much air a cylinder with its tubes uses: the formula of data sheets, with which Table 1 of the paper was made.

A stroke fills the swept volume to the absolute pressure, and the tube, which keeps its air at the pressure of
the atmosphere, by the gauge pressure only. Both are told as the volume the air takes at the atmosphere:

    Q = n [pi/4 D^2 H (p + 0.1) + pi/4 d^2 L p] / 0.1

with D and d the bore and the inner diameter of the tube, H and L their lengths, p the gauge pressure in MPa
and n the number of single strokes in a minute. The rod is neglected.
Source: data sheet of a maker of cylinders, PLANT.md fact 1 and section 4.
"""

import math
from dataclasses import dataclass

#: Pressure of the atmosphere in the formula, MPa. Source: the same.
DATA_SHEET_ATMOSPHERE_MPA = 0.1

_MM3_A_LITRE = 1e6


@dataclass(frozen=True, slots=True)
class Sizing:
    """One line of a sizing table.

    Attributes:
        name: What it sizes.
        bore_mm: Bore, mm.
        stroke_mm: Stroke, mm.
        tube_inner_mm: Inner diameter of the tubes, mm.
        tube_length_mm: Length of tube that a stroke fills, mm.
        pressure_mpa: Gauge pressure, MPa.
        strokes_per_min: Single strokes of all such cylinders together, 1/min.
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
        """Air it uses, L/min ANR."""
        return self.strokes_per_min * stroke_air_l(
            swept_l=cylinder_l(self.bore_mm, self.stroke_mm),
            tube_l=cylinder_l(self.tube_inner_mm, self.tube_length_mm),
            pressure_mpa=self.pressure_mpa,
        )


#: Table 1 of the paper: two arms, two strokes a cycle, 6 cycles/min. The printed tube inner diameters are 6 and
#: 4 mm. The paper prints no pressure: 0.80 and 0.75 MPa are the only round ones that give its figures. They are
#: for sizing; a CY1S is rated to 0.7 MPa, an MHC2 to 0.6 MPa. Source: the paper; PLANT.md facts 1 to 3, 6 and 7.
TABLE_1 = (
    Sizing("slide", 25.0, 600.0, 6.0, 5800.0, 0.80, 24.0),
    Sizing("lift", 50.0, 150.0, 6.0, 5200.0, 0.80, 24.0),
    Sizing("claws", 16.0, 10.0, 4.0, 7600.0, 0.75, 24.0),
)

#: What Table 1 prints, L/min. Source: the paper.
TABLE_1_PRINTED_L_MIN = {"slide": 95, "lift": 91, "claws": 17}


def table_1_l_min() -> dict[str, int]:
    """Return Table 1 of the paper as the formula gives it, L/min ANR: truncated, as the paper does.

    >>> table_1_l_min()
    {'slide': 95, 'lift': 91, 'claws': 17}
    """
    return {sizing.name: math.trunc(sizing.air_l_min) for sizing in TABLE_1}


def cylinder_l(diameter_mm: float, length_mm: float) -> float:
    """Return the volume of a bore or a tube, L.

    >>> round(cylinder_l(25.0, 600.0), 4)
    0.2945
    """
    return math.pi / 4 * diameter_mm**2 * length_mm / _MM3_A_LITRE


def stroke_air_l(
    *, swept_l: float, tube_l: float, pressure_mpa: float, atmosphere_mpa: float = DATA_SHEET_ATMOSPHERE_MPA
) -> float:
    """Return the air that one stroke takes, L ANR.

    Args:
        swept_l: Volume that the piston sweeps on the side that is fed, L.
        tube_l: Volume between valve and piston that the stroke fills anew, L.
        pressure_mpa: Gauge pressure, MPa.
        atmosphere_mpa: Pressure of the atmosphere, MPa.

    A tube of 2 m with 6 mm inside at 0.5 MPa, filled twice a cycle:

    >>> round(2 * stroke_air_l(swept_l=0.0, tube_l=cylinder_l(6.0, 2000.0), pressure_mpa=0.5), 2)
    0.57
    """
    return (swept_l * (pressure_mpa + atmosphere_mpa) + tube_l * pressure_mpa) / atmosphere_mpa
