"""Telemetry: process values that the controller cannot measure, as a table of Modbus input registers.

Every value is declared once, in `TELEMETRY`: the server encodes it, clients decode it with `read_telemetry`, and
the documentation contains `telemetry_table`. Two words are sent high word first. A value that exceeds the range of its
words is clipped.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from plant_sim.crop.planting_row import RECENT_CUPS, PassedCup
from plant_sim.links.io_module import IoModule
from plant_sim.links.write_timing import LinkTiming
from plant_sim.machine.arm import ArmPlant

WORD_ORDER = "high first"
"""Order of the words of every value of two words."""


@dataclass(frozen=True, slots=True)
class TelemetryPoint:
    """A value in the input registers.

    Attributes:
        name: Key in `read_telemetry`; the suffix is its unit.
        offset: First register.
        words: Number of registers, 1 or 2.
        scale: Value of one count, in the unit of the name.
        meaning: Description.
        read: Function that returns the value from the module.
        signed: True for two's complement.
        may_be_none: True if the value may be absent, which is sent as all bits set.
    """

    name: str
    offset: int
    words: int
    scale: float
    meaning: str
    read: Callable[[IoModule], float | None]
    signed: bool = False
    may_be_none: bool = False

    @property
    def word_order(self) -> str:
        """Order of the words by ascending address; empty for a single word."""
        return WORD_ORDER if self.words == 2 else ""

    def encode(self, module: IoModule) -> list[int]:
        """Encode the current value as registers."""
        value = self.read(module)
        span = 1 << 16 * self.words
        if value is None:
            return self._split(span - 1)
        lowest = -span // 2 if self.signed else 0
        highest = lowest + span - (2 if self.may_be_none else 1)
        return self._split(min(max(round(value / self.scale), lowest), highest) % span)

    def decode(self, registers: Sequence[int]) -> float:
        """Decode the value from the registers of the table; an absent value is returned as NaN."""
        span = 1 << 16 * self.words
        counts = 0
        for register in registers[self.offset : self.offset + self.words]:
            counts = counts << 16 | register
        if self.may_be_none and counts == span - 1:
            return math.nan
        if self.signed and counts >= span // 2:
            counts -= span
        return round(counts * self.scale, 6)  # 0.1 mm has no exact binary representation

    def _split(self, counts: int) -> list[int]:
        return [counts >> 16 * word & 0xFFFF for word in reversed(range(self.words))]


def encode_telemetry(module: IoModule) -> list[int]:
    """Return all current input registers from register 0."""
    return [register for point in TELEMETRY for register in point.encode(module)]


def read_telemetry(registers: Sequence[int]) -> dict[str, float]:
    """Decode the registers read by a client.

    Args:
        registers: `TELEMETRY_REGISTERS` input registers from register 0.

    Returns:
        Values by name, in the unit given by the suffix of the name; NaN if absent.

    Raises:
        ValueError: The number of registers is wrong.
    """
    if len(registers) != TELEMETRY_REGISTERS:
        raise ValueError(f"telemetry has {TELEMETRY_REGISTERS} registers, not {len(registers)}")
    return {point.name: point.decode(registers) for point in TELEMETRY}


def telemetry_table() -> list[tuple[str, ...]]:
    """Return the table for the documentation, header row first."""
    heading = ("register", "words", "word_order", "name", "one count is", "meaning")
    rows = [
        (
            str(point.offset),
            str(point.words),
            point.word_order,
            point.name,
            f"{point.scale:g}{', signed' if point.signed else ''}",
            f"{point.meaning}{', all bits set: none' if point.may_be_none else ''}",
        )
        for point in TELEMETRY
    ]
    return [heading, *rows]


def _y_bits(module: IoModule) -> int:
    return sum(level << number for number, level in enumerate(module.outputs[:32]))


def _arm_points(side: str, first: int) -> tuple[TelemetryPoint, ...]:
    """Return the positions of one arm, from register `first`."""

    def point(index: int, name: str, meaning: str, read: Callable[[ArmPlant], float]) -> TelemetryPoint:
        return TelemetryPoint(
            name=f"{side}.{name}",
            offset=first + index,
            words=1,
            scale=0.1,
            meaning=f"{side} {meaning}",
            read=lambda module: read(module.plant.arms[side]),
            signed=True,
        )

    return (
        point(0, "slide_mm", "slide, from feed inward", lambda arm: 1_000 * arm.slide.x_m),
        point(1, "lift_mm", "lift cylinder extension (arm down)", lambda arm: 1_000 * arm.lift.y_m),
        point(2, "spreader_mm", "spreader belt, from converged", lambda arm: 1_000 * arm.spreader.travel_m),
        point(3, "claw_deg", "finger angle, positive when open", lambda arm: arm.claws.angle_deg),
    )


def _success_pct(module: IoModule) -> float | None:
    counts = module.plant.counts()
    handled = counts.in_cups + counts.P + counts.D + counts.T
    return 100 * counts.in_cups / handled if handled else None


def _clamp_point(side: str, offset: int) -> TelemetryPoint:
    meaning = f"force of a {side} finger, positive when clamping"
    return TelemetryPoint(
        f"{side}.clamp_n", offset, 1, 0.1, meaning, lambda module: module.plant.arms[side].claws.clamp_n, signed=True
    )


CUPS_PER_VALUE = 8
"""Number of cups in one telemetry value, 4 bits each."""
_EMPTY_CUP = 3
"""Code of an empty cup without a lost seedling; that of one with a lost seedling is the number of its `Location`."""


def _cup_code(cup: PassedCup) -> int:
    """Return the code of a cup: the number of seedlings, or the cause of an empty cup."""
    if cup.seedlings:
        return min(cup.seedlings, 2)
    return _EMPTY_CUP if cup.cause is None else int(cup.cause)


def _cup_points(side: str, first: int) -> tuple[TelemetryPoint, ...]:
    """Return the latest cups of one row, from register `first`."""

    def point(number: int) -> TelemetryPoint:
        def read(module: IoModule) -> float:
            latest = list(module.plant.arms[side].row.recent)[::-1]
            cups = latest[number * CUPS_PER_VALUE : (number + 1) * CUPS_PER_VALUE]
            return sum(_cup_code(cup) << 4 * place for place, cup in enumerate(cups))

        meaning = f"{side} cups past the claws, {CUPS_PER_VALUE} x 4 bits, the latest lowest"
        if number:
            meaning = f"the {CUPS_PER_VALUE} cups before those of {side}.cups_{number}"
        else:
            meaning += "; 0 none, 1 seedling, 2 double, 3 empty, 5 P, 6 D, 7 T"
        return TelemetryPoint(f"{side}.cups_{number + 1}", first + 2 * number, 2, 1, meaning, read)

    return tuple(point(number) for number in range(RECENT_CUPS // CUPS_PER_VALUE))


def _timing_points(first: int) -> tuple[TelemetryPoint, ...]:
    """Return the measured timing of the links, from register `first`."""

    def period_ms(timing: LinkTiming, percent: float) -> float | None:
        return None if timing.latest is None else _ms(timing.latest.periods.percentile_s(percent))

    def jitter_ms(timing: LinkTiming) -> float | None:
        latest = timing.latest
        return 1e3 * latest.periods.deviation_s if latest is not None and latest.periods.count else None

    def lateness_ms(percent: float) -> Callable[[LinkTiming], float | None]:
        return lambda timing: _ms(timing.lateness.percentile_s(percent))

    values: tuple[tuple[str, int, float, str, Callable[[LinkTiming], float | None]], ...] = (
        (
            "write_period_ms",
            1,
            0.1,
            "period of the output writes of the latest client, median",
            lambda t: period_ms(t, 50),
        ),
        ("write_period_p99_ms", 1, 0.1, "period of these writes, 99th percentile", lambda t: period_ms(t, 99)),
        ("write_jitter_ms", 1, 0.01, "standard deviation of this period", jitter_ms),
        (
            "longest_gap_ms",
            2,
            1,
            "longest plant time between two output writes of any client",
            lambda t: t.longest_gap_ms,
        ),
        ("gaps", 1, 1, "gaps between output writes that exceeded the limit", lambda t: t.gaps),
        (
            "lost_after_gaps",
            1,
            1,
            "seedlings lost from a gap to the end of the following cycle",
            lambda t: t.seedlings_lost_after_gaps,
        ),
        ("tick_lateness_ms", 1, 0.01, "lateness of the ticks of real time, median", lateness_ms(50)),
        ("tick_lateness_p99_ms", 1, 0.01, "lateness of the ticks, 99th percentile", lateness_ms(99)),
        ("tick_lateness_longest_ms", 1, 0.01, "longest lateness of a tick", lateness_ms(100)),
        ("dropped_ms", 2, 1, "plant time dropped because this computer was late", lambda t: t.dropped_ms),
        ("plc_state", 1, 1, "PLC of which the plant is a client: 0 none, 1 connected, 2 lost", lambda t: t.plc_state),
        ("plc_losses", 1, 1, "number of times that this PLC was lost", lambda t: t.plc_losses),
    )
    points, offset = [], first
    for name, words, scale, meaning, read in values:
        may_be_none = name.startswith(("write_", "tick_"))
        points.append(TelemetryPoint(name, offset, words, scale, meaning, _of_timing(read), may_be_none=may_be_none))
        offset += words
    return tuple(points)


def _of_timing(read: Callable[[LinkTiming], float | None]) -> Callable[[IoModule], float | None]:
    return lambda module: read(module.timing)


def _ms(duration_s: float | None) -> float | None:
    return None if duration_s is None else 1e3 * duration_s


TELEMETRY = (
    TelemetryPoint("time_ms", 0, 2, 1, "plant time", lambda m: m.plant.time_ms),
    TelemetryPoint(
        "tray_at_pick",
        2,
        1,
        1,
        "number of the tray at the pick position",
        lambda m: m.plant.conveyor.placed_tray,
        may_be_none=True,
    ),
    TelemetryPoint("in_tray", 3, 1, 1, "seedlings in trays", lambda m: m.plant.counts().in_tray),
    TelemetryPoint("in_claw", 4, 1, 1, "seedlings in claws", lambda m: m.plant.counts().in_claw),
    TelemetryPoint("in_cups", 5, 1, 1, "seedlings in cups", lambda m: m.plant.counts().in_cups),
    TelemetryPoint("P", 6, 1, 1, "seedlings lost while picking", lambda m: m.plant.counts().P),
    TelemetryPoint("D", 7, 1, 1, "seedlings lost while carrying", lambda m: m.plant.counts().D),
    TelemetryPoint("T", 8, 1, 1, "seedlings fallen outside the cups", lambda m: m.plant.counts().T),
    TelemetryPoint("total", 9, 1, 1, "seedlings at the start", lambda m: m.plant.counts().total),
    TelemetryPoint(
        "left.missed_cups", 10, 1, 1, "cups of the left row that passed empty", lambda m: m.plant.missed_cups["left"]
    ),
    TelemetryPoint(
        "right.missed_cups", 11, 1, 1, "cups of the right row that passed empty", lambda m: m.plant.missed_cups["right"]
    ),
    *_arm_points("left", 12),
    *_arm_points("right", 16),
    TelemetryPoint(
        "planting_frequency_per_min",
        20,
        1,
        0.1,
        "cups per minute per row",
        lambda m: m.plant.planting_frequency_per_min,
    ),
    TelemetryPoint("watchdog_state", 21, 1, 1, "0 unarmed, 1 armed, 2 tripped", lambda m: m.watchdog_state),
    TelemetryPoint(
        "last_write_ms", 22, 2, 1, "time of the last output write", lambda m: m.last_write_ms, may_be_none=True
    ),
    TelemetryPoint(
        "tripped_at_ms", 24, 2, 1, "time of the last watchdog trip", lambda m: m.tripped_at_ms, may_be_none=True
    ),
    TelemetryPoint("y_image", 26, 2, 1, "raw levels; bit n is Y n (octal value), up to Y37", _y_bits),
    TelemetryPoint("incidents", 28, 2, 1, "incidents so far", lambda m: len(m.plant.events)),
    _clamp_point("left", 30),
    _clamp_point("right", 31),
    TelemetryPoint(
        "main_pressure_kpa",
        32,
        1,
        0.1,
        "gauge pressure of slides and lifts",
        lambda m: m.plant.supply.pressure_pa / 1e3,
    ),
    TelemetryPoint(
        "claw_pressure_kpa", 33, 1, 0.1, "gauge pressure of the claws", lambda m: m.plant.supply.claw_pressure_pa / 1e3
    ),
    TelemetryPoint(
        "S_pct",
        34,
        1,
        0.01,
        "seedlings in cups as a percentage of those in cups or lost (at the end of a trial: S of the paper)",
        _success_pct,
        may_be_none=True,
    ),
    *_cup_points("left", 35),
    *_cup_points("right", 41),
    TelemetryPoint(
        "refused_writes",
        47,
        2,
        1,
        "writes refused because the outputs belong to another client",
        lambda module: module.lease.refused,
    ),
    *_timing_points(49),
    TelemetryPoint(
        "ploughed", 63, 1, 1, "seedlings in trays through which an arm was driven", lambda m: m.plant.counts().ploughed
    ),
)

TELEMETRY_REGISTERS = TELEMETRY[-1].offset + TELEMETRY[-1].words
