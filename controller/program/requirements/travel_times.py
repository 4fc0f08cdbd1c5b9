"""Travel times of the machine, and the relation that the times of the program must have to them.

The program cannot measure them: it believes a switch that comes on after the shortest travel time, an arrival after the
time of a full stroke, and claws after their dwell. These beliefs are assumptions of the proof, so the times are checked
against those of the machine before each start and in the proof.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Final

from controller.core.expr import Bit, Timer, Word
from controller.core.program import Program
from controller.core.rungs import Annunciate, OnDelay
from controller.core.specification import PropertyResult
from controller.program.tags import ROWS, SIDES, ArmTags, Tags

EARLIEST: Final = 1 / 2
"""Fraction of the shortest travel time from which the program may believe a switch. A switch that fails on is believed
from then on, so the time must not be much shorter; the program uses 0.68 to 0.89 of the default times."""
LONGEST_MS: Final = 60_000
"""Longest permitted travel time, ms; a number beyond it is a mistake in the unit."""


class TravelTimesError(ValueError):
    """Raised for an invalid travel time; the message is one line with its name and the permitted values."""


def check_time(name: str, value: object) -> int:
    """Return a travel time if it is valid.

    Raises:
        TravelTimesError: The value is not an integer from 1 to `LONGEST_MS`.
    """
    if type(value) is not int or not 1 <= value <= LONGEST_MS:
        raise TravelTimesError(f"{name}: must be an integer, 1 to {LONGEST_MS}")
    return value


@dataclass(frozen=True, slots=True)
class TravelTimes:
    """Travel times of the devices of an arm, ms.

    A longest time begins when the coil comes on and ends at the switch of the other end; it includes valve, air and
    start. A shortest time begins when a device leaves a switch and ends at the next one, as the program measures it.
    The defaults cover the machines with 600 to 800 mm between the rows of plants. They are those of the simulated
    machine without faults, which a test measures, with a margin of up to 65 ms (speeds: docs/sources/machine.md 4).

    Attributes:
        lift_ms: Longest time from end to end, 150 mm at 0.2 m/s.
        lift_shortest_ms: Shortest time between the switches, 138 mm, if the chamber ahead of the piston is vented.
        belt_ms: Longest time from end to end, 187 mm at 0.2 m/s.
        belt_shortest_ms: Shortest time between the switches, 179 mm; the motor cannot run much faster.
        row_1_ms: Longest time from feed to row 1, 292.5 mm (800 mm between the rows of plants) at 0.15 m/s.
        row_1_shortest_ms: Shortest time between these switches, 180.5 mm (600 mm between the rows of plants).
        row_ms: Time from row to row while the slide moves, 43 mm at 0.15 m/s.
        row_shortest_ms: Shortest time between the switches of two rows, 31 mm.
        claws_ms: Longest time from the coil to gripped or free stems.

    Raises:
        TravelTimesError: A time is not between 1 ms and `LONGEST_MS`, or a shortest time exceeds the longest one.
    """

    lift_ms: int = 1_100
    lift_shortest_ms: int = 320
    belt_ms: int = 965
    belt_shortest_ms: int = 895
    row_1_ms: int = 2_670
    row_1_shortest_ms: int = 1_143
    row_ms: int = 287
    row_shortest_ms: int = 147
    claws_ms: int = 160

    def __post_init__(self) -> None:
        for each in fields(self):
            check_time(each.name, getattr(self, each.name))
        for name in ("lift", "belt", "row_1", "row"):
            longest, shortest = f"{name}_ms", f"{name}_shortest_ms"
            if getattr(self, shortest) > getattr(self, longest):
                raise TravelTimesError(f"{shortest}: must not exceed {longest}, {getattr(self, longest)}")

    @property
    def slide_ms(self) -> int:
        """Longest time of the slide from feed to the last row, ms."""
        return self.row_1_ms + self.row_ms * (len(ROWS) - 1)


DELIVERED: Final = TravelTimes()


@dataclass(frozen=True, slots=True)
class MachineData:
    """Data of a machine that the program cannot measure.

    Attributes:
        times: Travel times.
        values: Values of machine constants; the others have their defaults.
    """

    times: TravelTimes = DELIVERED
    values: Mapping[Word, int] = field(default_factory=dict)


def misfits(program: Program, tags: Tags, data: MachineData) -> tuple[str, ...]:
    """Return the times of a program that do not fit a machine, one line each.

    Args:
        program: Program with these tags.
        tags: Tags of the program.
        data: Data of the machine.
    """
    presets, times = _presets(program, data), data.times
    lines = [line for side in SIDES for line in _of_arm(presets, tags.arms[side], times)]
    return (*lines, *_of_steps(program, tags, presets, times))


def fits(program: Program, tags: Tags, data: MachineData) -> PropertyResult:
    """Return the result of `misfits` for the report of the proof."""
    lines = misfits(program, tags, data)
    return PropertyResult(not lines, lines or assumed(program, tags, data))


def assumed(program: Program, tags: Tags, data: MachineData) -> tuple[str, ...]:
    """Return the times that the program believes beside those of the machine, one line for each device."""
    presets = _presets(program, data)
    lines = []
    for arm in tags.arms.values():
        for name, (least, shortest) in _least(arm, data.times).items():
            whole = _whole(arm, data.times).get(name)
            end = "" if whole is None else f", its arrival after {presets[whole[0].number]} ms (longest: {whole[1]} ms)"
            lines.append(
                f"{name}: a switch is believed after {presets[least.number]} ms (shortest: {shortest} ms){end}"
            )
        for name, timer in _dwells(arm).items():
            lines.append(f"{name}: believed after {presets[timer.number]} ms (longest: {data.times.claws_ms} ms)")
    return tuple(dict.fromkeys(lines))


def _presets(program: Program, data: MachineData) -> dict[int, int]:
    """Return the preset of every timer, ms, by number."""
    values = {**dict(program.set_points), **data.values}
    presets: dict[int, int] = {}
    for rung in program.rungs():
        if isinstance(rung, OnDelay | Annunciate):
            preset, timer = rung.preset, rung.timer
            presets[timer.number] = values.get(preset, 0) * timer.base_ms if isinstance(preset, Word) else preset
    return presets


def _least(arm: ArmTags, times: TravelTimes) -> dict[str, tuple[Timer, int]]:
    """Return the timer of the shortest plausible travel time of each device, with the shortest travel time."""
    return {
        "lift": (arm.t_lift_way, times.lift_shortest_ms),
        "belt": (arm.t_belt_way, times.belt_shortest_ms),
        "slide": (arm.t_slide_way, times.row_1_shortest_ms),
        "slide between rows": (arm.t_slide_hop, times.row_shortest_ms),
    }


def _whole(arm: ArmTags, times: TravelTimes) -> dict[str, tuple[Timer, int]]:
    """Return the timer after which each device has arrived at its end stop, with the longest travel time."""
    return {name: (arm.t_pressed[name], getattr(times, f"{name}_ms")) for name in ("lift", "belt", "slide")}


def _dwells(arm: ArmTags) -> dict[str, Timer]:
    """Return the timers after which the claws have closed and opened."""
    return {"claws closing": arm.t_closing, "claws opening": arm.t_opening}


def _of_arm(presets: Mapping[int, int], arm: ArmTags, times: TravelTimes) -> Iterator[str]:
    for name, (timer, shortest) in _least(arm, times).items():
        ms = presets[timer.number]
        if ms > shortest:
            yield f"{arm.side} {name}: a switch is believed after {ms} ms, but can come on after {shortest} ms"
        if ms < EARLIEST * shortest:
            yield (
                f"{arm.side} {name}: a switch that fails on is believed after {ms} ms, less than half of the "
                f"shortest travel time of {shortest} ms"
            )
    for name, (timer, longest) in _whole(arm, times).items():
        if presets[timer.number] < longest:
            yield (
                f"{arm.side} {name}: its arrival is believed after {presets[timer.number]} ms, "
                f"but the travel takes {longest} ms"
            )
    for name, timer in _dwells(arm).items():
        if presets[timer.number] < times.claws_ms:
            yield f"{arm.side} {name}: believed after {presets[timer.number]} ms, but takes {times.claws_ms} ms"


def _of_steps(program: Program, tags: Tags, presets: Mapping[int, int], times: TravelTimes) -> Iterator[str]:
    """Yield the time limits of steps that expire before the device has arrived or its arrival is believed."""
    needed: dict[Bit, tuple[str, int]] = {}
    for arm in tags.arms.values():
        whole = {name: max(longest, presets[timer.number]) for name, (timer, longest) in _whole(arm, times).items()}
        dwell = max(times.claws_ms, presets[arm.t_closing.number], presets[arm.t_opening.number])
        for output, bit in arm.want.items():
            device = _DEVICES[output.partition("_")[0]]
            needed[bit] = (device, dwell if device == "claws" else whole[device])
    for sequence in program.sequences():
        for _, step in sequence:
            if step.watch is None:
                continue
            limit_ms = presets[step.watch.timer.number]
            for device, ms in (needed[bit] for bit in step.hold if bit in needed):
                if limit_ms <= ms:
                    yield f"{sequence.name}: {step.title}: limit {limit_ms} ms, but the {device} needs {ms} ms"


_DEVICES: Final = {"lift": "lift", "slide": "slide", "spread": "belt", "converge": "belt", "claws": "claws"}
"""Device that a request moves, by the first word of the name of the request."""
