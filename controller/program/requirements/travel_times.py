"""Travel times of the machine, and the relation that the times of the program must have to them.

The program cannot measure them: it believes a switch that comes on after the shortest travel time, an arrival after the
time of a full stroke, and claws after their dwell. These beliefs are assumptions of the proof, so the times are checked
against those of the machine before each start and in the proof.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Final

from controller.core.expr import Bit, Timer, Word
from controller.core.program import Program
from controller.core.rungs import Annunciate, OnDelay
from controller.core.specification import PropertyResult
from controller.program.tags import ROWS, SIDES, ArmTags, Tags

EARLIEST: Final = 1 / 3
"""Fraction of the shortest travel time from which the program may believe a switch. A switch that fails on is believed
from then on, so the time must not be much shorter; the delivered program uses 0.48 to 0.89."""
LONGEST_MS: Final = 60_000
"""Longest permitted travel time, ms; ten times that of the slowest device."""


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
    """Travel times of the devices of an arm, ms; the defaults are those of the delivered machine.

    The longest time is that of the full travel at the speed to which the throttles are adjusted; the shortest one is
    that from one switch to the next at the highest speed of the device (docs/sources/machine.md 1).

    Attributes:
        lift_ms: Longest time from end to end: 150 mm at 0.2 m/s.
        lift_shortest_ms: 138 mm between the switches at 0.43 m/s, if a jam has vented the chamber ahead of the piston.
        belt_ms: Longest time from end to end: 187 mm at 0.2 m/s.
        belt_shortest_ms: 179 mm between the switches at 0.2 m/s; the motor cannot run much faster.
        row_1_ms: Longest time from feed to row 1: 292.5 mm (800 mm between the rows of plants) at 0.15 m/s.
        row_1_shortest_ms: 180.5 mm between the switches (600 mm between the rows of plants) at 0.15 m/s.
        row_ms: Longest time from row to row: 43 mm at 0.15 m/s.
        row_shortest_ms: 31 mm between the switches at 0.15 m/s.
        claws_ms: Longest time in which the claws open or close, with valve and air: 126 ms simulated at 0.40 MPa.

    Raises:
        TravelTimesError: A time is not between 1 ms and `LONGEST_MS`, or a shortest time exceeds the longest one.
    """

    lift_ms: int = 750
    lift_shortest_ms: int = 320
    belt_ms: int = 940
    belt_shortest_ms: int = 895
    row_1_ms: int = 1_950
    row_1_shortest_ms: int = 1_203
    row_ms: int = 287
    row_shortest_ms: int = 206
    claws_ms: int = 130

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


def misfits(
    program: Program, tags: Tags, times: TravelTimes, values: Mapping[Word, int] | None = None
) -> tuple[str, ...]:
    """Return the times of a program that do not fit a machine, one line each.

    Args:
        program: Program with these tags.
        tags: Tags of the program.
        times: Travel times of the machine.
        values: Values of set-points at the start; the others have their defaults.
    """
    presets = _presets(program, {**dict(program.set_points), **(values or {})})
    lines = [line for side in SIDES for line in _of_arm(presets, tags.arms[side], times)]
    return (*lines, *_of_steps(program, tags, presets, times))


def fits(program: Program, tags: Tags, times: TravelTimes) -> PropertyResult:
    """Return the result of `misfits` for the report of the proof, with the default set-points."""
    lines = misfits(program, tags, times)
    return PropertyResult(not lines, lines or assumed(program, tags, times))


def assumed(program: Program, tags: Tags, times: TravelTimes) -> tuple[str, ...]:
    """Return the times that the program believes beside those of the machine, one line for each device."""
    presets, arm = _presets(program, dict(program.set_points)), tags.arms[SIDES[0]]
    lines = []
    for name, (least, shortest) in _least(arm, times).items():
        whole = _whole(arm, times).get(name)
        end = "" if whole is None else f", and its arrival after {presets[whole[0].number]} ms (travel: {whole[1]} ms)"
        lines.append(f"{name}: a switch is believed after {presets[least.number]} ms (shortest: {shortest} ms){end}")
    for timer in (arm.t_closing, arm.t_opening):
        lines.append(f"{timer.name}: believed after {presets[timer.number]} ms (longest: {times.claws_ms} ms)")
    return tuple(lines)


def _presets(program: Program, values: Mapping[Word, int]) -> dict[int, int]:
    """Return the preset of every timer, ms, by number."""
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


def _of_arm(presets: Mapping[int, int], arm: ArmTags, times: TravelTimes) -> Iterator[str]:
    for name, (timer, shortest) in _least(arm, times).items():
        ms = presets[timer.number]
        if ms > shortest:
            yield f"{arm.side} {name}: a switch is believed after {ms} ms, but can come on after {shortest} ms"
        if ms < EARLIEST * shortest:
            yield (
                f"{arm.side} {name}: a switch that fails on is believed after {ms} ms, less than a third of the "
                f"shortest travel time of {shortest} ms"
            )
    for name, (timer, longest) in _whole(arm, times).items():
        if presets[timer.number] < longest:
            yield (
                f"{arm.side} {name}: its arrival is believed after {presets[timer.number]} ms, "
                f"but the travel takes {longest} ms"
            )
    for timer in (arm.t_closing, arm.t_opening):
        if presets[timer.number] < times.claws_ms:
            yield f"{timer.name}: believed after {presets[timer.number]} ms, but takes {times.claws_ms} ms"


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
            for bit in step.hold:
                if step.watch is not None and bit in needed and step.watch.ms <= needed[bit][1]:
                    device, ms = needed[bit]
                    yield f"{sequence.name}: {step.title}: limit {step.watch.ms} ms, but the {device} takes {ms} ms"


_DEVICES: Final = {"lift": "lift", "slide": "slide", "spread": "belt", "converge": "belt", "claws": "claws"}
"""Device that a request moves, by the first word of the name of the request."""
