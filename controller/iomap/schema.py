"""Schema of ``io_map.yaml``: the tags that the program requires and the fields of an entry.

Only ``controller.iomap.loader`` uses this module; import from the loader instead.
"""

import enum
import re
from dataclasses import dataclass
from typing import Annotated, Literal, cast

from pydantic import Field, ValidationInfo, field_validator

from controller.common.yaml_lines import shown
from controller.common.yaml_model import StrictModel

_LAST_NUMBER = 0o377
"""X377 and Y377 are the last addresses of the FX2N."""


class Polarity(enum.StrEnum):
    """Relation between the logical state of a point and its terminal level."""

    NORMALLY_OPEN = "normally_open"
    NORMALLY_CLOSED = "normally_closed"
    ACTIVE_HIGH = "active_high"
    ACTIVE_LOW = "active_low"


class ModbusTable(enum.StrEnum):
    """Modbus table of the I/O module that contains a point."""

    DISCRETE_INPUT = "discrete_input"
    COIL = "coil"


# --- Tags ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PointKind:
    """Common properties of all inputs, or of all outputs.

    Attributes:
        noun: Noun for messages.
        section: Section of the file that contains the required tags.
        device: Letter of the address.
        table: Modbus table.
        polarities: The two valid polarities.
        required: Tags that the machine requires.
        optional: Tags that the program uses only if they are wired.
    """

    noun: str
    section: str
    device: str
    table: ModbusTable
    polarities: tuple[Polarity, Polarity]
    required: tuple[str, ...]
    optional: tuple[str, ...]

    def section_of(self, tag: str) -> str:
        """Return the section of the file that contains a tag."""
        return self.section if tag in self.required else OPTIONAL


def _both_arms(*names: str) -> tuple[str, ...]:
    return tuple(f"{side}.{name}" for side in ("left", "right") for name in names)


OPTIONAL = "optional"
INPUT = PointKind(
    noun="input",
    section="inputs",
    device="X",
    table=ModbusTable.DISCRETE_INPUT,
    polarities=(Polarity.NORMALLY_OPEN, Polarity.NORMALLY_CLOSED),
    required=(
        "start",
        *_both_arms("lift_down", "lift_up"),
        *_both_arms("slide_at_feed", "slide_at_pick_1", "slide_at_pick_2", "slide_at_pick_3"),
        "tray_front_edge",
        *_both_arms("claws_spread", "claws_converged"),
        *_both_arms("cup_pulse"),
        "stop",
        "emergency_stop",
    ),
    optional=("reset", "air_pressure_ok", "magazine_empty"),
)
OUTPUT = PointKind(
    noun="output",
    section="outputs",
    device="Y",
    table=ModbusTable.COIL,
    polarities=(Polarity.ACTIVE_HIGH, Polarity.ACTIVE_LOW),
    required=(
        "tray_run",
        *_both_arms("lift_extend", "lift_retract"),
        *_both_arms("slide_inward", "slide_outward"),
        *_both_arms("converge", "spread"),
        *_both_arms("claws_open", "claws_close"),
        "tray_forward",
    ),
    optional=("horn", "lamp_red", "lamp_amber", "lamp_green"),
)
KIND_OF = {tag: kind for kind in (INPUT, OUTPUT) for tag in kind.required + kind.optional}
SECTIONS = (INPUT.section, OUTPUT.section, OPTIONAL)


# --- Entries ------------------------------------------------------------------------------------


def _kind(info: ValidationInfo) -> PointKind:
    return cast("PointKind", info.context)


class Modbus(StrictModel):
    """Modbus address of a point on the I/O module. The validation context is the `PointKind` of the point."""

    table: Annotated[  # strict mode does not accept a string for an enum member
        ModbusTable, Field(strict=False, description="write discrete_input (inputs) or coil (outputs)")
    ]
    offset: int = Field(ge=0, le=65_535, description="write a decimal number from 0 to 65535, without quotes")

    @field_validator("table")
    @classmethod
    def _of_its_kind(cls, table: ModbusTable, info: ValidationInfo) -> ModbusTable:
        kind = _kind(info)
        if table is not kind.table:
            raise ValueError(f"{table} does not contain {kind.noun}s; write {kind.table}")
        return table


class Entry(StrictModel):
    """Entry of a wire as written in the file. The validation context is the `PointKind` of the point."""

    tag: str
    address: str = Field(description="write X or Y and octal digits, for example X10")
    meaning: str = Field(min_length=1, description="write the meaning of the active state in quotes")
    polarity: Annotated[
        Polarity,
        Field(
            strict=False,
            description="write normally_open or normally_closed (inputs), active_high or active_low (outputs)",
        ),
    ]
    safe: Literal["active", "inactive"] = Field(description="write active or inactive")
    modbus: Modbus = Field(
        description="write {table: discrete_input, offset: 1} (inputs) or {table: coil, offset: 1} (outputs)"
    )

    @field_validator("address")
    @classmethod
    def _on_the_plc(cls, address: str, info: ValidationInfo) -> str:
        kind = _kind(info)
        device, digits = address[:1], address[1:]
        example = f"write {kind.device} and octal digits, for example {kind.device}10"
        if not re.fullmatch("[XY][0-9]{1,4}", address):
            raise ValueError(f"{shown(address)} is not an address; {example}")
        if device != kind.device:
            raise ValueError(f"{address} cannot be an {kind.noun}; {example}")
        if not re.fullmatch("[0-7]+", digits):
            raise ValueError(f"{address} is not octal (digits 0-7); decimal {int(digits)} is {device}{int(digits):o}")
        if int(digits, base=8) > _LAST_NUMBER:
            last = f"{device}{_LAST_NUMBER:o}"
            raise ValueError(f"{address} is out of range; write {device}0 to {last}")
        return address

    @field_validator("polarity")
    @classmethod
    def _of_its_kind(cls, polarity: Polarity, info: ValidationInfo) -> Polarity:
        kind = _kind(info)
        if polarity not in kind.polarities:
            remedy = f"write {' or '.join(kind.polarities)}"
            raise ValueError(f"{polarity} is not valid for an {kind.noun}; {remedy}")
        return polarity

    @property
    def number(self) -> int:
        """Value of the octal address: 8 for X10."""
        return int(self.address[1:], base=8)


class OptionalEntry(Entry):
    """Entry of an optional point."""

    wired: bool = False
