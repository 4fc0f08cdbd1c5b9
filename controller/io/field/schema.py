"""Schema of a field file and of the profiles of I/O modules."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from controller.common.yaml_model import StrictModel


def _number(value: Any) -> Any:
    """Return a hexadecimal number as an int, and any other value unchanged."""
    return int(value, 16) if isinstance(value, str) and re.fullmatch("0x[0-9A-Fa-f]{1,4}", value) else value


_REMEDY = "write a number from 0 to 65535, such as 2048 or 0x0800, without quotes"
Word16 = Annotated[int, BeforeValidator(_number), Field(ge=0, le=65_535, description=_REMEDY)]
_InputTable = Literal["coil", "discrete_input", "holding_register", "input_register"]
_OutputTable = Literal["coil", "holding_register"]
_Order = Literal["low_first", "high_first"]
_Watchdog = Literal["set", "tool", "none"]
_ANY_TABLE = "write coil, discrete_input, holding_register or input_register"
_WRITABLE_TABLE = "write coil or holding_register"
_ORDER = "write low_first or high_first"
_WATCHDOG = "write set, tool or none"


class InputArea(StrictModel):
    """Place of the inputs in the module."""

    table: _InputTable = Field(description=_ANY_TABLE)
    first: Word16 = Field(default=0, description=_REMEDY)


class OutputArea(StrictModel):
    """Place of the outputs in the module."""

    table: _OutputTable = Field(description=_WRITABLE_TABLE)
    first: Word16 = Field(default=0, description=_REMEDY)
    read_back: Word16 | None = Field(default=None, description=_REMEDY)


class SettingEntry(StrictModel):
    """Holding register and the value that it must have."""

    offset: Word16 = Field(description=_REMEDY)
    value: Word16 | None = Field(default=None, description=_REMEDY)
    watchdog_unit_ms: int | None = Field(default=None, ge=1, le=1_000, description="write 1 to 1000")


class WriteEntry(StrictModel):
    """Coil or register that is written."""

    table: _OutputTable = Field(description=_WRITABLE_TABLE)
    offset: Word16 = Field(description=_REMEDY)
    value: Word16 = Field(description=_REMEDY)


class TripEntry(StrictModel):
    """Sign of a trip of the output watchdog: a value under a mask, or a counter that has changed."""

    table: _InputTable = Field(description=_ANY_TABLE)
    offset: Word16 = Field(description=_REMEDY)
    mask: Word16 = Field(default=0xFFFF, description=_REMEDY)
    value: Word16 = Field(default=1, description=_REMEDY)
    counter: bool = Field(default=False, description="write true or false")


class ModelArea(StrictModel):
    """Registers in which the module reports its model, and the values with which every model of a profile begins."""

    table: Literal["holding_register", "input_register"] = Field(description="write holding_register or input_register")
    first: Word16 = Field(description=_REMEDY)
    count: int = Field(default=1, ge=1, le=16, description="write a number of registers, 1 to 16")
    begins: list[Word16] = Field(default=[], max_length=16, description="write a list of register values")


class ModuleTraits(StrictModel):
    """Properties of a module that a profile defines and a device may replace."""

    inputs: InputArea | None = Field(default=None, description="write {table: discrete_input, first: 0}")
    outputs: OutputArea | None = Field(default=None, description="write {table: coil, first: 0}")
    byte_order: _Order | None = Field(default=None, description=_ORDER)
    bit_order: _Order | None = Field(default=None, description=_ORDER)
    combined: bool | None = Field(default=None, description="write true or false")
    locked: bool | None = Field(default=None, description="write true or false")
    watchdog: _Watchdog | None = Field(default=None, description=_WATCHDOG)
    reports: ModelArea | None = Field(default=None, description="write {table: holding_register, first: 0}")
    settings: list[SettingEntry] | None = Field(default=None, description="write a list of {offset: 0, value: 0}")
    start: list[WriteEntry] | None = Field(default=None, description="write a list of {table: coil, offset: 0}")
    trip: TripEntry | None = Field(default=None, description="write {table: coil, offset: 0, value: 1}")
    reset: list[WriteEntry] | None = Field(default=None, description="write a list of {table: coil, offset: 0}")

    def merged(self, over: ModuleTraits) -> ModuleTraits:
        """Return these properties, replaced by those that `over` defines."""
        names = ModuleTraits.model_fields
        own = {name: value for name in names if (value := getattr(over, name)) is not None}
        return ModuleTraits.model_construct(**{name: getattr(self, name) for name in names} | own)

    @property
    def has_watchdog_setting(self) -> bool:
        """True if the time of the output watchdog is one of the settings."""
        return any(each.watchdog_unit_ms is not None for each in self.settings or ())


class ProfileEntry(ModuleTraits):
    """Profile of a module."""

    meaning: str
    source: str
    watchdog: _Watchdog = Field(description=_WATCHDOG)


class TcpEntry(StrictModel):
    """Modbus TCP connection."""

    host: str = Field(min_length=1, description="write the name or address of the device")
    port: int = Field(default=502, ge=1, le=65_535, description="write a TCP port, 1 to 65535")


class TlsEntry(TcpEntry):
    """Modbus TCP connection with TLS."""

    port: int = Field(default=802, ge=1, le=65_535, description="write a TCP port, 1 to 65535")
    ca: str = Field(description="write the file of the certificate authority (PEM)")
    certificate: str | None = Field(default=None, description="write the file of the own certificate (PEM)")
    key: str | None = Field(default=None, description="write the file of the private key (PEM)")
    server_name: str = Field(default="", description="write the name in the certificate of the device")


class LineEntry(StrictModel):
    """Serial line."""

    name: str = Field(pattern=r"^[\w-]{1,20}$", description="write a name of up to 20 letters, digits, _ and -")
    device: str = Field(min_length=1, description="write the device file, for example /dev/ttyUSB0")
    baud: int = Field(default=19_200, ge=1_200, le=4_000_000, description="write 1200 to 4000000")
    frame: Literal["8N1", "8N2", "8E1", "8E2", "8O1", "8O2"] = Field(
        default="8E1", description="write 8N1, 8N2, 8E1, 8E2, 8O1 or 8O2"
    )


class DeviceEntry(ModuleTraits):
    """Device of a field file."""

    name: str = Field(pattern=r"^[\w-]{1,20}$", description="write a name of up to 20 letters, digits, _ and -")
    profile: str = Field(description="write the name of a profile")
    tcp: TcpEntry | None = Field(default=None, description="write {host: 192.168.3.20, port: 502}")
    tls: TlsEntry | None = Field(default=None, description="write {host: 192.168.3.20, port: 802, ca: ca.pem}")
    line: str | None = Field(default=None, description="write the name of a serial line")
    unit: int = Field(default=1, ge=0, le=255, description="write 0 to 255, on a serial line 1 to 247")
    timeout_ms: int = Field(default=30, ge=1, le=10_000, description="write 1 to 10000")
    poll_every: int = Field(default=1, ge=1, le=100, description="write a number of scans, 1 to 100")
    watchdog_ms: int | None = Field(default=None, ge=10, le=60_000, description="write 10 to 60000")
    echo: bool = Field(default=True, description="write true or false")
    model: list[Word16] = Field(
        default=[], max_length=16, description="write a list of the register values that the module reports"
    )
    wires: dict[str, Word16] = Field(description="write 'tag: offset', one wire per line")


class FieldEntry(StrictModel):
    """Field file."""

    lines: list[LineEntry] = Field(default=[], description="write a list of serial lines")
    devices: list[DeviceEntry] = Field(min_length=1, description="write a list of devices")
