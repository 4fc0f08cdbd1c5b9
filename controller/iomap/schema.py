"""Schema of ``io_map.yaml``: the tags of the program with their display names, and the fields of an entry.

Only ``controller.iomap.loader`` uses this module; import from the loader instead.
"""

import re
from dataclasses import dataclass
from typing import Annotated, Final, Literal, cast

from pydantic import Field, ValidationInfo, field_validator

from controller.common.declarations import DeclarationError, Declared
from controller.common.modbus.io_map import ModbusTable, Polarity
from controller.common.yaml_lines import shown
from controller.common.yaml_model import StrictModel

_LAST_NUMBER = 0o377
"""X377 and Y377 are the last addresses of the FX2N."""


# --- Tags ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PointKind:
    """Common properties of all inputs, of all outputs, or of all output registers.

    Attributes:
        noun: Noun for messages.
        section: Section of the file that contains the required tags.
        device: Letter of the address.
        table: Modbus table.
        polarities: The two valid polarities; none for a register.
        required: Tags that the machine requires.
        optional: Tags that the program uses only if they are wired.
        moves_nothing: Tags of lamps and horns, which may be on in an emergency stop. Every other output counts as one
            that moves something.
    """

    noun: str
    section: str
    device: str
    table: ModbusTable
    polarities: tuple[Polarity, ...]
    required: tuple[str, ...]
    optional: tuple[str, ...]
    moves_nothing: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if moving := sorted({*self.moves_nothing} - {*self.optional}):
            raise DeclarationError(f"{moving[0]!r} cannot be declared as moving nothing: it is no optional {self.noun}")

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
    optional=(
        *("reset", "air_pressure_ok", "magazine_empty", "ground_pulse", "guard"),
        *_both_arms("claw_pressure", "seedling_beam", "cup_filled"),
    ),
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
    moves_nothing=("horn", "lamp_red", "lamp_amber", "lamp_green"),
)
REGISTER = PointKind(
    noun="output register",
    section=OPTIONAL,
    device="D",
    table=ModbusTable.HOLDING_REGISTER,
    polarities=(),
    required=(),
    optional=("planter_speed",),
)
KIND_OF = {tag: kind for kind in (INPUT, OUTPUT, REGISTER) for tag in kind.required + kind.optional}
SECTIONS = (INPUT.section, OUTPUT.section, OPTIONAL)
_POINT_NAMES: Final[dict[str, tuple[str, str]]] = {
    "start": ("start button pressed", "启动按钮按下"),
    "stop": ("stop button pressed", "停止按钮按下"),
    "emergency_stop": ("emergency stop pressed", "急停按下"),
    "reset": ("reset button pressed", "复位按钮按下"),
    "air_pressure_ok": ("main air pressure OK", "主气压正常"),
    "magazine_empty": ("tray magazine empty", "苗盘仓已空"),
    "ground_pulse": ("ground wheel has travelled one pulse distance", "地轮行进一个脉冲距离"),
    "guard": ("guard open", "安全门打开"),
    "planter_speed": ("planter chain speed, mm/s", "栽植器链条速度（毫米/秒）"),
    "claw_pressure": ("air pressure closes the claws", "夹爪闭合气压到位"),
    "seedling_beam": ("stem in the beam before the cups", "苗茎遮挡苗杯前的光电开关"),
    "cup_filled": ("plug in the cup behind the claws", "夹爪后方的苗杯内有苗"),
    "tray_front_edge": ("front edge of a tray detected", "检测到苗盘前沿"),
    "tray_run": ("tray stepper running", "苗盘步进电机运行"),
    "tray_forward": ("tray stepper forward", "苗盘步进电机正转"),
    "horn": ("horn on", "蜂鸣器响"),
    "lamp_red": ("tower lamp red", "塔灯红"),
    "lamp_amber": ("tower lamp amber", "塔灯黄"),
    "lamp_green": ("tower lamp green", "塔灯绿"),
    "lift_down": ("lift at lower limit", "升降在下限位"),
    "lift_up": ("lift at upper limit", "升降在上限位"),
    "slide_at_feed": ("slide at feed, over the cups", "滑块在投苗位（苗杯上方）"),
    "slide_at_pick_1": ("slide at pick 1 (outermost row)", "滑块在取苗位 1（最外行）"),
    "slide_at_pick_2": ("slide at pick 2", "滑块在取苗位 2"),
    "slide_at_pick_3": ("slide at pick 3 (innermost row)", "滑块在取苗位 3（最内行）"),
    "claws_spread": ("claws at cup pitch", "夹爪为杯距"),
    "claws_converged": ("claws at tray pitch", "夹爪为盘距"),
    "cup_pulse": ("cup passing the counter", "苗杯经过计数器"),
    "lift_extend": ("lift cylinder extends: arm down", "升降缸伸出：臂下降"),
    "lift_retract": ("lift cylinder retracts: arm up", "升降缸缩回：臂上升"),
    "slide_inward": ("slide moves to the tray", "滑块移向苗盘"),
    "slide_outward": ("slide moves to the cups", "滑块移向苗杯"),
    "converge": ("motor converges the claws to tray pitch", "电机使夹爪聚合至盘距"),
    "spread": ("motor spreads the claws to cup pitch", "电机使夹爪分散至杯距"),
    "claws_open": ("claws open", "夹爪张开"),
    "claws_close": ("claws close", "夹爪闭合"),
}
POINT_NAMES: Final = Declared("POINT_NAMES", __name__, _POINT_NAMES)
"""English and Chinese display name of each tag; tags of an arm are listed without the side, which the panel adds before
the name."""
POINT_NAMES.require(tag.rpartition(".")[2] for tag in KIND_OF)


# --- Entries ------------------------------------------------------------------------------------


def _kind(info: ValidationInfo) -> PointKind:
    return cast("PointKind", info.context)


class Modbus(StrictModel):
    """Modbus address of a point on the I/O module. The validation context is the `PointKind` of the point."""

    table: Annotated[  # strict mode does not accept a string for an enum member
        ModbusTable,
        Field(strict=False, description="write discrete_input (inputs), coil (outputs) or holding_register"),
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


class RegisterEntry(StrictModel):
    """Entry of an output register as written in the file. The validation context is `REGISTER`."""

    tag: str
    address: str = Field(description="write D and a number from 0 to 99, for example D0")
    meaning: str = Field(min_length=1, description="write the meaning of the value in quotes")
    safe: int = Field(ge=0, le=32_767, description="write the safe value, a number from 0 to 32767, without quotes")
    modbus: Modbus = Field(description="write {table: holding_register, offset: 0}")
    wired: bool = False

    @field_validator("address")
    @classmethod
    def _on_the_plc(cls, address: str) -> str:
        if not re.fullmatch("D(0|[1-9][0-9]?)", address):
            raise ValueError(f"{shown(address)} is not an output register; write D0 to D99")
        return address

    @property
    def number(self) -> int:
        """Number of the data register."""
        return int(self.address[1:])
