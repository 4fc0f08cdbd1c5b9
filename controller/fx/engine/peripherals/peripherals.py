"""Peripherals of a simulated PLC: a YAML file of special function modules and of the partner on the serial line.

::

    modules:
      - {position: 0, model: FX2N-4AD, inputs: [{at_ms: 0, channel: 1, value: 2.5}]}
      - {position: 1, model: FX0N-3A}
      - {position: 2, model: buffer, size: 100, initial: {30: 2030}}
    serial:
      received: [{at_ms: 100, bytes: "02 41 03"}]
      answers: [{request: "05", delay_ms: 20, bytes: "06"}]

A position is the number of the module in FROM and TO. The values of `inputs` are V, or mA for a channel in a current
mode. A module of another model is described by its buffer memory (model `buffer`), which the program reads and writes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import BeforeValidator, Field, PlainValidator, model_validator

from controller.common.errors import InputError
from controller.common.yaml_lines import read_yaml, shown, unfold
from controller.common.yaml_model import StrictModel, validated
from controller.core.devices import WORD_MAX, WORD_MIN
from controller.fx.engine.peripherals.analogue import CHANNELS, AnalogueInputs, AnalogueSignal, CombinedAnalogue
from controller.fx.engine.peripherals.buffer_module import BufferModule
from controller.fx.engine.peripherals.serial_line import FxSerialLine, SerialAnswer

POSITIONS: Final = 8
"""Number of special function modules that an FX2N has at most (from memory)."""
_DEPTH: Final = 5
"""Nesting levels of the file: modules, entry, inputs, entry, key."""


class PeripheralError(InputError):
    """Raised for an invalid file of peripherals; one line for each error: file, line, key, error, remedy."""


@dataclass(slots=True)
class Peripherals:
    """Special function modules and serial line of one PLC.

    Attributes:
        modules: Modules by position.
        line: Serial line.
    """

    modules: Mapping[int, BufferModule] = field(default_factory=dict)
    line: FxSerialLine = field(default_factory=FxSerialLine)

    def record(self) -> dict[str, object]:
        """Return the words other than 0 of the buffer memories, and the transmissions of the PLC."""
        return {
            "modules": {
                str(position): {str(n): word for n, word in enumerate(module.words) if word}
                for position, module in self.modules.items()
            },
            "serial": [{"ms": at_ms, "bytes": data.hex(" ")} for at_ms, data in self.line.sent],
        }


def load_peripherals(path: Path) -> Peripherals:
    """Return new peripherals as described in a YAML file.

    Raises:
        PeripheralError: The file cannot be read or is invalid; one line for each error, in file order.
    """
    located = unfold(read_yaml(path, PeripheralError), _DEPTH)
    file = validated(_PeripheralsFile, located)
    if file is None or located.faults:
        faults = sorted(located.faults, key=lambda fault: fault.line)
        raise PeripheralError("\n".join(f"{path}:{fault}" for fault in faults))
    serial = file.serial
    return Peripherals(
        {entry.position: entry.module() for entry in file.modules},
        FxSerialLine(
            [(each.at_ms, each.bytes) for each in serial.received],
            [SerialAnswer(each.request, each.delay_ms, each.bytes) for each in serial.answers],
        ),
    )


def _hexadecimal(text: object) -> bytes:
    try:
        data = bytes.fromhex(str(text))
    except ValueError:
        data = b""
    if not data:
        raise ValueError(f'{shown(text)} is not a sequence of bytes; write hexadecimal bytes as "02 41 03"')
    return data


def _words(values: object) -> object:
    """Return the words of a buffer memory by number; a key is text in the file."""
    if not isinstance(values, dict):
        return values
    words: dict[int, int] = {}
    for name, value in values.items():
        if not (str(name).isdecimal() and isinstance(value, int) and WORD_MIN <= value <= WORD_MAX):
            raise ValueError(f"{shown(name)}: {shown(value)} is not a word; write numbers as {{30: 2010}}")
        words[int(name)] = value
    return words


_ANALOGUE: Final = "write the value in V or mA, -50 to 50"
_DECIMAL: Final = re.compile(r"-?[0-9]{1,2}(\.[0-9]{1,6})?")
_HIGHEST: Final = 50


def _analogue(value: object) -> float:
    """Return a value in V or mA; a decimal number is text in the file."""
    if not (_DECIMAL.fullmatch(str(value)) and abs(float(str(value))) <= _HIGHEST):
        raise ValueError(f"{shown(value)} is not a value of an analogue input; {_ANALOGUE}")
    return float(str(value))


_Bytes = Annotated[bytes, PlainValidator(_hexadecimal)]
_BYTES: Final = 'write hexadecimal bytes as "02 41 03"'


class _Input(StrictModel):
    at_ms: int = Field(ge=0, description="write the time of the change in ms, 0 or more")
    channel: int = Field(ge=1, le=CHANNELS, description="write the number of the channel, 1 to 4")
    value: Annotated[float, PlainValidator(_analogue)] = Field(description=_ANALOGUE)


class _Module(StrictModel):
    position: int = Field(ge=0, lt=POSITIONS, description="write the position of the module, 0 to 7")
    model: Literal["FX2N-4AD", "FX0N-3A", "buffer"] = Field(
        description="write FX2N-4AD, FX0N-3A, or buffer for the buffer memory of any other module"
    )
    inputs: list[_Input] = Field([], description="write - {at_ms: 0, channel: 1, value: 2.5}")
    size: int = Field(32, ge=1, le=32_768, description="write the number of words of the buffer memory, 1 to 32768")
    initial: Annotated[dict[int, int], BeforeValidator(_words)] = Field(
        {}, description="write the words that are not 0 as {30: 2010}"
    )

    @model_validator(mode="after")
    def _consistent(self) -> _Module:
        if self.model == "buffer":
            if self.inputs:
                raise ValueError("a module of the model buffer has no inputs; write initial")
            outside = [number for number in self.initial if number >= self.size]
            if outside:
                raise ValueError(f"word {outside[0]} is outside the buffer memory; increase size")
        elif {"size", "initial"} & self.model_fields_set:
            raise ValueError(f"size and initial belong to the model buffer; the buffer memory of {self.model} is known")
        elif self.model == "FX0N-3A" and any(each.channel > 2 for each in self.inputs):
            raise ValueError("an FX0N-3A has the channels 1 and 2")
        return self

    def module(self) -> BufferModule:
        """Return the module."""
        signals = [_signal([each for each in self.inputs if each.channel == n + 1]) for n in range(CHANNELS)]
        match self.model:
            case "FX2N-4AD":
                return AnalogueInputs(signals)
            case "FX0N-3A":
                return CombinedAnalogue(signals)
            case _:
                return BufferModule(self.size, self.initial)


def _signal(inputs: Sequence[_Input]) -> AnalogueSignal:
    ordered = sorted(inputs, key=lambda each: each.at_ms)
    return AnalogueSignal(tuple(each.at_ms for each in ordered), tuple(each.value for each in ordered))


class _Reception(StrictModel):
    at_ms: int = Field(ge=0, description="write the time at which the partner begins to send, ms")
    bytes: _Bytes = Field(description=_BYTES)


class _Answer(StrictModel):
    request: _Bytes = Field(description=_BYTES)
    delay_ms: int = Field(0, ge=0, description="write the time before the answer in ms, 0 or more")
    bytes: _Bytes = Field(description=_BYTES)


class _Serial(StrictModel):
    received: list[_Reception] = Field([], description='write - {at_ms: 100, bytes: "02 41 03"}')
    answers: list[_Answer] = Field([], description='write - {request: "05", delay_ms: 20, bytes: "06"}')


class _PeripheralsFile(StrictModel):
    modules: list[_Module] = Field([], description="write - {position: 0, model: FX2N-4AD}")
    serial: _Serial = Field(
        default_factory=lambda: _Serial(received=[], answers=[]), description="write received and answers"
    )

    @model_validator(mode="after")
    def _different(self) -> _PeripheralsFile:
        positions = [module.position for module in self.modules]
        repeated = next((position for position in positions if positions.count(position) > 1), None)
        if repeated is not None:
            raise ValueError(f"two modules have the position {repeated}; a position has one module")
        return self
