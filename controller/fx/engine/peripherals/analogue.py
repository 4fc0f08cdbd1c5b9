"""Analogue modules FX2N-4AD and FX0N-3A.

FX2N-4AD: the status word BFM 29, the identification K2010, the limits of the number of samples, the defaults of offset
and gain (0 V or 4 mA, 5 V or 20 mA for the digital value 1,000) and the digital range are those of the manual of the
FX-4AD (verified, docs/sources/fx2n.md 1.9); the numbers of the other words are from memory. The average is taken over
the last samples, and all enabled channels are converted in turn (assumed).

FX0N-3A: 0 to 10 V is 0 to 250 at both inputs and at the output, and the words 0, 16 and 17 (from memory).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.fx.engine.peripherals.buffer_module import BufferModule

CHANNELS: Final = 4
_PRESET, _SAMPLES, _AVERAGE, _PRESENT = 0, 1, 5, 9
_SPEED, _RESET, _ADJUST_PROTECTION, _ADJUST, _OFFSET, _GAIN, _STATUS, _IDENTITY = 15, 20, 21, 22, 23, 24, 29, 30
_VOLTAGE, _CURRENT_4_MA, _CURRENT, _OFF = range(4)
_LOWEST, _HIGHEST = -2048, 2047
_MOST_SAMPLES: Final = 4096
_DEFAULT_SAMPLES: Final = 8
_CONVERSION_MS: Final = (15, 6)
"""Conversion time of a channel at normal and high speed, ms (from memory)."""
_DEFAULTS: Final = {
    **{_SAMPLES + n: _DEFAULT_SAMPLES for n in range(CHANNELS)},
    _ADJUST_PROTECTION: 1,
    _GAIN: 5000,
    _IDENTITY: 2010,
}
_ADJUSTABLE: Final = 0b01
"""Low bits of BFM 21 that permit the adjustment of offset and gain."""
_OUTPUT, _SELECT = 16, 17
_DIGITS_A_V: Final = 25
_LINES: Final = {_VOLTAGE: (0, 5_000), _CURRENT_4_MA: (4_000, 20_000), _CURRENT: (0, 20_000)}
"""Input in mV or µA for the digital values 0 and 1,000 by mode."""


@dataclass(frozen=True, slots=True)
class AnalogueSignal:
    """Piecewise constant signal.

    Attributes:
        times_ms: Times of the changes, ascending, ms.
        values: Value from each time on, V or mA; 0 before the first.
    """

    times_ms: tuple[int, ...] = ()
    values: tuple[float, ...] = ()

    def at(self, time_ms: int) -> float:
        """Return the value at a time in ms."""
        number = bisect_right(self.times_ms, time_ms)
        return self.values[number - 1] if number else 0.0


class AnalogueInputs(BufferModule):
    """FX2N-4AD: four inputs for voltage or current, 12 bits."""

    def __init__(self, signals: Sequence[AnalogueSignal]) -> None:
        """Connect the signals of the channels 1 to 4, in V or mA according to their modes."""
        super().__init__(_IDENTITY + 2, _DEFAULTS)
        self._signals = tuple(signals)
        self._lines: list[tuple[int, int] | None] = [None] * CHANNELS
        self._since_ms = 0

    def written(self, numbers: range, now_ms: int) -> None:
        """Reset the module (BFM 20), adjust offset and gain (BFM 22), and restart the sampling after a change."""
        words = self.words
        if _RESET in numbers and words[_RESET]:
            words[:] = [_DEFAULTS.get(number, 0) for number in range(len(words))]
            self._lines = [None] * CHANNELS
        if _ADJUST in numbers and words[_ADJUST_PROTECTION] & 0b11 == _ADJUSTABLE:
            self._adjust()
        if not {_PRESET, _SPEED, _RESET, *range(_SAMPLES, _SAMPLES + CHANNELS)}.isdisjoint(numbers):
            self._since_ms = now_ms
        self.refresh(now_ms)

    def _adjust(self) -> None:
        """Take over offset and gain for the channels marked in BFM 22: bit 2 n for the offset, 2 n + 1 for the gain."""
        for channel in range(CHANNELS):
            marks = self.words[_ADJUST] >> 2 * channel
            offset, gain = self._line(channel)
            if marks & 0b01:
                offset = self.words[_OFFSET]
            if marks & 0b10:
                gain = self.words[_GAIN]
            self._lines[channel] = (offset, gain) if marks & 0b11 else self._lines[channel]

    def _mode(self, channel: int) -> int:
        return min(self.words[_PRESET] >> 4 * channel & 0xF, _OFF)

    def _line(self, channel: int) -> tuple[int, int]:
        """Return the input in mV or µA for the digital values 0 and 1,000."""
        return self._lines[channel] or _LINES.get(self._mode(channel), _LINES[_VOLTAGE])

    def refresh(self, now_ms: int) -> None:
        """Convert the inputs."""
        enabled = [channel for channel in range(CHANNELS) if self._mode(channel) != _OFF]
        period_ms = _CONVERSION_MS[self.words[_SPEED] == 1] * max(1, len(enabled))
        last = max(0, now_ms - self._since_ms) // period_ms
        out_of_range = bad_count = False
        for channel in range(CHANNELS):
            count = self.words[_SAMPLES + channel]
            if not 1 <= count <= _MOST_SAMPLES:
                bad_count, count = True, _DEFAULT_SAMPLES
            values = [0]
            if channel in enabled:
                values = [
                    self._digital(channel, self._since_ms + n * period_ms)
                    for n in range(max(0, last - count + 1), last + 1)
                ]
            out_of_range = out_of_range or not all(_LOWEST <= value <= _HIGHEST for value in values)
            limited = [min(max(value, _LOWEST), _HIGHEST) for value in values]
            self.words[_PRESENT + channel] = limited[-1]
            self.words[_AVERAGE + channel] = int(sum(limited) / len(limited))
        prohibited = self.words[_ADJUST_PROTECTION] & 0b11 != _ADJUSTABLE
        self.words[_STATUS] = out_of_range << 10 | bad_count << 11 | prohibited << 12
        self.words[_IDENTITY] = _DEFAULTS[_IDENTITY]

    def _digital(self, channel: int, at_ms: int) -> int:
        offset, gain = self._line(channel)
        return round((self._signals[channel].at(at_ms) * 1000 - offset) * 1000 / ((gain - offset) or 1))


class CombinedAnalogue(BufferModule):
    """FX0N-3A: two inputs and one output, 8 bits.

    Attributes:
        output: Digital value of the output, 0 to 255.
    """

    def __init__(self, signals: Sequence[AnalogueSignal]) -> None:
        """Connect the signals of the channels 1 and 2, V."""
        super().__init__(_SELECT + 1, {})
        self._signals = tuple(signals)
        self._select = 0
        self.output = 0

    def channel(self, number: int, now_ms: int) -> int:
        """Return the digital value of input 1 or 2."""
        return min(max(round(self._signals[number - 1].at(now_ms) * _DIGITS_A_V), 0), 0xFF)

    def set_output(self, value: int) -> None:
        """Set the output to a digital value."""
        self.output = self.words[_OUTPUT] = value & 0xFF

    def written(self, numbers: range, now_ms: int) -> None:
        """Convert an input at the rising edge of BFM 17 bit 1, and the output at the falling edge of bit 2."""
        if _SELECT not in numbers:
            return
        before, self._select = self._select, self.words[_SELECT]
        if self._select & ~before & 0b010:
            self.words[0] = self.channel(1 + (self._select & 1), now_ms)
        if before & ~self._select & 0b100:
            self.set_output(self.words[_OUTPUT])
