"""Block of substrate with a seedling, as a rigid body composed of a cube and a stem.

Source: cabbage paper, 2.2.2: a cube with an edge of 40 mm, and a stem with a diameter of 10 mm and a length of 45 mm,
without leaves.
"""

from dataclasses import dataclass

from plant_sim.common.limits import require, require_within


@dataclass(frozen=True, slots=True)
class BlockSpec:
    """Parameters of a block.

    Attributes:
        edge_m: Edge of the cube, m.
        stem_diameter_m: Diameter of the stem, m.
        stem_length_m: Length of the stem above the cube, m.
        cube_kg: Mass of the cube, kg.
        stem_kg: Mass of the seedling, distributed uniformly over the stem, kg.
    """

    edge_m: float
    stem_diameter_m: float
    stem_length_m: float
    cube_kg: float
    stem_kg: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.01, 0.15, "edge_m")
        require_within(self, 0.001, 0.05, "stem_diameter_m")
        require_within(self, 0.005, 0.5, "stem_length_m")
        require_within(self, 0.001, 2.0, "cube_kg", "stem_kg")
        require(self.stem_diameter_m < self.edge_m, "stem_diameter_m", "must be less than edge_m")

    @property
    def mass_kg(self) -> float:
        """Mass of cube and seedling, kg."""
        return self.cube_kg + self.stem_kg

    @property
    def height_m(self) -> float:
        """Height of cube and stem, m."""
        return self.edge_m + self.stem_length_m

    @property
    def centre_m(self) -> float:
        """Height of the centre of mass above the base, m."""
        moment_kg_m = self.cube_kg * self.edge_m / 2 + self.stem_kg * (self.edge_m + self.stem_length_m / 2)
        return moment_kg_m / self.mass_kg

    @property
    def inertia_kg_m2(self) -> float:
        """Moment of inertia about the horizontal axis through the centre of mass, across the row, kg m2."""
        cube_m = self.centre_m - self.edge_m / 2
        stem_m = self.edge_m + self.stem_length_m / 2 - self.centre_m
        cube_kg_m2 = self.cube_kg * (self.edge_m**2 / 6 + cube_m**2)
        radius_m = self.stem_diameter_m / 2
        return cube_kg_m2 + self.stem_kg * (radius_m**2 / 4 + self.stem_length_m**2 / 12 + stem_m**2)
