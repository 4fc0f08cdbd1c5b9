"""All parameters of the simulated machine, and the only reader of ``machine.yaml``."""

import dataclasses
import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_type_hints

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from plant_sim.crop.handling import HandlingSpec
from plant_sim.crop.mechanics import SeedlingSpec
from plant_sim.crop.response import CropSpec
from plant_sim.crop.seedling import CELLS_ALONG, COLUMNS
from plant_sim.devices.claws import ClawsSpec
from plant_sim.devices.conveyor import ConveyorSpec
from plant_sim.devices.cups import CupsSpec
from plant_sim.devices.lift import LiftSpec
from plant_sim.devices.pneumatic import AirSpec, CheckValveSpec, FrictionSpec, Pneumatics, PortSpec, ValveSpec
from plant_sim.devices.sensor import ContactSpec
from plant_sim.devices.slide import SlideSpec
from plant_sim.devices.spreader import SpreaderSpec
from plant_sim.devices.supply import SupplySpec
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.quantity import unit_of
from plant_sim.spec import SpecError, require
from plant_sim.whole import LayoutSpec, RatingSpec, SimulationSpec

DEFAULT_MACHINE = Path(__file__).with_name("machine.yaml")

Value = bool | int | float

_MPA = 1e6


class MachineError(ValueError):
    """The parameters cannot be used; the text is one line: where, which key, what is wrong."""


@dataclass(frozen=True, slots=True)
class Machine:
    """One machine. Every section is a frozen spec, every field a parameter of ``machine.yaml``.

    Attributes:
        simulation: How finely it is simulated.
        rating: What the makers vouch for.
        layout: How it is put together.
        air: How air behaves.
        supply: Compressed air.
        valve: Switching of every valve.
        check_valve: Pilot check valves of slides and lifts.
        contact: Contacts of the switches.
        slide: The slides.
        slide_port: From the valve of a slide to its cylinder.
        slide_friction: Friction of a slide.
        lift: The lifts.
        lift_port: From the valve of a lift to its cylinder.
        lift_friction: Friction of a lift.
        claws: The claws.
        claws_port: From the valve of an arm's claws to their cylinders.
        claws_friction: Friction of one claw.
        spreader: The spreaders.
        conveyor: Tray conveyor and magazine.
        cups: The rotating cups.
        crop: Seedlings and how they are gripped; the pressure of the claws is here.
        seedling: Properties of seedlings and foam.
        handling: Distances that decide what happens to a seedling.
    """

    simulation: SimulationSpec
    rating: RatingSpec
    layout: LayoutSpec
    air: AirSpec
    supply: SupplySpec
    valve: ValveSpec
    check_valve: CheckValveSpec
    contact: ContactSpec
    slide: SlideSpec
    slide_port: PortSpec
    slide_friction: FrictionSpec
    lift: LiftSpec
    lift_port: PortSpec
    lift_friction: FrictionSpec
    claws: ClawsSpec
    claws_port: PortSpec
    claws_friction: FrictionSpec
    spreader: SpreaderSpec
    conveyor: ConveyorSpec
    cups: CupsSpec
    crop: CropSpec
    seedling: SeedlingSpec
    handling: HandlingSpec

    def __post_init__(self) -> None:
        """Refuse parts that do not fit together; the key in the error is dotted."""
        require(
            self.columns_m[COLUMNS // 2 - 1] + self.handling.reach_m < self.slide.stroke_m,
            "slide.stroke_m",
            "is too short to reach pick 3; lengthen it or reduce layout.row_spacing_m",
        )
        require(
            self.slide.overtravel_m * self.slide.area_m2 < 0.5 * self.slide_port.dead_volume_m3,
            "slide.overtravel_m",
            "takes more than half of slide_port.dead_volume_m3",
        )
        self._require_soft_air()
        switch_reach_m = self.slide.switch_band_m + self.slide.switch_hysteresis_m
        require(
            2 * switch_reach_m < self.handling.cell_pitch_m,
            "slide.switch_band_m",
            "lets the switches of two pick positions be on at once; make it narrower",
        )
        require(
            self.handling.stem_clearance_rise_m < self.lift.stroke_m,
            "handling.stem_clearance_rise_m",
            "must be less than lift.stroke_m, or no arm ever clears the seedlings",
        )
        claw_pitch_m = self.handling.cell_pitch_m + self.spreader.travel_m / (CELLS_ALONG - 1)
        require(
            abs(claw_pitch_m - self.cups.pitch_m) < 0.001,
            "spreader.travel_m",
            f"spreads the claws to {claw_pitch_m:.4g} m; it must be cups.pitch_m to a millimetre",
        )

    def _require_soft_air(self) -> None:
        """Refuse a cylinder that would swing on its air by too much of a turn in one step."""
        main_pa = self.supply.pressure_pa
        for section, area_m2, moved_kg, dead_m3, most_pa in (
            ("slide", self.slide.area_m2, self.slide.piston_kg, self.slide_port.dead_volume_m3, main_pa),
            ("lift", self.lift.area_m2, self.lift.carried_kg, self.lift_port.dead_volume_m3, main_pa),
            ("claws", self.claws.area_m2, self.claws.grippers * self.claws.moved_kg, self.claws_port.dead_volume_m3,
             self.claw_pressure_pa),
        ):  # fmt: skip
            # both chambers near an end: the stiffest spring that the air can be
            spring_n_m = 2 * self.air.stiffness_exponent * (most_pa + ATMOSPHERE_PA) * area_m2**2 / dead_m3
            turn = self.simulation.step_s * math.sqrt(spring_n_m / moved_kg)
            require(
                turn <= 1.5,
                f"{section}_port.dead_volume_m3",
                f"makes the air so stiff a spring that it swings by {turn:.3g} rad a step; at most 1.5: make the "
                "volume or what moves larger, or simulation.step_s smaller",
            )

    @property
    def columns_m(self) -> tuple[float, ...]:
        """Slide positions of the six columns of a tray, nearest first, m; the same on both sides.

        Source: MACHINE.md 1, half the row spacing minus 2.5, 1.5, 0.5 cell pitches.
        """
        middle_m = self.layout.row_spacing_m / 2
        return tuple(middle_m + (index - (COLUMNS - 1) / 2) * self.handling.cell_pitch_m for index in range(COLUMNS))

    @property
    def pneumatics(self) -> Pneumatics:
        """What every cylinder has in common."""
        return Pneumatics(self.air, self.valve, self.check_valve)

    @property
    def claw_pressure_pa(self) -> float:
        """Gauge pressure at which the regulator of the claws is set, Pa."""
        return self.crop.claw_pressure_mpa * _MPA

    @property
    def warnings(self) -> list[str]:
        """What lies outside the makers' ratings, one line each, the parameter first."""
        rating, main_pa, claws_pa = self.rating, self.supply.pressure_pa, self.claw_pressure_pa
        checks = [
            ("supply.pressure_pa", main_pa, rating.slide_least_pa, min(rating.slide_pa, self.slide.decouples_pa),
             "MPa", _MPA, "CY1S slide"),
            ("supply.pressure_pa", main_pa, 0.0, rating.lift_pa, "MPa", _MPA, "SC50 lift"),
            ("crop.claw_pressure_mpa", claws_pa, rating.claws_least_pa, rating.claws_pa, "MPa", _MPA, "MHC2 claws"),
            ("slide.throttle_conductance_m3_s_pa", self.slide.speed_m_s, rating.slide_least_m_s, rating.slide_m_s,
             "m/s", 1.0, "CY1S slide"),
            ("lift.extend_conductance_m3_s_pa", self.lift.extend_m_s, 0.0, rating.lift_m_s, "m/s", 1.0, "SC50 lift"),
            ("lift.retract_conductance_m3_s_pa", self.lift.retract_m_s, 0.0, rating.lift_m_s, "m/s", 1.0, "SC50 lift"),
        ]  # fmt: skip
        beyond = [
            f"{name}: {value / unit:.3g} {symbol} is outside the rating of the {part}, "
            f"{low / unit:g} to {high / unit:.3g} {symbol}"
            for name, value, low, high, symbol, unit, part in checks
            if not low <= value <= high
        ]
        held_pa = self.supply.compressor_on_pa - self.supply.check_crack_pa
        if claws_pa > held_pa:
            beyond.append(
                f"crop.claw_pressure_mpa: {claws_pa / _MPA:.4g} MPa is more than the receiver always holds behind the "
                f"check valve of the claws, {held_pa / _MPA:.4g} MPa; raise supply.compressor_on_pa"
            )
        if self.slide.recouples_m_s < self.slide.speed_m_s:
            beyond.append(
                f"slide.recouples_m_s: {self.slide.recouples_m_s:.3g} m/s is less than the speed of the piston, "
                f"{self.slide.speed_m_s:.3g} m/s: a carriage that is lost is never caught again"
            )
        return beyond

    @property
    def picks_m(self) -> tuple[float, ...]:
        """Slide positions of pick 1, 2 and 3, m."""
        return self.columns_m[: COLUMNS // 2]

    def with_values(self, values: Mapping[str, Value]) -> "Machine":
        """Return a machine that differs in some parameters.

        Args:
            values: New values by dotted name, for example
                ``{"cups.planting_frequency_per_min": 60}``.

        Raises:
            MachineError: a name is unknown or a value impossible.
        """
        sections: dict[str, dict[str, Value]] = {}
        for name, value in values.items():
            section, dot, key = name.partition(".")
            if not dot:
                raise MachineError(f"{name}: is no dotted name; write section.parameter")
            if section not in _section_types():
                raise MachineError(f"{name}: {_no_such('section', section, _section_types())}")
            sections.setdefault(section, {})[key] = value
        try:
            specs = {
                section: _build(section, dataclasses.asdict(getattr(self, section)) | changed)
                for section, changed in sections.items()
            }
            return dataclasses.replace(self, **specs)
        except SpecError as error:
            raise MachineError(f"{error.key}: {error.complaint}") from None


def load_machine(path: Path = DEFAULT_MACHINE) -> Machine:
    """Read and check the parameters of a machine.

    Args:
        path: The file; the machine's own by default.

    Raises:
        MachineError: the file cannot be read or anything in it is wrong.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise MachineError(f"{path}: cannot be read ({reason}); give another file") from None
    reader = _Reader(path)
    try:
        return reader.machine(text)
    except SpecError as error:
        line = reader.line_of(error.key)
        raise MachineError(f"{path}:{line}: {error.key}: {error.complaint}") from None


class _Entry(BaseModel):
    """One parameter as written."""

    model_config = ConfigDict(extra="forbid", strict=True)

    value: Value
    unit: str
    source: Literal["paper", "catalogue", "computed", "assumed"]
    note: str = ""


class _Reader:
    """Turns the text of one file into a machine, and remembers on which line each key stands."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lines: dict[str, int] = {}

    def line_of(self, key: str) -> int:
        """Line of a dotted key; of its section where the key itself is missing; else 1."""
        return self._lines.get(key) or self._lines.get(key.partition(".")[0], 1)

    def machine(self, text: str) -> Machine:
        """Build the machine.

        Raises:
            SpecError: with a dotted key.
            MachineError: the text is no YAML.
        """
        sections = {
            name: {key: self._value(f"{name}.{key}", node) for key, node in self._items(name, node)}
            for name, node in self._items("", self._compose(text))
        }
        for name in sections:
            if name not in _section_types():
                raise SpecError(name, _no_such("section", name, _section_types()))
        for name in _section_types():
            require(name in sections, name, "is missing; add the section")
        return Machine(**{name: _build(name, values) for name, values in sections.items()})

    def _compose(self, text: str) -> yaml.Node:
        try:
            root = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            line = mark.line + 1 if mark is not None else 1
            problem = getattr(error, "problem", None) or "not readable"
            raise MachineError(f"{self._path}:{line}: not YAML ({problem})") from None
        if root is None:
            raise MachineError(f"{self._path}:1: the file is empty")
        return root

    def _items(self, name: str, node: yaml.Node) -> list[tuple[str, yaml.Node]]:
        """The keys of a mapping, each noted with its line."""
        if not isinstance(node, yaml.MappingNode):
            raise SpecError(name or "the file", "must be a mapping: a key and a colon a line")
        items = []
        for key_node, value_node in node.value:
            key = str(key_node.value)
            dotted = f"{name}.{key}" if name else key
            twice = dotted in self._lines
            self._lines[dotted] = key_node.start_mark.line + 1
            require(not twice, dotted, "is there twice; delete one")
            items.append((key, value_node))
        return items

    def _value(self, name: str, node: yaml.Node) -> Value:
        self._items(name, node)  # no field twice
        try:
            entry = _Entry.model_validate(_plain(node))
        except ValidationError as error:
            raise SpecError(name, _complaint(error)) from None
        except (yaml.YAMLError, ValueError):
            raise SpecError(name, "holds something that is neither number, text nor true or false") from None
        unit = unit_of(name)
        require(entry.unit == unit, name, f"must have unit {unit}, not {entry.unit}")
        return entry.value


def _plain(node: yaml.Node) -> Any:
    """The Python value of a node."""
    loader = yaml.SafeLoader("")
    try:
        return loader.construct_document(node)
    finally:
        loader.dispose()


@cache
def _section_types() -> dict[str, Any]:
    """The spec class of every section."""
    return get_type_hints(Machine)


@cache
def _checker(section: str) -> type[BaseModel]:
    """A model that knows the keys and types of a section."""
    fields: dict[str, Any] = {key: (hint, ...) for key, hint in get_type_hints(_section_types()[section]).items()}
    return create_model(section, __config__=ConfigDict(extra="forbid", strict=True), **fields)


def _build(section: str, values: Mapping[str, Value]) -> Any:
    """Build the spec of a section; a SpecError names the dotted key."""
    keys = _checker(section).model_fields
    try:
        checked = _checker(section).model_validate(dict(values)).model_dump()
        return _section_types()[section](**checked)
    except ValidationError as error:
        unknown = next((key for key in values if key not in keys), None)
        if unknown is not None:  # told first: a misspelt key is also a missing one
            raise SpecError(f"{section}.{unknown}", _no_such("parameter", unknown, keys)) from None
        key = str(error.errors()[0]["loc"][0])
        raise SpecError(f"{section}.{key}", _complaint(error)) from None
    except SpecError as error:
        raise SpecError(f"{section}.{error.key}", error.complaint) from None


def _complaint(error: ValidationError) -> str:
    """The first complaint of pydantic as the end of a sentence that begins with the key."""
    first = error.errors()[0]
    field = str(first["loc"][0]) if first["loc"] else ""
    match first["type"]:
        case "missing":
            return "is missing; add it" if field not in _Entry.model_fields else f"has no {field}"
        case "extra_forbidden":
            return f"has no field {field}; there are {', '.join(_Entry.model_fields)}"
        case "literal_error":
            return f"must have {field} {first['ctx']['expected']}, not {first['input']!r}"
        case _ if field == "value" and isinstance(first["input"], str):
            return f"must be a number, not {first['input']!r}; powers of ten as 1.0e-9"
        case _ if field == "value":
            return f"must be a number, or true or false, not {first['input']!r}"
        case _:
            return f"must be {_wanted(str(first['type']))}, not {first['input']!r}"


def _wanted(error_type: str) -> str:
    """What a value should have been, by pydantic's name of the mistake."""
    if error_type.startswith("bool"):
        return "true or false"
    return "a whole number" if error_type.startswith("int") else "a number"


def _no_such(what: str, name: str, known: Mapping[str, Any]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
    return f"is no {what} of the machine; {hint}"
