"""PID (FNC 88): velocity form with an incomplete derivative of the measured value.

The equations are those of the FX programming manual, page 5-103, and the parameters those of the FX3 analogue manual,
page M-7 (verified, docs/sources/fx2n.md 1.10). With PVf the measured value after the input filter, the sign + for
forward and - for reverse operation, and PVf', PVf'' and so on the values of the previous samplings::

    PVf  = PV + alpha * (PVf' - PV)
    EV   = +-(PVf - SV)
    D    = +-TD / (Ts + KD * TD) * (PVf - 2 * PVf' + PVf'') + KD * TD / (Ts + KD * TD) * D'
    dMV  = KP * (EV - EV' + Ts / TI * EV + D)
    MV   = MV' + dMV

When the drive input turns on, the history is that of a constant measured value, and the output does not change until
the first sampling time has passed (assumed). The fraction of the output is stored between samplings; the output is
truncated towards zero (assumed), and a program may write it. A sampling that is late because of the scan is not
repeated. Auto-tuning is not supported: an operation error with the code 6750 (from memory). The other error codes are
those of page M-28 of the FX3 analogue manual, which accepts more values of two parameters (docs/sources/fx2n.md 1.10).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from controller.core.devices import WORD_MAX, WORD_MIN
from controller.fx.engine.access import Level, LevelFactory, reader, words
from controller.fx.engine.cpu import Cpu, OperationError
from controller.fx.language.instruction import Operand

PARAMETERS: Final = 25
"""Data registers from S3."""
AUTO_TUNING_ERROR: Final = 6750
"""Error code in D8067 for auto-tuning, which this engine does not support."""
_REVERSE, _INPUT_ALARM, _OUTPUT_ALARM, _AUTO_TUNING, _LIMITED = 0x01, 0x02, 0x04, 0x10, 0x20
"""Bits of the operation setting S3+1."""


class PidRegister(IntEnum):
    """Parameters that the program sets; the value is the offset from S3."""

    SAMPLING_MS = 0
    SETTING = 1
    FILTER_PERCENT = 2
    GAIN_PERCENT = 3
    INTEGRAL_100_MS = 4
    DERIVATIVE_GAIN_PERCENT = 5
    DERIVATIVE_10_MS = 6
    INPUT_RISE = 20
    INPUT_FALL = 21
    OUTPUT_RISE = 22
    OUTPUT_FALL = 23
    ALARMS = 24


_LIMITS: Final = {
    PidRegister.SAMPLING_MS: (1, WORD_MAX, 6730),
    PidRegister.FILTER_PERCENT: (0, 99, 6732),
    PidRegister.GAIN_PERCENT: (1, WORD_MAX, 6733),
    PidRegister.INTEGRAL_100_MS: (0, WORD_MAX, 6734),
    PidRegister.DERIVATIVE_GAIN_PERCENT: (0, 100, 6735),
    PidRegister.DERIVATIVE_10_MS: (0, WORD_MAX, 6736),
}
"""Lowest and highest value of each parameter, and the error code of any other value."""


@dataclass(slots=True)
class _Loop:
    """State of one control loop between samplings.

    Attributes:
        sampled_ms: Time of the last sampling, ms.
        measured: Measured value of the last sampling.
        filtered: Filtered measured values of the last two samplings, the last one first.
        error: Deviation of the last sampling.
        derivative: Derivative term of the last sampling.
        output: Output, including its fraction.
    """

    sampled_ms: int
    measured: float
    filtered: tuple[float, float]
    error: float
    derivative: float
    output: float

    def change(self, parameters: list[int], set_point: int, measured: int) -> float:
        """Take a sample and return the change of the output."""
        sampling_ms = parameters[PidRegister.SAMPLING_MS]
        alpha, gain, derivative_gain = (
            parameters[n] / 100
            for n in (PidRegister.FILTER_PERCENT, PidRegister.GAIN_PERCENT, PidRegister.DERIVATIVE_GAIN_PERCENT)
        )
        integral_ms = parameters[PidRegister.INTEGRAL_100_MS] * 100
        derivative_ms = parameters[PidRegister.DERIVATIVE_10_MS] * 10
        sign = -1 if parameters[PidRegister.SETTING] & _REVERSE else 1
        last, before = self.filtered
        filtered = measured + alpha * (last - measured)
        error = sign * (filtered - set_point)
        damping_ms = sampling_ms + derivative_gain * derivative_ms
        second_difference = sign * (filtered - 2 * last + before)
        derivative = (
            derivative_ms * second_difference + derivative_gain * derivative_ms * self.derivative
        ) / damping_ms
        integral = sampling_ms / integral_ms * error if integral_ms else 0.0
        change = gain * (error - self.error + integral + derivative)
        self.measured, self.filtered = measured, (filtered, last)
        self.error, self.derivative = error, derivative
        return change


def _begun(now_ms: int, parameters: list[int], set_point: int, measured: int, output: int) -> _Loop:
    sign = -1 if parameters[PidRegister.SETTING] & _REVERSE else 1
    return _Loop(now_ms, measured, (measured, measured), sign * (measured - set_point), 0.0, output)


def _check(parameters: list[int]) -> None:
    for register, (low, high, code) in _LIMITS.items():
        if not low <= parameters[register] <= high:
            raise OperationError(code)
    if parameters[PidRegister.SETTING] & _AUTO_TUNING:
        raise OperationError(AUTO_TUNING_ERROR)


def _alarms(parameters: list[int], input_change: float, output_change: float) -> int:
    """Return S3+24: input change up and down, output change up and down beyond the limits."""
    setting, alarms = parameters[PidRegister.SETTING], 0
    if setting & _INPUT_ALARM:
        alarms |= (input_change > parameters[PidRegister.INPUT_RISE]) << 0
        alarms |= (-input_change > parameters[PidRegister.INPUT_FALL]) << 1
    if setting & _OUTPUT_ALARM:
        alarms |= (output_change > parameters[PidRegister.OUTPUT_RISE]) << 2
        alarms |= (-output_change > parameters[PidRegister.OUTPUT_FALL]) << 3
    return alarms


def pid(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """PID s1 s2 s3 d: control the measured value s2 to the set value s1 with the parameters from s3; output d."""
    set_point, measured = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
    table, output = words(cpu, operands[2], wide), words(cpu, operands[3], wide)
    loop: _Loop | None = None

    def run(on: bool) -> None:
        nonlocal loop
        if not on:
            loop = None
            return
        places, place = table.places(PARAMETERS), output.places().start
        parameters = table.read(PARAMETERS)
        _check(parameters)
        if loop is None:
            loop = _begun(cpu.now_ms, parameters, set_point(), measured(), output.get(place))
            return
        sampling_ms = parameters[PidRegister.SAMPLING_MS]
        if cpu.now_ms - loop.sampled_ms < sampling_ms:
            return
        late = cpu.now_ms - loop.sampled_ms >= 2 * sampling_ms
        loop.sampled_ms = cpu.now_ms if late else loop.sampled_ms + sampling_ms
        before, value = loop.measured, output.get(place)
        start = loop.output if int(loop.output) == value else float(value)
        low, high = WORD_MIN, WORD_MAX
        if parameters[PidRegister.SETTING] & _LIMITED:
            low, high = parameters[PidRegister.OUTPUT_FALL], parameters[PidRegister.OUTPUT_RISE]
        change = loop.change(parameters, set_point(), measured())
        loop.output = max(min(start + change, high), low)
        output.put(place, int(loop.output))
        table.put(places[PidRegister.ALARMS], _alarms(parameters, loop.measured - before, loop.output - start))

    return run


LEVELS: Final[dict[str, LevelFactory]] = {"PID": pid}
