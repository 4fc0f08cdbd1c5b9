"""Parameters of the simulated chain planter, and the reader of ``planter.yaml``."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from controller.common.errors import InputError
from plant_sim.common.defaults import DEFAULT_PLANTER
from plant_sim.common.parameter_file import ParameterReader, RangedEntry, Value
from plant_sim.planter.block import BlockSpec
from plant_sim.planter.chain import ChainSpec
from plant_sim.planter.grip import GripSpec
from plant_sim.planter.ground import GroundSpec, ScatterSpec


class PlanterError(InputError):
    """Invalid planter parameters; the one-line message states the location, the key and the problem."""


@dataclass(frozen=True, slots=True)
class Planter:
    """Parameters of a chain planter: one frozen spec per section of ``planter.yaml``, one field per parameter.

    Attributes:
        chain: Chain, and points of a planter.
        block: Block with its seedling.
        grip: Inner plates, guide plate and opener.
        rigid_ground: Ground of the paper's simulation.
        bench_soil: Soil of the bench test.
        scatter: Scatter of the release on the bench.
    """

    chain: ChainSpec
    block: BlockSpec
    grip: GripSpec
    rigid_ground: GroundSpec
    bench_soil: GroundSpec
    scatter: ScatterSpec

    def with_values(self, values: Mapping[str, Value]) -> "Planter":
        """Return a planter with some parameters changed.

        Args:
            values: New values by dotted name, for example ``{"chain.offset_m": 0.02}``.

        Raises:
            PlanterError: A name is unknown or a value is invalid.
        """
        return _READER.changed(self, values)


_READER = ParameterReader(Planter, PlanterError, subject="planter", entry=RangedEntry)


def load_planter(path: Path = DEFAULT_PLANTER) -> Planter:
    """Read and validate the parameters of a chain planter.

    Args:
        path: Parameter file; by default the one in the package.

    Raises:
        PlanterError: The file cannot be read or is invalid.
    """
    return _READER.load(path)


def load_ranges(path: Path = DEFAULT_PLANTER) -> dict[str, tuple[float, float]]:
    """Return the plausible ranges of unpublished parameters by dotted name, as (low, high).

    Args:
        path: Parameter file; by default the one in the package.

    Raises:
        PlanterError: The file cannot be read or is invalid.
    """
    ranges = {name: entry.range for name, entry in _READER.entries(path).items() if isinstance(entry, RangedEntry)}
    return {name: (limits[0], limits[1]) for name, limits in ranges.items() if limits is not None}


def assumed_names(path: Path = DEFAULT_PLANTER) -> tuple[str, ...]:
    """Return the dotted names of the parameters whose source is an assumption, in the order of the file.

    Args:
        path: Parameter file; by default the one in the package.

    Raises:
        PlanterError: The file cannot be read or is invalid.
    """
    return tuple(name for name, entry in _READER.entries(path).items() if entry.source == "assumed")
