"""Profiles of PLCs: where a client finds the outputs, and where it writes the inputs; one YAML file each.

An invalid profile is rejected with a one-line message that contains the file, the line, the key and the remedy.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.common.errors import InputError
from controller.common.mitsubishi.devices import Device
from controller.common.modbus.client_requests import READ_FUNCTION, WORD_TABLES
from controller.common.modbus.io_map import ModbusTable
from controller.common.suggestion import suggestion
from controller.common.yaml_section import Section, one_of, read_section, whole

_FOLDER: Final = Path(__file__).resolve().parent / "profiles"
_LAST_ADDRESS: Final = 65_535
_MOST_INPUTS: Final = 256
"""Inputs of an FX2N, X0-X377."""


class ProfileError(InputError):
    """Raised for an invalid profile; the message is one line with file, line, key and remedy."""


class PlcProtocol(enum.StrEnum):
    """PlcProtocol of a PLC."""

    MODBUS = "modbus"
    MC_1E = "mc_1e"
    MC_3E = "mc_3e"


_MC_KINDS: Final = ("X", "Y", "M", "S", "D", "R")
"""Kinds of MC protocol devices for inputs and outputs."""
_WRITABLE: Final = (ModbusTable.COIL, ModbusTable.HOLDING_REGISTER)


@dataclass(frozen=True, slots=True)
class PlcBlock:
    """Consecutive bits of a PLC, in the order of the X or Y numbers.

    Attributes:
        device: First device in the words of the PLC, e.g. M7000.
        area: Modbus table; None for the MC protocol. Bit 0 of the first register is X0 or Y0, that of the next one X20
            or Y20.
        first: Modbus address of the first bit or register; 0 for the MC protocol.
        source: Source of the address, or a mark.
    """

    device: str
    area: ModbusTable | None
    first: int
    source: str

    def length(self, bits: int) -> int:
        """Return the number of addresses that some bits take."""
        return -(-bits // 16) if self.area in WORD_TABLES else bits


@dataclass(frozen=True, slots=True)
class PlcProfile:
    """Place of the outputs and inputs in a PLC.

    Attributes:
        title: PLC and its interface.
        protocol: PlcProtocol.
        port: Usual TCP port.
        function_23: True if one Modbus request with function 23 writes the inputs and reads the outputs.
        outputs: Outputs, read from the PLC.
        inputs: Inputs, written to the PLC.
        ok_bit: Number of the bit in `inputs` that is on while the outputs take effect, off while the output watchdog
            has tripped; None = no such bit.
    """

    title: str
    protocol: PlcProtocol
    port: int
    function_23: bool
    outputs: PlcBlock
    inputs: PlcBlock
    ok_bit: int | None

    def input_bits(self, input_count: int) -> int:
        """Return the number of bits of the input block for a number of inputs."""
        return input_count if self.ok_bit is None else max(input_count, self.ok_bit + 1)


def profile_names() -> list[str]:
    """Return the names of the profiles that are delivered."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


def load_profile(name: str, *, input_count: int, output_count: int) -> PlcProfile:
    """Return a profile.

    Args:
        name: Name of a delivered profile, or path of a YAML file.
        input_count: Number of inputs of the I/O map, from X0.
        output_count: Number of outputs of the I/O map, from Y0.

    Raises:
        ProfileError: There is no such profile, it is invalid, or it does not fit the I/O map.
    """
    names = profile_names()
    path = _FOLDER / f"{name}.yaml" if name in names else Path(name)
    if not path.suffix:
        raise ProfileError(f"profile {name!r}: {suggestion(name, names)}, or give the path of a YAML file")
    file = read_section(
        path, ("title", "protocol", "port", "function_23", "outputs", "inputs"), error_type=ProfileError
    )
    protocol = file.read("protocol", one_of("protocol", PlcProtocol))
    outputs = _block(file, "outputs", protocol, tuple(READ_FUNCTION))
    inputs = _block(file, "inputs", protocol, _WRITABLE)
    section = file.section("inputs")
    ok_bit = None
    if section is not None and "ok_bit" in section:
        ok_bit = section.read("ok_bit", whole(input_count, _MOST_INPUTS - 1))
    profile = PlcProfile(
        title=file.read("title", _text),
        protocol=protocol,
        port=file.read("port", whole(1, _LAST_ADDRESS)),
        function_23=file.read_or("function_23", _flag, default=False),
        outputs=outputs,
        inputs=inputs,
        ok_bit=ok_bit,
    )
    _check(file, profile, input_count, output_count)
    return profile


def _block(file: Section, key: str, protocol: PlcProtocol, areas: tuple[ModbusTable, ...]) -> PlcBlock:
    known = ["device", "source"]
    if protocol is PlcProtocol.MODBUS:
        known += ["area", "first"]
    if key == "inputs":
        known.append("ok_bit")
    section = file.section(key, known)
    if section is None:
        raise file.error(key, f"is missing; add it with the keys {', '.join(known)}")
    area, first = None, 0
    if protocol is PlcProtocol.MODBUS:
        area = section.read("area", one_of("area", areas))
        first = section.read("first", whole(0, _LAST_ADDRESS))
    device = section.read("device", _text if protocol is PlcProtocol.MODBUS else _mc_device)
    return PlcBlock(device, area, first, section.read("source", _text))


def _check(file: Section, profile: PlcProfile, input_count: int, output_count: int) -> None:
    outputs, inputs = profile.outputs, profile.inputs
    lengths = outputs.length(output_count), inputs.length(profile.input_bits(input_count))
    for key, block, length in (("outputs", outputs, lengths[0]), ("inputs", inputs, lengths[1])):
        if block.first + length - 1 > _LAST_ADDRESS:
            raise file.error(key, f"{length} addresses from {block.first} exceed {_LAST_ADDRESS}; choose a lower first")
    if profile.protocol is not PlcProtocol.MODBUS:
        if profile.function_23:
            raise file.error("function_23", "is a Modbus function; remove the key")
        return
    if profile.function_23 and (outputs.area, inputs.area) != (
        ModbusTable.HOLDING_REGISTER,
        ModbusTable.HOLDING_REGISTER,
    ):
        raise file.error("function_23", "transfers holding registers only; change both areas, or write false")
    ranges = (
        range(block.first, block.first + length) for block, length in zip((outputs, inputs), lengths, strict=True)
    )
    first, second = ranges
    if outputs.area == inputs.area and first.start < second.stop and second.start < first.stop:
        raise file.error("inputs", f"overlap the outputs at {outputs.first} to {first.stop - 1}; choose another first")


def _text(text: str) -> str:
    if not text.strip():
        raise ValueError("is empty; write text")
    return text.strip()


def _mc_device(text: str) -> str:
    try:
        device = Device.parsed(text)
    except InputError as error:
        raise ValueError(str(error)) from None
    if device.kind not in _MC_KINDS:
        raise ValueError(f"must be one of {', '.join(_MC_KINDS)} with a number, not {text!r}")
    return text


def _flag(text: str) -> bool:
    if text not in {"true", "false"}:
        raise ValueError(f"must be true or false, not {text!r}")
    return text == "true"
