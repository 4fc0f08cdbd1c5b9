"""What ``io_map.yaml`` has to hold: the tags the program needs and the shape of one entry.

Only ``controller.io_map`` uses this module; everybody else asks that one.
"""

import difflib
import enum
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Literal, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from pydantic_core import ErrorDetails

from controller.yaml_lines import shown

_LAST_NUMBER = 0o377  # X377 and Y377 end the address space of the FX2N


class Polarity(enum.StrEnum):
    """How the logical state of a point shows on its terminal."""

    NORMALLY_OPEN = "normally_open"
    NORMALLY_CLOSED = "normally_closed"
    ACTIVE_HIGH = "active_high"
    ACTIVE_LOW = "active_low"


class Table(enum.StrEnum):
    """The Modbus table of the I/O module that holds a point."""

    DISCRETE_INPUT = "discrete_input"
    COIL = "coil"


# --- The tags -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Kind:
    """What every input has in common, and what every output has.

    Attributes:
        noun: For messages.
        section: Section of the file for the required tags.
        device: Letter of the address.
        table: Modbus table.
        polarities: The two that make sense.
        required: Tags the machine cannot run without.
        optional: Tags that are used when they are wired.
    """

    noun: str
    section: str
    device: str
    table: Table
    polarities: tuple[Polarity, Polarity]
    required: tuple[str, ...]
    optional: tuple[str, ...]

    def section_of(self, tag: str) -> str:
        """Return the section of the file in which this tag belongs."""
        return self.section if tag in self.required else OPTIONAL


def _both_arms(*names: str) -> tuple[str, ...]:
    return tuple(f"{side}.{name}" for side in ("left", "right") for name in names)


OPTIONAL = "optional"
INPUT = Kind(
    noun="input",
    section="inputs",
    device="X",
    table=Table.DISCRETE_INPUT,
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
OUTPUT = Kind(
    noun="output",
    section="outputs",
    device="Y",
    table=Table.COIL,
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


# --- One entry ----------------------------------------------------------------------------------


class _Strict(BaseModel):
    """Nothing unknown, nothing converted. The validation context is the kind of the point."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _kind(info: ValidationInfo) -> Kind:
    return cast("Kind", info.context)


class Modbus(_Strict):
    """Where the I/O module keeps the point."""

    table: Annotated[Table, Field(strict=False)]  # strict would refuse the text of a member
    offset: int = Field(ge=0, le=65_535)

    @field_validator("table")
    @classmethod
    def _of_its_kind(cls, table: Table, info: ValidationInfo) -> Table:
        kind = _kind(info)
        if table is not kind.table:
            raise ValueError(f"table {table} holds no {kind.noun}s; write {kind.table}")
        return table


class Entry(_Strict):
    """One wire as written in the file."""

    tag: str
    address: str
    meaning: str = Field(min_length=1)
    polarity: Annotated[Polarity, Field(strict=False)]
    safe: Literal["active", "inactive"]
    modbus: Modbus

    @field_validator("address")
    @classmethod
    def _on_the_plc(cls, address: str, info: ValidationInfo) -> str:
        kind = _kind(info)
        device, digits = address[:1], address[1:]
        example = f"write {kind.device} and octal digits, for example {kind.device}10"
        if not re.fullmatch("[XY][0-9]{1,4}", address):
            raise ValueError(f"{shown(address)} is no address; {example}")
        if device != kind.device:
            raise ValueError(f"address {address} cannot be an {kind.noun}; {example}")
        if not re.fullmatch("[0-7]+", digits):
            raise ValueError(
                f"address {address} is not octal (digits 0-7); decimal {int(digits)} is {device}{int(digits):o}"
            )
        if int(digits, base=8) > _LAST_NUMBER:
            last = f"{device}{_LAST_NUMBER:o}"
            raise ValueError(f"address {address} is beyond {last}; write {device}0 to {last}")
        return address

    @field_validator("polarity")
    @classmethod
    def _of_its_kind(cls, polarity: Polarity, info: ValidationInfo) -> Polarity:
        kind = _kind(info)
        if polarity not in kind.polarities:
            remedy = f"write {' or '.join(kind.polarities)}"
            raise ValueError(f"polarity {polarity} is not for an {kind.noun}; {remedy}")
        return polarity

    @property
    def number(self) -> int:
        """Octal value of the address: 8 for X10."""
        return int(self.address[1:], base=8)


class OptionalEntry(Entry):
    """One wire the machine can do without."""

    wired: bool = False


# --- Words --------------------------------------------------------------------------------------

REMEDY = {
    "tag": "write the name of a wire, for example left.lift_down",
    "address": "write X or Y and octal digits, for example X10",
    "meaning": "write in quotes what the wire says when it is active",
    "polarity": "write normally_open or normally_closed (inputs), active_high or active_low (outputs)",
    "safe": "write active or inactive",
    "modbus": "write {table: discrete_input, offset: 1} (inputs) or {table: coil, offset: 1} (outputs)",
    "modbus.table": "write discrete_input (inputs) or coil (outputs)",
    "modbus.offset": "write a decimal number from 0 to 65535, without quotes",
    "wired": "write true or false",
}


def in_words(fault: ErrorDetails, model: type[Entry]) -> str:
    """Return what pydantic found in an entry as one line: what is wrong; remedy."""
    key = ".".join(map(str, fault["loc"]))
    match fault["type"]:
        case "value_error":
            return str(fault["ctx"]["error"])
        case "missing":
            return f"key {key} is missing; {REMEDY[key]}"
        case "extra_forbidden":
            *above, name = map(str, fault["loc"])
            fields = Modbus.model_fields if above else model.model_fields
            return f"unknown key {shown(name)}; {choice(name, fields)}"
        case _:
            return f"{key} cannot be {shown(fault['input'])}; {REMEDY[key]}"


def choice(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """Return a remedy for an unknown word: the nearest known one, else all of them or as told.

    >>> choice("adress", ["tag", "address"])
    'did you mean address?'
    >>> choice("colour", ["tag", "address"])
    'known are tag, address'
    """
    known = list(known)
    near = difflib.get_close_matches(word, known, n=1)
    if near:
        return f"did you mean {near[0]}?"
    return otherwise or f"known are {', '.join(known)}"
