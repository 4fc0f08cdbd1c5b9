"""Reader of line files and ground files; a file is checked completely before the run starts.

Quantities are strings with a unit. A string may end with the source of the value, such as ``0.2 s, assumed``; the
result lists the assumed values.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, Field, model_validator

from controller.common.suggestion import suggestion
from controller.common.yaml_lines import LocatedMapping, dotted, read_yaml, unfold
from controller.common.yaml_model import StrictModel, validated
from plant_sim.common.units import QuantityError, parse_quantity
from plant_sim.line.errors import LineError
from plant_sim.line.quantities import (
    Acceleration,
    Cycles,
    Distance,
    Duration,
    Efficiency,
    Factor,
    FieldLength,
    Force,
    Grade,
    Lag,
    Patch,
    Phase,
    Rate,
    Seedlings,
    Share,
    Slip,
    Spacing,
    Speed,
    Width,
    is_bare,
)

LINES = Path(__file__).with_name("lines")

_DEPTH = 4
_SOURCE = re.compile(r"(.*),\s*(paper|catalogue|computed|assumed)\s*")
_File = TypeVar("_File", bound="SourcedFile")


def _count(value: object) -> object:
    """Return the number if the value is a string of digits; a number with a source is written as a string."""
    return int(value) if isinstance(value, str) and value.isdecimal() else value


def _assumed(text: str) -> Any:
    """Return a field whose default is an assumed value, written as in a file."""
    return Field(text, validate_default=True)


class Extent(BaseModel):
    """Length or duration of a segment; one of the two is None."""

    for_m: float | None = None
    for_s: float | None = None


def _extent(value: object) -> Extent:
    text = str(value)
    try:
        return Extent(for_m=_positive(parse_quantity(text, "m"), text))
    except QuantityError:
        return Extent(for_s=_positive(parse_quantity(text, "s"), text))


def _positive(number: float, text: str) -> float:
    if is_bare(text) or number <= 0:
        raise ValueError(f"{text!r}: must be a length or a time above 0 with its unit, such as 200 m or 60 s")
    return number


class SegmentEntry(StrictModel):
    """Segment of the ground: a speed, a ramp, a hill or a stop."""

    speed: Speed | None = None
    ramp_to: Speed | None = None
    hill: Grade | None = None
    stand: Duration | None = None
    over: Annotated[Extent | None, BeforeValidator(_extent)] = None

    @model_validator(mode="after")
    def _check(self) -> SegmentEntry:
        kinds = [kind for kind in ("speed", "ramp_to", "hill", "stand") if getattr(self, kind) is not None]
        if len(kinds) != 1:
            raise ValueError("must contain exactly one of speed, ramp_to, hill and stand")
        if (self.over is None) != (kinds == ["stand"]):
            raise ValueError(f"{kinds[0]} {'has its own duration; remove over' if self.over else 'requires over'}")
        return self


class SlipEntry(StrictModel):
    """Slip of the ground wheel."""

    mean: Slip = Field(description="write the mean slip, such as 5 %")
    sd: Slip = 0.0
    patch: Patch = 1.0


class HillEntry(StrictModel):
    """Effect of a grade on speed and slip."""

    speed_loss: Factor = 0.0
    slip_gain: Factor = 0.0


class SourcedFile(StrictModel):
    """File whose quantities may state their source."""


class GroundEntry(SourcedFile):
    """Speed profile and slip, in a line file or in a ground file."""

    acceleration: Acceleration = 0.3
    segments: list[SegmentEntry] = Field(min_length=1, description="write a list such as [{speed: 1 km/h, over: 9 m}]")
    slip: SlipEntry | None = None
    hill: HillEntry = HillEntry()

    @model_validator(mode="after")
    def _check(self) -> GroundEntry:
        if self.segments[0].speed is None and self.segments[0].ramp_to is None:
            raise ValueError(
                "the first segment must have a speed or ramp_to, because the tractor starts from standstill"
            )
        return self


class DriveEntry(StrictModel):
    """Drive of cups and planters."""

    kind: Literal["ground_wheel", "own_motor"] = Field(description="write ground_wheel or own_motor")
    set_for_slip: Slip = 0.0
    lag: Lag | None = None

    @model_validator(mode="after")
    def _check(self) -> DriveEntry:
        if (self.kind == "own_motor") != (self.lag is not None):
            raise ValueError("own_motor requires lag" if self.lag is None else "lag does not apply to ground_wheel")
        if self.kind == "own_motor" and self.set_for_slip:
            raise ValueError("set_for_slip does not apply to own_motor; remove it")
        return self


class ConveyorEntry(StrictModel):
    """Conveyor that presents single blocks to the planters."""

    rate: Rate = Field(description="write the highest feeding rate, such as 90/min")
    gaps: Share = 0.0
    dropped: Share = 0.0


class ArmsEntry(StrictModel):
    """Twin arms that fill two rows of cups from trays."""

    cups_to_planting: Annotated[int, BeforeValidator(_count)] = Field(
        ge=0, le=1000, description="write the number of cups from the last claw to planting, 0 to 1000"
    )


class NozzleEntry(StrictModel):
    """Planting nozzle of the base machine."""

    fall: Duration
    scatter: Distance = 0.0
    depth: Distance
    depth_scatter: Distance = 0.0
    tilted: Share = 0.0
    lodged: Share = 0.0
    injured: Share = 0.0
    unreleased: Share = 0.0

    @model_validator(mode="after")
    def _check(self) -> NozzleEntry:
        if self.tilted + self.lodged > 1:
            raise ValueError("tilted and lodged add up to more than 100 %")
        return self


class ChuteEntry(StrictModel):
    """Chute from a cup to the planter below it.

    The phase is set on the machine: the planting cycles from the cup above the chute to the middle of the catch window.
    It is given directly, or by the planting frequency at which a plug with the mean transit time arrives in this
    middle; without either, that frequency follows from the ground.
    """

    transit: Duration
    scatter: Duration = 0.0
    window: Share = Field(description="write the catch window as a share of the planting cycle, such as 40 %")
    phase: Phase | None = None
    design_frequency: Rate | None = None
    phase_error: Cycles = 0.0
    most_lost: Share = _assumed("1 %")

    @model_validator(mode="after")
    def _check(self) -> ChuteEntry:
        if self.phase is not None and self.design_frequency is not None:
            raise ValueError("phase and design_frequency state the same setting; remove one of them")
        return self


class PlanterEntry(StrictModel):
    """Chain planter."""

    soil: Literal["bench_soil", "rigid_ground"] = Field("bench_soil", description="write bench_soil or rigid_ground")
    clamp: Force | None = None
    unreleased: Share = 0.0


class TargetsEntry(StrictModel):
    """Targets by which a row is judged; all defaults are assumed.

    Targets of a standard are not included, because no text of one was available.
    """

    qualified: Share = _assumed("85 %")
    upright: Share = _assumed("90 %")
    tilted: Share = _assumed("10 %")
    lodged: Share = _assumed("5 %")
    scraped: Share = _assumed("1 %")
    injured: Share = _assumed("5 %")
    missed: Share = _assumed("5 %")
    double: Share = _assumed("2 %")
    depth: Distance = _assumed("60 mm")
    depth_tolerance: Distance = _assumed("20 mm")
    depth_cv: Share = _assumed("20 %")
    depth_qualified: Share = _assumed("80 %")
    spacing_deviation: Share = _assumed("10 %")
    spacing_cv: Share = _assumed("20 %")
    spacing_quality: Share = _assumed("90 %")


class WorkEntry(StrictModel):
    """Field, turning and reloading, for the area capacity; all defaults are assumed."""

    row_length: FieldLength = _assumed("100 m")
    row_spacing: Width = _assumed("60 cm")
    turn: Duration = _assumed("30 s")
    load: Seedlings = _assumed("1440")
    reload: Duration = _assumed("5 min")
    compressor: Efficiency = _assumed("50 %")


class LineFile(SourcedFile):
    """Line: a feed, a planting device, a drive and the ground, with a chute between arms and planter."""

    title: str = Field(min_length=1, description="write the title in quotes")
    spacing: Spacing = Field(description="write the target plant spacing, such as 40 cm")
    drive: DriveEntry = Field(description="write a section with kind: ground_wheel or own_motor")
    ground: GroundEntry = Field(description="write a section with segments")
    conveyor: ConveyorEntry | None = None
    arms: ArmsEntry | None = None
    chute: ChuteEntry | None = None
    nozzle: NozzleEntry | None = None
    planter: PlanterEntry | None = None
    targets: TargetsEntry = TargetsEntry()
    work: WorkEntry = WorkEntry()

    @model_validator(mode="after")
    def _check(self) -> LineFile:
        if (self.conveyor is None) == (self.arms is None):
            raise ValueError("must contain either conveyor or arms")
        if (self.nozzle is None) == (self.planter is None):
            raise ValueError("must contain either nozzle or planter")
        if self.conveyor is not None and self.planter is None:
            raise ValueError("a conveyor feeds a planter; replace nozzle by planter")
        if (self.chute is not None) != (self.arms is not None and self.planter is not None):
            raise ValueError("chute is required between arms and planter, and only there")
        return self


class Sourced(StrictModel):
    """File with a list of its assumed values.

    Attributes:
        path: Path of the file.
        assumed: Key and value, as text, of every value that is marked as assumed.
    """

    path: Path
    assumed: tuple[str, ...]


class SourcedLine(Sourced):
    """Line with a list of its assumed values."""

    values: LineFile


class SourcedGround(Sourced):
    """Ground with a list of its assumed values."""

    values: GroundEntry


def lines() -> dict[str, Path]:
    """Return the included lines by name."""
    return {path.stem: path for path in sorted(LINES.glob("*.yaml"))}


def find_line(name: str) -> Path:
    """Return the path of a line file.

    Args:
        name: Path, or name of an included line.

    Raises:
        LineError: There is no such file or line.
    """
    path, included = Path(name), lines()
    if name in included and not path.is_file():
        return included[name]
    if path.suffix or path.exists():
        return path
    raise LineError(f"{name}: unknown line; {suggestion(name, included)} (or specify the path of a YAML file)")


def load_line(path: Path) -> SourcedLine:
    """Read a line and check it completely.

    Raises:
        LineError: The file cannot be read or is invalid.
    """
    values, assumed = _load(path, LineFile)
    return SourcedLine(path=path, assumed=(*assumed, *_defaults(values)), values=values)


def _defaults(line: LineFile) -> list[str]:
    """Return key and default, as text, of every assumed value that a line file does not state."""
    sections = {"targets": line.targets, "work": line.work, "chute": line.chute}
    return [
        f"{section}.{name} {field.default} (default)"
        for section, entry in sections.items()
        if entry is not None
        for name, field in type(entry).model_fields.items()
        if field.validate_default and name not in entry.model_fields_set
    ]


def load_ground(path: Path) -> SourcedGround:
    """Read a ground file and check it completely.

    Raises:
        LineError: The file cannot be read or is invalid.
    """
    values, assumed = _load(path, GroundEntry)
    return SourcedGround(path=path, assumed=assumed, values=values)


def _load(path: Path, model: type[_File]) -> tuple[_File, tuple[str, ...]]:
    """Return the values of a file, and a list of the assumed ones."""
    located = unfold(read_yaml(path, LineError), depth=_DEPTH)
    assumed: list[str] = []
    plain = _without_sources(located.values, (), assumed)
    assert isinstance(plain, dict)  # noqa: S101 - the file is a mapping
    located = LocatedMapping(plain, located.lines, located.faults)
    values = validated(model, located)
    if values is None or located.faults:
        first = min(located.faults, key=lambda fault: (fault.path not in located.lines, fault.line))
        raise LineError(f"{path}:{first}")
    return values, tuple(assumed)


def _without_sources(value: object, path: tuple[str | int, ...], assumed: list[str]) -> object:
    """Return a value with the sources removed from its strings; append each assumed value to `assumed`."""
    if isinstance(value, dict):
        return {key: _without_sources(each, (*path, key), assumed) for key, each in value.items()}
    if isinstance(value, list):
        return [_without_sources(each, (*path, index), assumed) for index, each in enumerate(value)]
    match = _SOURCE.fullmatch(value) if isinstance(value, str) and path != ("title",) else None
    if match is None:
        return value
    if match[2] == "assumed":
        assumed.append(f"{dotted(path)} {match[1].strip()}")
    return match[1].strip()
