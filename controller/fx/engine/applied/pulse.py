"""Pulse outputs: PLSY PWM PLSR (FNC 57-59), and DRVI DRVA (FNC 158, 159) of an FX3U.

An FX2N generates these pulses in hardware, independently of the scan. Here the number of pulses is computed exactly
from the scan times, and Y is the level of the train at the scan time: the Y image does not show every pulse of a train
faster than half the scan rate, but the count is correct. The total number of PLSY and PLSR pulses is in D8140 and D8141
for Y0, and in D8142 and D8143 for Y1. M8029 turns on with the last pulse and turns off with the drive input. When the
drive input turns off, the pulses stop immediately, and the next train starts from the beginning. All details are from
memory. The state of a train is stored between scans and reset when the CPU changes to RUN.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Final

from controller.core.devices import WORD_MAX
from controller.fx.engine.access import BitWriter, Level, LevelFactory, Reader, bit_writer, bits, reader, within, words
from controller.fx.engine.cpu import COMPLETE, Cpu
from controller.fx.language.instruction import DeviceOperand, Operand

PULSES: Final = (8140, 8142)
"""Low data registers of the pulse counts of Y0 and Y1."""
MAX_HZ: Final = 20_000
MAX_POSITIONING_HZ: Final = 100_000
POSITIONING: Final = 8340
"""Low data register of the position of Y0, and relay of its movement; those of Y1 and Y2 follow at intervals of 10."""
RAMP_MS: Final = (8348, 8358, 8368)
"""Data registers of the ramp times of Y0 to Y2, ms."""
DEFAULT_RAMP_MS: Final = 100
_RAMP: Final = RAMP_MS[0] - POSITIONING
_LONGEST_RAMP_MS: Final = 5000
_RAMP_STEPS: Final = 10

Profile = list[tuple[int, Fraction]]
"""Frequencies in Hz, each with its number of pulses."""


class _Train:
    """Pulse train of one instruction at Y0 or Y1, starting when the instruction is first driven.

    Attributes:
        out: Number of pulses since the start, including the fraction of the current one; the output is on during the
            first half of each pulse.
        running: Whether the instruction was driven in the last scan.
    """

    def __init__(self, cpu: Cpu, output: Operand) -> None:
        self._special = cpu.memory.M
        self._put = bit_writer(cpu, output)
        _, self._row = bits(cpu, output)
        self._total = [words(cpu, DeviceOperand("D", number), wide=True) for number in PULSES]
        self.out = Fraction(0)
        self.running = False

    def check(self) -> int:
        """Return the number of the output.

        Raises:
            OperationError: The device is not a pulse output.
        """
        return within(self._row(1).start, 0, 1)

    def start(self) -> None:
        self.out, self.running = Fraction(0), True

    def advance(self, out: Fraction, set_number: int | None) -> None:
        """Advance the train to `out` pulses, but not beyond `set_number` (None = endless)."""
        total = self._total[self.check()]
        out = out if set_number is None else min(out, Fraction(set_number))
        place = total.places().start
        total.put(place, total.get(place) + int(out) - int(self.out))
        self.out = out
        done = out == set_number
        self._put(not done and out % 1 < Fraction(1, 2))
        self._special[COMPLETE] = done

    def stop(self) -> None:
        """End the train when the drive input turns off."""
        if self.running:
            self.running = False
            self._put(False)
            self._special[COMPLETE] = False


def plsy(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """PLSY s1 s2 Y: output s2 pulses at s1 Hz (1-20,000) with a duty cycle of 50 %; s2 = 0 means endless.

    s1 may change during the train; s2 is read when the drive input turns on.
    """
    frequency, number = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
    train, set_number, previous_ms = _Train(cpu, operands[2]), 0, 0

    def run(on: bool) -> None:
        nonlocal set_number, previous_ms
        if not on:
            train.stop()
            return
        train.check()
        hz = within(frequency(), 1, MAX_HZ)
        if not train.running:
            set_number, previous_ms = within(number(), 0, 2**31 - 1), cpu.now_ms
            train.start()
        out = train.out + Fraction(hz * (cpu.now_ms - previous_ms), 1000)
        previous_ms = cpu.now_ms
        train.advance(out, set_number or None)

    return run


def plsr(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """PLSR s1 s2 s3 Y: output s2 pulses with a ramp up to s1 Hz (10-20,000) and a ramp down.

    Each ramp has 10 steps and takes s3 ms (1-5000). The operands are read when the drive input turns on. If there are
    too few pulses for the ramps, the fastest steps are omitted.
    """
    frequency, number, ramp = (reader(cpu, operand, wide) for operand in operands[:3])
    train, start_ms, set_number = _Train(cpu, operands[3]), 0, 0
    train_profile: Profile = []

    def run(on: bool) -> None:
        nonlocal start_ms, set_number, train_profile
        if not on:
            train.stop()
            return
        train.check()
        if not train.running:
            hz, set_number = within(frequency(), 10, MAX_HZ), within(number(), 1, 2**31 - 1)
            train_profile = profile(hz, set_number, within(ramp(), 1, _LONGEST_RAMP_MS))
            start_ms = cpu.now_ms
            train.start()
        train.advance(pulses_after(train_profile, cpu.now_ms - start_ms), set_number)

    return run


def profile(hz: int, pulses: int, ramp_ms: int) -> Profile:
    """Return the steps of a train that accelerates and decelerates.

    Args:
        hz: Highest frequency.
        pulses: Number of pulses.
        ramp_ms: Duration of each ramp.

    Examples:
        >>> [(f, float(n)) for f, n in profile(1000, 100, 100)][:3]
        [(100, 1.0), (200, 2.0), (300, 3.0)]
    """
    ramp: Profile = []
    left = Fraction(pulses)
    for step in range(1, _RAMP_STEPS + 1):
        speed = hz * step // _RAMP_STEPS
        pulses_in_step = Fraction(speed * ramp_ms, 1000 * _RAMP_STEPS)
        if 2 * pulses_in_step > left:
            break
        ramp.append((speed, pulses_in_step))
        left -= 2 * pulses_in_step
    top = ramp[-1][0] if ramp else hz // _RAMP_STEPS
    return [*ramp, (top, left), *reversed(ramp)]


def pulses_after(steps: Profile, elapsed_ms: int) -> Fraction:
    """Return the number of pulses that a profile has produced after the given time."""
    out, left_ms = Fraction(0), Fraction(elapsed_ms)
    for hz, pulses in steps:
        needed_ms = pulses * 1000 / hz
        if left_ms < needed_ms:
            return out + left_ms * hz / 1000
        out, left_ms = out + pulses, left_ms - needed_ms
    return out


def pwm(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """PWM s1 s2 Y: Y is on for s1 ms of every s2 ms; both may change while PWM is driven; s1 > s2 is an error."""
    width, period = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
    put: BitWriter = bit_writer(cpu, operands[2])
    since: int | None = None

    def run(on: bool) -> None:
        nonlocal since
        if not on:
            if since is not None:
                put(False)
            since = None
            return
        period_ms = within(period(), 1, WORD_MAX)
        width_ms = within(width(), 0, period_ms)
        since = cpu.now_ms if since is None else since
        put((cpu.now_ms - since) % period_ms < width_ms)

    return run


def _positioning(*, absolute: bool) -> LevelFactory:
    """DRVI and DRVA s1 s2 Y d2: output pulses at s2 Hz at Y0 to Y2 up to the position s1; d2 is on while it increases.

    DRVI counts s1 from the current position, DRVA from 0. The position is in D8340, D8350 or D8360 (32 bits); M8340,
    M8350 or M8360 is on during the movement. The ramps take D8348, D8358 or D8368 ms each. The operands are read when
    the drive input turns on; when it turns off, the pulses stop at once, and M8029 is not set. An FX3U decelerates.
    """

    def make(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
        target, frequency = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
        return _Positioning(cpu, operands, target, frequency, absolute=absolute).run

    return make


class _Positioning:
    """Movement of one DRVI or DRVA instruction."""

    def __init__(
        self, cpu: Cpu, operands: tuple[Operand, ...], target: Reader, frequency: Reader, *, absolute: bool
    ) -> None:
        self._cpu, self._target, self._frequency, self._absolute = cpu, target, frequency, absolute
        self._put, self._forwards = bit_writer(cpu, operands[2]), bit_writer(cpu, operands[3])
        _, self._output = bits(cpu, operands[2])
        self._start_ms: int | None = None
        self._from, self._pulses, self._sign = 0, 0, 1
        self._profile: Profile = []

    def run(self, on: bool) -> None:
        """Execute one scan."""
        special = self._cpu.memory.M
        output = within(self._output(1).start, 0, 2)
        busy = POSITIONING + 10 * output
        if not on:
            if self._start_ms is not None:
                self._start_ms, special[busy], special[COMPLETE] = None, False, False
                self._put(False)
            return
        row = words(self._cpu, DeviceOperand("D", busy), wide=True)
        (position,), (ramp_ms,) = row.read(1), words(self._cpu, DeviceOperand("D", busy + _RAMP), wide=False).read(1)
        if self._start_ms is None:
            self._begin(position, ramp_ms)
        out = Fraction(self._pulses)
        if self._start_ms is not None and self._pulses:
            out = min(pulses_after(self._profile, self._cpu.now_ms - self._start_ms), out)
        done = out == self._pulses
        row.put(busy, self._from + self._sign * int(out))
        special[busy], special[COMPLETE] = not done, done
        self._put(not done and out % 1 < Fraction(1, 2))

    def _begin(self, position: int, ramp_ms: int) -> None:
        """Read the operands and begin the movement."""
        hz = within(self._frequency(), 10, MAX_POSITIONING_HZ)
        distance = self._target() - (position if self._absolute else 0)
        self._from, self._pulses, self._sign = position, abs(distance), -1 if distance < 0 else 1
        self._profile = profile(hz, self._pulses, within(ramp_ms, 1, _LONGEST_RAMP_MS))
        self._start_ms = self._cpu.now_ms
        self._forwards(distance >= 0)


LEVELS: Final[dict[str, LevelFactory]] = {
    "PLSY": plsy,
    "PLSR": plsr,
    "PWM": pwm,
    "DRVI": _positioning(absolute=False),
    "DRVA": _positioning(absolute=True),
}
