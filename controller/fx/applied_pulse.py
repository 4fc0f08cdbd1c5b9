"""Pulse outputs in a scan: PLSY PWM PLSR (FNC 57-59).

An FX2N makes these pulses in hardware, beside the scan. Here the pulses that would be out are counted by the time of
the scans, exactly, and Y shows the level that the train has at the time of the scan: a train faster than half the
scan rate cannot be seen in the Y image, its count is right all the same. The sum of the pulses of PLSY and PLSR is in
D8140, D8141 for Y0 and D8142, D8143 for Y1 (GK). M8029 comes on with the last pulse and goes off with the drive. The
drive off stops at once, and the next drive starts anew. All details are general knowledge (GK). What is under way is
remembered from scan to scan; instructions are made anew when the CPU goes to RUN.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Final

from controller.core.devices import WORD_MAX
from controller.fx.access import BitWriter, Level, LevelMaker, bit_writer, bits, reader, within, words
from controller.fx.cpu import COMPLETE, Cpu
from controller.fx.instruction import Device, Operand

PULSES: Final = (8140, 8142)
"""Low data register of the pulses of Y0 and of Y1."""
MAX_HZ: Final = 20_000
_LONGEST_RAMP_MS: Final = 5000
_RAMP_STEPS: Final = 10

Profile = list[tuple[int, Fraction]]
"""Frequencies in Hz, each with the pulses that are made at it."""


class _Train:
    """Pulses of one instruction at Y0 or Y1, from its drive on.

    Attributes:
        out: Pulses made so far; in the first half of a pulse Y is on.
        running: Whether the instruction was driven in the last scan.
    """

    def __init__(self, cpu: Cpu, output: Operand) -> None:
        self._special = cpu.memory.M
        self._put = bit_writer(cpu, output)
        _, self._row = bits(cpu, output)
        self._total = [words(cpu, Device("D", number), wide=True) for number in PULSES]
        self.out = Fraction(0)
        self.running = False

    def check(self) -> int:
        """Return the number of the output.

        Raises:
            OperationError: It has no pulse output.
        """
        return within(self._row(1).start, 0, 1)

    def start(self) -> None:
        self.out, self.running = Fraction(0), True

    def advance(self, out: Fraction, wanted: int | None) -> None:
        """Go on to so many pulses, at most the wanted ones; None = without end."""
        total = self._total[self.check()]
        out = out if wanted is None else min(out, Fraction(wanted))
        place = total.places().start
        total.put(place, total.get(place) + int(out) - int(self.out))
        self.out = out
        done = out == wanted
        self._put(not done and out % 1 < Fraction(1, 2))
        self._special[COMPLETE] = done

    def stop(self) -> None:
        """Take the drive away."""
        if self.running:
            self.running = False
            self._put(False)
            self._special[COMPLETE] = False


def plsy(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """PLSY s1 s2 Y: s2 pulses of s1 Hz (1-20,000), half of each on; s2 = 0: without end.

    s1 may change while the pulses run, s2 counts when the drive comes on.
    """
    frequency, number = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
    train, wanted, then_ms = _Train(cpu, operands[2]), 0, 0

    def run(on: bool) -> None:
        nonlocal wanted, then_ms
        if not on:
            train.stop()
            return
        train.check()
        hz = within(frequency(), 1, MAX_HZ)
        if not train.running:
            wanted, then_ms = within(number(), 0, 2**31 - 1), cpu.now_ms
            train.start()
        out = train.out + Fraction(hz * (cpu.now_ms - then_ms), 1000)
        then_ms = cpu.now_ms
        train.advance(out, wanted or None)

    return run


def plsr(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """PLSR s1 s2 s3 Y: s2 pulses, up to s1 Hz (10-20,000) and down again, each ramp 10 steps in s3 ms (1-5000).

    The operands count when the drive comes on. Too few pulses for the whole ramps leave out the fastest steps.
    """
    frequency, number, ramp = (reader(cpu, operand, wide) for operand in operands[:3])
    train, start_ms, wanted = _Train(cpu, operands[3]), 0, 0
    made: Profile = []

    def run(on: bool) -> None:
        nonlocal start_ms, wanted, made
        if not on:
            train.stop()
            return
        train.check()
        if not train.running:
            hz, wanted = within(frequency(), 10, MAX_HZ), within(number(), 1, 2**31 - 1)
            made = profile(hz, wanted, within(ramp(), 1, _LONGEST_RAMP_MS))
            start_ms = cpu.now_ms
            train.start()
        train.advance(pulses_after(made, cpu.now_ms - start_ms), wanted)

    return run


def profile(hz: int, pulses: int, ramp_ms: int) -> Profile:
    """Return the steps of a train that speeds up and slows down.

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
        made = Fraction(speed * ramp_ms, 1000 * _RAMP_STEPS)
        if 2 * made > left:
            break
        ramp.append((speed, made))
        left -= 2 * made
    top = ramp[-1][0] if ramp else hz // _RAMP_STEPS
    return [*ramp, (top, left), *reversed(ramp)]


def pulses_after(steps: Profile, elapsed_ms: int) -> Fraction:
    """Return how many pulses of a profile are out after a time in ms."""
    out, left_ms = Fraction(0), Fraction(elapsed_ms)
    for hz, pulses in steps:
        needed_ms = pulses * 1000 / hz
        if left_ms < needed_ms:
            return out + left_ms * hz / 1000
        out, left_ms = out + pulses, left_ms - needed_ms
    return out


def pwm(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Level:
    """PWM s1 s2 Y: Y is on for s1 ms of every s2 ms; both may change while it runs, s1 above s2 is an error."""
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


LEVELS: Final[dict[str, LevelMaker]] = {"PLSY": plsy, "PLSR": plsr, "PWM": pwm}
