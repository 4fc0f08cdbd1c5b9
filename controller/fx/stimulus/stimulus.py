"""Stimulus of a simulated program: a YAML file of inputs over time and of the devices to watch.

::

    scan_ms: 10                 # scan period, ms
    scans: 5                    # number of scans, the first at 0 ms
    initial: {M0: 1, D0: 7}     # before the first scan
    inputs:                     # before the first scan at or after that time
      - {at_ms: 20, set: {X0: 1}}
    pulses:                     # 100 pulses of 1 ms every 2 ms at a terminal
      - {input: X0, from_ms: 5, period_ms: 2, count: 100}
    watch: [Y0, T0, TN0, D0]    # after END of each scan
    expect:                     # after END of the last scan at or before 40 ms; of each scan; of at least one scan
      - {at_ms: 40, values: {Y0: 1, D0: 7}}
      - {from_ms: 20, to_ms: 40, values: {Y1: 0}}
      - {from_ms: 0, to_ms: 40, reach: {T0: 1}}
    input_filter_ms: 0          # of X0-X17; omitted = all filters off

Devices are X, Y, M, S, T, C, D, V, Z, TN and CN. **T0 and C0 are contacts, 0 or 1; TN0 and CN0 are current values.**
X is the raw level of a terminal when it is set, and the input image when it is watched; Y is the output image. A change
of X between two scans reaches high-speed counters and interrupts at its own millisecond.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from typing import Annotated, Final, NamedTuple, Self, cast

from pydantic import BeforeValidator, Field, PlainValidator, ValidationInfo, field_validator, model_validator

from controller.common.errors import InputError
from controller.common.yaml_lines import read_yaml, shown, unfold
from controller.common.yaml_model import StrictModel, validated
from controller.core.devices import WORD_MAX, WORD_MIN, Memory, device_name, is_32_bit_counter
from controller.fx.engine.access import signed
from controller.fx.engine.cpu import index_register
from controller.fx.language.cpu_model import FX2N, CpuModel
from controller.fx.language.instruction import DeviceOperand
from controller.fx.language.operand_rules import OperandError
from controller.fx.language.parsing import parse_operand

CURRENT_VALUES: Final = {"TN": "T", "CN": "C"}
"""Device kind of each current-value name: TN for timers, CN for counters."""
_DEPTH: Final = 4
"""Nesting levels of the file: inputs, entry, set, device."""
_EXAMPLE: Final = "write - {at_ms: 0, set: {X0: 1}}"


class StimulusError(InputError):
    """Raised for an invalid stimulus file; one line for each error: file, line, key, error, remedy."""


@dataclass(frozen=True, slots=True)
class WatchedDevice:
    """Device that is set or watched.

    Attributes:
        kind: X, Y, M, S, T, C, D, R, V, Z, TN or CN.
        number: Device number; for X and Y, the value of the octal label.
    """

    kind: str
    number: int

    def __str__(self) -> str:
        return device_name(self.kind, self.number)

    @property
    def limits(self) -> tuple[int, int]:
        """Lowest and highest value of the device."""
        match self.kind:
            case "D" | "R" | "V" | "Z":
                return WORD_MIN, WORD_MAX
            case "CN" if is_32_bit_counter(self.number):
                return -(2**31), 2**31 - 1
            case "TN" | "CN":
                return 0, WORD_MAX
        return 0, 1

    def read(self, memory: Memory) -> int:
        """Return the value; words are signed, and X is read from the input image."""
        match self.kind:
            case "D" | "R":
                return signed(memory.word(self.kind, self.number), 16)
            case "V" | "Z":
                return signed(memory.D[index_register(str(self))], 16)
            case "TN" | "CN":
                return memory.word(CURRENT_VALUES[self.kind], self.number)
        return int(memory.bits(self.kind)[self.number])


Values = dict[WatchedDevice, int]


@dataclass(frozen=True, slots=True)
class StimulusPulses:
    """Pulses at an X terminal.

    Attributes:
        terminal: The terminal.
        from_ms: Time of the first rising edge, ms.
        period_ms: Period, ms; the level is on for its first half.
        count: Number of pulses.
    """

    terminal: WatchedDevice
    from_ms: int
    period_ms: int
    count: int


@dataclass(frozen=True, slots=True)
class ExpectedValues:
    """Values that a run must show.

    Attributes:
        where: File and line.
        from_ms: Start of the span, ms.
        to_ms: End of the span, ms; the same as the start if the expectation concerns one scan.
        values: Value of each device.
        once: True if one scan in the span must show all values, False if each scan must.
    """

    where: str
    from_ms: int
    to_ms: int
    values: Values
    once: bool = False


@dataclass(frozen=True, slots=True)
class Stimulus:
    """Inputs of a program over time, and the devices to watch.

    Attributes:
        scan_ms: Scan period, ms.
        scans: Number of scans; the first is at 0 ms.
        initial: Device values before the first scan.
        inputs: Times in ms, ascending, with the device values set before the first scan at or after each time.
        watch: Devices to record after END of each scan.
        input_filter_ms: Filter time of X0-X17, ms; 0 disables all filters.
        pulses: Pulse trains.
        expect: Values that the run must show.
    """

    scan_ms: int
    scans: int
    initial: Values
    inputs: tuple[tuple[int, Values], ...]
    watch: tuple[WatchedDevice, ...]
    input_filter_ms: int = 0
    pulses: tuple[StimulusPulses, ...] = ()
    expect: tuple[ExpectedValues, ...] = ()


def device_of(name: str, cpu: CpuModel = FX2N) -> WatchedDevice:
    """Return the device with the given name, in upper or lower case.

    Examples:
        >>> device_of("X10"), device_of("TN0")
        (WatchedDevice(kind='X', number=8), WatchedDevice(kind='TN', number=0))

    Raises:
        OperandError: The name is not a device that a stimulus can set or watch.
    """
    prefix = name[:2].upper()
    kind = CURRENT_VALUES.get(prefix)
    device = parse_operand(kind + name[2:] if kind else name, cpu)
    if not isinstance(device, DeviceOperand) or device.index:
        raise OperandError(f"{shown(name)} is not a single device; write one such as X0, D100, T0 or TN0")
    return WatchedDevice(prefix if kind else device.kind, device.number)


def load_stimulus(path: Path, others: Collection[str] = (), cpu: CpuModel = FX2N) -> Stimulus:
    """Return the stimulus in a YAML file.

    Args:
        path: The file.
        others: Keys of the file that another reader handles.
        cpu: CPU whose devices can be set and watched.

    Raises:
        StimulusError: The file cannot be read or is invalid; one line for each error, in file order.
    """
    located = unfold(read_yaml(path, StimulusError), _DEPTH)
    located.values = {key: value for key, value in located.values.items() if key not in others}
    file = validated(_StimulusFile, located, context=_Context(_end_ms(located.values), cpu))
    if file is None or located.faults:
        faults = sorted(located.faults, key=lambda fault: fault.line)
        raise StimulusError("\n".join(f"{path}:{fault}" for fault in faults))
    return Stimulus(
        scan_ms=file.scan_ms,
        scans=file.scans,
        initial=dict(file.initial.values()),
        inputs=tuple(sorted(((each.at_ms, dict(each.set.values())) for each in file.inputs), key=lambda each: each[0])),
        watch=tuple(dict.fromkeys(file.watch)),
        input_filter_ms=file.input_filter_ms,
        pulses=tuple(StimulusPulses(each.input, each.from_ms, each.period_ms, each.count) for each in file.pulses),
        expect=tuple(
            each.expectation(f"{path}:{located.line_of(('expect', index))}") for index, each in enumerate(file.expect)
        ),
    )


class _Context(NamedTuple):
    """Context of the validation: time of the last scan, ms, and the CPU."""

    end_ms: float
    cpu: CpuModel


def _end_ms(values: Mapping[str, object]) -> float:
    """Return the time of the last scan, ms; infinity if the period or the number of scans is invalid."""
    scan_ms, scans = values.get("scan_ms"), values.get("scans")
    if isinstance(scan_ms, int) and isinstance(scans, int) and scan_ms > 0 and scans > 0:
        return (scans - 1) * scan_ms
    return math.inf


def _with_names(settings: object) -> object:
    return {name: (name, value) for name, value in settings.items()} if isinstance(settings, dict) else settings


def _setting(setting: tuple[str, object], info: ValidationInfo) -> tuple[WatchedDevice, int]:
    """Return a device and its value."""
    name, value = setting
    device = _named(name, info)
    low, high = device.limits
    if not isinstance(value, int) or isinstance(value, bool):
        zeros = ", without zeros in front" if isinstance(value, str) and value.lstrip("+-").isdecimal() else ""
        raise ValueError(f"{shown(value)} is not a whole number; write one from {low} to {high}{zeros}")
    if not low <= value <= high:
        raise ValueError(f"{shown(value)} is out of range; write a number from {low} to {high}")
    return device, value


def _named(name: object, info: ValidationInfo) -> WatchedDevice:
    return device_of(str(name), cast("_Context", info.context).cpu)


def _terminal(name: object, info: ValidationInfo) -> WatchedDevice:
    """Return an X terminal."""
    device = _named(name, info)
    if device.kind != "X":
        raise ValueError(f"{shown(name)} is not a terminal; write an input such as X0")
    return device


_Device = Annotated[WatchedDevice, PlainValidator(_named)]
_Settings = Annotated[
    dict[str, Annotated[tuple[WatchedDevice, int], PlainValidator(_setting)]], BeforeValidator(_with_names)
]
"""Device values by the device names of the file."""


class _Change(StrictModel):
    """Entry of ``inputs``."""

    at_ms: int = Field(description=_EXAMPLE)
    set: _Settings = Field(description="write devices and values as {X0: 1, D0: 5}")

    @field_validator("at_ms")
    @classmethod
    def _in_the_run(cls, at_ms: int, info: ValidationInfo) -> int:
        return _time_of_the_run(at_ms, info)


def _time_of_the_run(at_ms: int, info: ValidationInfo) -> int:
    end_ms = cast("_Context", info.context).end_ms
    if not 0 <= at_ms <= end_ms:
        raise ValueError(f"{at_ms} is outside the run; write 0 to {end_ms} (the last scan), or run more scans")
    return at_ms


_EXPECTED: Final = "write devices and values as {Y0: 1, D0: 5}"
_SPAN: Final = "write - {at_ms: 40, values: {Y0: 1}}, - {from_ms: 0, to_ms: 40, values: ...} or - {..., reach: ...}"


class _Expected(StrictModel):
    """Entry of ``expect``."""

    at_ms: int | None = Field(None, description=_SPAN)
    from_ms: int | None = Field(None, description=_SPAN)
    to_ms: int | None = Field(None, description=_SPAN)
    values: _Settings = Field({}, description=_EXPECTED)
    reach: _Settings = Field({}, description=_EXPECTED)

    @field_validator("at_ms", "from_ms", "to_ms")
    @classmethod
    def _in_the_run(cls, at_ms: int | None, info: ValidationInfo) -> int | None:
        return None if at_ms is None else _time_of_the_run(at_ms, info)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        times = self.at_ms is not None, self.from_ms is not None, self.to_ms is not None
        if times not in ((True, False, False), (False, True, True)) or (times[0] and self.reach):
            raise ValueError(f"is not one scan or one span; {_SPAN}")
        if bool(self.values) == bool(self.reach):
            raise ValueError(f"needs either values or reach; {_SPAN}")
        if self.from_ms is not None and self.to_ms is not None and self.from_ms > self.to_ms:
            raise ValueError(f"ends at {self.to_ms} ms, before it starts; write to_ms at or after from_ms")
        return self

    def expectation(self, where: str) -> ExpectedValues:
        """Return the values that a run must show.

        Args:
            where: File and line.
        """
        from_ms, to_ms = (self.at_ms, self.at_ms) if self.at_ms is not None else (self.from_ms, self.to_ms)
        values = dict((self.values or self.reach).values())
        return ExpectedValues(where, from_ms or 0, to_ms or 0, values, once=bool(self.reach))


_PULSES: Final = "write - {input: X0, from_ms: 0, period_ms: 2, count: 100}"


class _Pulses(StrictModel):
    """Entry of ``pulses``."""

    input: Annotated[WatchedDevice, PlainValidator(_terminal)] = Field(description=_PULSES)
    from_ms: int = Field(0, ge=0, description="write the time of the first pulse in ms, 0 or more")
    period_ms: int = Field(ge=2, le=60_000, multiple_of=2, description="write an even period in ms, 2 to 60000")
    count: int = Field(ge=1, le=1_000_000, description="write the number of pulses, 1 to 1000000")


class _StimulusFile(StrictModel):
    """Stimulus as written in the file."""

    scan_ms: int = Field(ge=1, le=60_000, description="write the scan period in ms, 1 to 60000")
    scans: int = Field(ge=1, le=1_000_000, description="write the number of scans to run, 1 to 1000000")
    initial: _Settings = Field({}, description="write devices and values as {X0: 1, D0: 5}")
    inputs: list[_Change] = Field([], description=_EXAMPLE)
    pulses: list[_Pulses] = Field([], description=_PULSES)
    watch: list[_Device] = Field(min_length=1, description="write the devices to record as [Y0, T0, TN0, D0]")
    input_filter_ms: int = Field(0, ge=0, le=60, description="write 0 to 60 ms, the range of an FX2N")
    expect: list[_Expected] = Field([], description=_SPAN)


def changes(stimulus: Stimulus) -> Iterator[tuple[int, Values]]:
    """Yield the times in ms, ascending, and the device values that the stimulus sets, with those of its pulses."""
    trains = (_levels(train) for train in stimulus.pulses)
    return merge(stimulus.inputs, *trains, key=lambda change: change[0])


def _levels(train: StimulusPulses) -> Iterator[tuple[int, Values]]:
    for n in range(train.count):
        at_ms = train.from_ms + n * train.period_ms
        yield at_ms, {train.terminal: 1}
        yield at_ms + train.period_ms // 2, {train.terminal: 0}
